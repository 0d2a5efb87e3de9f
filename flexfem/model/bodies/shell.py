# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells on bodies of a surface mesh."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from types import MappingProxyType

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
from flexfem.materials.shell_section import ShellSection
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
        damping: Stiffness-proportional damping, seconds.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A wrong shape, NaN, a zero direction, negative damping, or an unknown word.
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
    damping: float = number(default=0.0, nonnegative=True)
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)

    def __post_init__(self) -> None:
        """Name the body, and check the membrane against the element."""
        if self.body is None:
            _checks.assign(self, body=self.name)
        if self.membrane == "smoothed" and self.element != "rotation_free":
            owner = _checks.named(self, self.name)
            raise ValueError(f'{owner}: membrane "smoothed" needs element "rotation_free"')
