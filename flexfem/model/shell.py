# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells on bodies of a surface mesh."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.materials.shell_section import ShellSection
from flexfem.mesh.frames import Orientation

__all__ = ["EDGES", "MASSES", "MEMBRANES", "SHELL_ELEMENTS", "Shell"]

_ZERO = (0.0, 0.0, 0.0)

#: Formulations of shells.
SHELL_ELEMENTS = ("rotation_free", "director")
#: What can hold along an edge.
EDGES = ("clamped", "hinged", "symmetric", "symmetric x", "symmetric y", "symmetric z")
#: Strains of membranes of rotation-free shells.
MEMBRANES = ("constant", "smoothed")
#: How mass is distributed over the nodes.
MASSES = ("lumped", "consistent")


@dataclass(frozen=True, eq=False, init=False)
class Shell:
    """Shell on a body of the model's surface mesh.

    Shells whose bodies share nodes are hinged there: they share positions, not slopes. Those with
    directors turn as one at shared edges.

    Attributes:
        name: Unique name in the model.
        section: Stiffness and mass.
        body: Name of the body in the surface mesh; None for that of the name of the shell.
        element: Formulation: "rotation_free" for triangles with nodal positions alone, "director"
            for quadratic triangles with directors amid their edges, which shear across their
            thickness, turn as one where edges are shared, also at kinks, and do on any mesh. All
            shells of a model have the same.
        edges: What holds along lines of the mesh, by the line's name: "clamped" keeps positions
            and slopes, "hinged" positions only, "symmetric" keeps the positions in the plane of
            the line, and the shell at right angles to it. Others are free. The plane of a straight
            line on a curved shell must be given by its normal: "symmetric x", "symmetric y" or
            "symmetric z".
        fixed: Directions in which lines or named nodes are held, some of "xyz", by their name.
        direction: Approximate direction of the material axis e1 in inertial axes: a vector, or a
            function of points (n, 3) that returns vectors (n, 3); None for that of the first side
            of each triangle, which does for isotropic sections.
        averaged: Whether slopes are averaged at the edges of triangles, which any mesh but one of
            parallel diagonals needs and which couples twelve nodes instead of six; None: where the
            mesh needs it.
        membrane: Strains of the membrane of rotation-free triangles: "constant", from the triangle
            alone, or "smoothed", means over it and its neighbours, which bend without stretching
            on much coarser meshes, and take a tenth more time for forces and tangents. Smoothed
            strains near planes of symmetry and of very curved starts are less accurate.
        mass: "lumped" at the nodes, or "consistent" with linear velocities.
        damping: Stiffness-proportional damping, seconds.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.
    """

    name: str
    section: ShellSection
    body: str
    element: str
    edges: Mapping[str, str]
    fixed: Mapping[str, str]
    direction: Orientation
    averaged: bool | None
    membrane: str
    mass: str
    damping: float
    velocity: FloatArray
    angular_velocity: FloatArray

    def __init__(
        self,
        name: str,
        section: ShellSection,
        *,
        body: str | None = None,
        element: str = "rotation_free",
        edges: Mapping[str, str] = MappingProxyType({}),
        fixed: Mapping[str, str] = MappingProxyType({}),
        direction: Orientation = None,
        averaged: bool | None = None,
        membrane: str = "constant",
        mass: str = "lumped",
        damping: float = 0.0,
        velocity: npt.ArrayLike = _ZERO,
        angular_velocity: npt.ArrayLike = _ZERO,
    ) -> None:
        """Create a shell; the body has its name when None.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A wrong shape, NaN, a zero direction, negative damping, or a word that is
                not known.
        """
        owner = _checks.named(self, name)
        _checks.instance(owner, "section", section, ShellSection)
        if direction is not None and not callable(direction):
            direction = _checks.vector(owner, "direction", direction, nonzero=True)
        if averaged is not None:
            _checks.instance(owner, "averaged", averaged, bool)
        for line, rule in _checked(owner, "edges", edges).items():
            _known(owner, f'edges["{line}"]', rule, EDGES)
        if membrane == "smoothed" and element != "rotation_free":
            raise ValueError(f'{owner}: membrane "smoothed" needs element "rotation_free"')
        for place, axes in _checked(owner, "fixed", fixed).items():
            if not axes or len(set(axes)) < len(axes) or not set(axes) <= set("xyz"):
                raise ValueError(
                    f'{owner}: fixed["{place}"] must be some of "xyz", got {_checks.show(axes)}'
                )
        _checks.assign(
            self,
            name=name,
            section=section,
            body=name if body is None else _checks.text(owner, "body", body),
            element=_known(owner, "element", element, SHELL_ELEMENTS),
            edges=MappingProxyType(dict(edges)),
            fixed=MappingProxyType(dict(fixed)),
            direction=direction,
            averaged=averaged,
            membrane=_known(owner, "membrane", membrane, MEMBRANES),
            mass=_known(owner, "mass", mass, MASSES),
            damping=_checks.number(owner, "damping", damping, nonnegative=True),
            velocity=_checks.vector(owner, "velocity", velocity),
            angular_velocity=_checks.vector(owner, "angular_velocity", angular_velocity),
        )


def _checked(owner: str, what: str, values: object) -> Mapping[str, str]:
    """Return checked words by name."""
    if not isinstance(values, Mapping):
        raise TypeError(f"{owner}: {what} must map names to words, got {_checks.show(values)}")
    for name, word in values.items():
        _checks.text(owner, f"{what}: name", name)
        _checks.instance(owner, f'{what}["{name}"]', word, str)
    return values


def _known(owner: str, what: str, word: str, words: tuple[str, ...]) -> str:
    """Return a word that is one of those known."""
    _checks.text(owner, what, word)
    if word not in words:
        known = " or ".join(f'"{one}"' for one in words)
        raise ValueError(f"{owner}: {what} must be {known}, got {_checks.show(word)}")
    return word
