# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells on bodies of a surface mesh."""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY
from types import MappingProxyType
from typing import Any

import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import (
    ZERO,
    Array,
    Given,
    checked,
    choice,
    declared,
    direction,
    flag,
    instance,
    number,
    text,
    vector,
)
from flexfem._types import FloatArray
from flexfem.materials.shell_section import ShellSection
from flexfem.materials.thermal_strain import ThermalStrain
from flexfem.mesh.geometry.frames import Orientation

__all__ = ["EDGES", "MASSES", "MEMBRANES", "SHELL_ELEMENTS", "Shell"]

#: Formulations of shells.
SHELL_ELEMENTS = ("rotation_free", "director")
#: Rules along an edge.
EDGES = ("clamped", "hinged", "symmetric", "symmetric x", "symmetric y", "symmetric z")
#: Strains of membranes of rotation-free shells.
MEMBRANES = ("constant", "smoothed")
#: Distributions of mass over the nodes.
MASSES = ("lumped", "consistent")


def _words(owner: str, what: str, values: object) -> Mapping[str, str]:
    """Return checked words by name."""
    if not isinstance(values, Mapping):
        raise TypeError(f"{owner}: {what} must map names to words, got {_checks.show(values)}")
    for name, word in values.items():
        _checks.text(owner, f"{what}: name", name)
        _checks.instance(owner, f'{what}["{name}"]', word, str)
    return MappingProxyType(dict(values))


def _edges(owner: str, what: str, values: object) -> Mapping[str, str]:
    """Return checked rules by line."""
    rules = _words(owner, what, values)
    for line, rule in rules.items():
        _checks.word(owner, f'{what}["{line}"]', rule, EDGES)
    return rules


def _fixed(owner: str, what: str, values: object) -> Mapping[str, str]:
    """Return checked axes by line or node."""
    held = _words(owner, what, values)
    for place, axes in held.items():
        if not axes or len(set(axes)) < len(axes) or not set(axes) <= set("xyz"):
            raise ValueError(
                f'{owner}: {what}["{place}"] must be some of "xyz", got {_checks.show(axes)}'
            )
    return held


def _rest_curvature(owner: str, what: str, value: Any) -> Any:
    """Return checked curvatures, or a function as it is."""
    return value if callable(value) else _checks.array(owner, what, value, (3,))


def _prestrain(owner: str, what: str, value: Any) -> Any:
    """Return checked strains, or a function as it is."""
    if isinstance(value, ThermalStrain) and (callable(value.gradient_y) or value.gradient_y != 0.0):
        got = _checks.show(value.gradient_y)
        raise ValueError(f"{owner}: {what}: a shell has no gradient_y, give gradient_z, got {got}")
    return value if callable(value) else _checks.array(owner, what, value, (6,))


def _has_direction(given: Any) -> bool:
    """Return True if a rest curvature or prestrain may differ along e1 and e2."""
    if given is None or isinstance(given, ThermalStrain):
        return False
    if callable(given):
        return True
    first, second, sheared = given.reshape(-1, 3).T
    return bool((first != second).any() or sheared.any())


@declared
class Shell:
    """Shell on a body of the model's surface mesh.

    Shells whose bodies share nodes are hinged there: they share positions, not slopes. Those with
    directors rotate as one at shared edges.

    Attributes:
        name: Unique name in the model.
        section: Stiffness and mass.
        body: Name of the body in the surface mesh; None for that of the name of the shell.
        element: Formulation: "rotation_free" for triangles with nodal positions alone, "director"
            for quadratic triangles with directors at the midpoints of their edges, which shear
            across their thickness, rotate as one at shared edges, also at kinks, and suit any mesh.
            All shells of a model have the same.
        edges: Rules along lines of the mesh, by the line's name: "clamped" keeps positions
            and slopes, "hinged" positions only, "symmetric" keeps the positions in the plane of
            the line, and the shell at right angles to it. Others are free. The plane of a straight
            line on a curved shell must be given by its normal: "symmetric x", "symmetric y" or
            "symmetric z".
        fixed: Directions in which lines or named nodes are fixed, some of "xyz", by their name.
        direction: Approximate direction of the material axis e1 in inertial axes: a vector, or a
            function of points (n, 3) that returns vectors (n, 3); None for that of the first side
            of each triangle, which suffices for isotropic sections.
        averaged: True if slopes are averaged at the edges of triangles, which any mesh but one of
            parallel diagonals needs and which couples twelve nodes instead of six; None: where the
            mesh needs it.
        membrane: Strains of the membrane of rotation-free triangles: "constant", from the triangle
            alone, or "smoothed", means over it and its neighbours, which bend without stretching on
            much coarser meshes, and take a tenth more time for forces and tangents. Smoothed
            strains near planes of symmetry and of strongly curved initial shapes are less accurate.
        mass: "lumped" at the nodes, or "consistent" with linear velocities.
        rest_curvature: Curvatures (kappa11, kappa22, 2 kappa12) of the stress-free shell along e1
            and e2, shape (3,), 1/m, positive where the side of e3 is longer; or a function of
            points (k, 3) of the initial configuration, inertial axes, that returns (3,) or (k, 3).
            None for those of the initial configuration.
        prestrain: Initial strain in the order of a :class:`ShellSection`, shape (6,): the
            resultants are the stiffness times the strain less this one, so that heat has a
            positive, pretension a negative extension. Or a function of points (k, 3) and the time
            (the load factor in statics) that returns (6,) or (k, 6), or a :class:`ThermalStrain`.
            It and the rest curvature need a `direction` unless they are equal in all directions.
        damping: Stiffness-proportional damping, seconds; for ratios of modes see
            :class:`ModalDamping`.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A wrong shape, NaN, a zero direction, negative damping, an unknown word, or
            strains along axes that no direction gives.
    """

    name: str
    section: ShellSection = instance(ShellSection)
    _: KW_ONLY
    body: Given[str | None, str] = text(default=None)
    element: str = choice(SHELL_ELEMENTS, default="rotation_free")
    edges: Mapping[str, str] = checked(_edges, default=MappingProxyType({}))
    fixed: Mapping[str, str] = checked(_fixed, default=MappingProxyType({}))
    direction: Orientation = direction(default=None)
    averaged: bool | None = flag(default=None)
    membrane: str = choice(MEMBRANES, default="constant")
    mass: str = choice(MASSES, default="lumped")
    rest_curvature: Given[
        npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike] | None,
        FloatArray | Callable[[FloatArray], npt.ArrayLike] | None,
    ] = checked(_rest_curvature, default=None)
    prestrain: Given[
        npt.ArrayLike | Callable[[FloatArray, float], npt.ArrayLike] | None,
        FloatArray | Callable[[FloatArray, float], npt.ArrayLike] | None,
    ] = checked(_prestrain, default=None)
    damping: float = number(default=0.0, nonnegative=True)
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)

    def __post_init__(self) -> None:
        """Name the body, and check what depends on several arguments."""
        if self.body is None:
            _checks.assign(self, body=self.name)
        owner = _checks.named(self, self.name)
        if self.membrane == "smoothed" and self.element != "rotation_free":
            raise ValueError(f'{owner}: membrane "smoothed" needs element "rotation_free"')
        for what, given in (("rest_curvature", self.rest_curvature), ("prestrain", self.prestrain)):
            if self.direction is None and _has_direction(given):
                raise ValueError(
                    f"{owner}: its {what} is not equal in all directions: give the direction of e1"
                )

    @property
    def strained(self) -> bool:
        """True if it has initial strains: a rest curvature or a prestrain."""
        return self.rest_curvature is not None or self.prestrain is not None

    @property
    def timed(self) -> bool:
        """True if its initial strain may change with time."""
        given = self.prestrain
        return callable(given) and not (isinstance(given, ThermalStrain) and given.constant)

    @property
    def initial_strain(self) -> Any:
        """Its initial strain (6,), or a function of points (k, 3) and the time; None for none."""
        given = self.prestrain
        return given.of_shell if isinstance(given, ThermalStrain) else given
