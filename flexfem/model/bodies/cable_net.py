# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nets of elastic cables, slack in compression, and trusses of bars."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from functools import cached_property
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import (
    ZERO,
    Array,
    Given,
    declared,
    flag,
    instance,
    number,
    settled,
    vector,
)
from flexfem._types import FloatArray
from flexfem.mesh.element_mesh import ElementMesh
from flexfem.model.bodies.mesh_body import MeshBody, checked_fixed, one_or_each

__all__ = ["CableNet"]

#: One number, or one for each cable or node.
Values = Given[npt.ArrayLike, FloatArray]
#: The same or none.
ValuesOrNone = Given[npt.ArrayLike | None, FloatArray | None]
#: Points of the rule of Gauss with two points on the unit interval.
_POINTS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


@declared
class CableNet(MeshBody):
    """Net of straight elastic cables between nodes, of any number and connection.

    A cable of the length l and the rest length L pulls with ``EA e (1 + tanh(tau de/dt / e))``
    where its strain ``e = l / L - 1`` is positive, and is slack otherwise; tau is the damping. Its
    damper acts softly where the cable becomes taut, and never makes it press. With
    ``tension_only=False`` cables are bars, which press as well: a truss with hinged joints, whose
    damper is linear.

    A slack cable is bent, and its strands rub: ``slack_damping`` t adds the force ``EA t de/dt`` of
    a linear damper, in slack and taut cables alike, which presses where they get shorter. With far
    less than the damping of taut cables the nodes of slack nets follow their neighbours, instead of
    flying from one jerk to the next one: in steps h beyond ``m L / (EA t)`` with the mass m of a
    node. Newton's method needs fewer iterations then.

    In a step of ``energy_momentum`` in which a cable becomes taut, its mean force is that of its
    energy, which is far less than the force of the end: it is stretched too far, and is slack again
    after the next step. Nets many of whose cables do so in steps that do not resolve it need many
    iterations. With ``dissipating_catch`` the force over such a step is that of its end, the
    tension T, and ``T L (e/2 + d)`` is lost, with the strain e at the end and -d at the start: an
    error of first order in the step. Other integrators have no mean forces, and lose nothing.

    The unknowns are the positions of the nodes; markers are at nodes, which have no axes, see
    :class:`NodeSetMarker`. The mass is distributed along the cables, linear between their nodes.
    The integrator ``energy_momentum`` keeps or dissipates the energy also where many cables become
    slack and taut in one step; ``generalized_alpha`` needs steps that resolve it.

    Attributes:
        name: Unique name in the model.
        mesh: Nodes and cables, a mesh of intervals of degree 1 at the start of the motion, where
            cables may be slack.
        axial_stiffness: EA, N; one number, or one for each cable, (m,).
        mass_per_length: Of the unstretched cable, kg/m; one number or (m,).
        rest_length: Unstretched length, m; one number or (m,). None for that at the start, less the
            stretch of the preload.
        preload: Tension at the start, N, in place of a rest length; one number or (m,).
        node_mass: Of fittings at the nodes, kg; one number, or one for each node, (n,).
        damping: Proportional to the stiffness, s.
        slack_damping: The same, of slack and taut cables alike, s.
        dissipating_catch: True for cables that lose energy as they become taut in a step.
        tension_only: False for bars.
        fixed: Directions in which sets of nodes are fixed, some of "xyz", by the set's name.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: Other cells than intervals of degree 1, a value that is negative, not positive,
            or neither one nor one for each cable, rest length and preload, both nodes of a cable in
            one place without a rest length, or of a bar, a node without mass, slack damping or a
            catch of bars, or a set that the mesh does not have.
    """

    family = "flexfem.families.cable_net.family:CableNetFamily"

    name: str
    mesh: ElementMesh = instance(ElementMesh)
    axial_stiffness: Values = settled(default=None)
    _: KW_ONLY
    mass_per_length: Values = settled(default=None)
    rest_length: ValuesOrNone = settled(default=None)
    preload: Values = settled(default=0.0)
    node_mass: Values = settled(default=0.0)
    damping: float = number(default=0.0, nonnegative=True)
    slack_damping: float = number(default=0.0, nonnegative=True)
    dissipating_catch: bool = flag(default=False)
    tension_only: bool = flag(default=True)
    fixed: Mapping[str, str] = settled(default=MappingProxyType({}))
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)

    def __post_init__(self) -> None:
        """Check the values of cables and nodes."""
        owner, mesh = _checks.named(self, self.name), self.mesh
        if (mesh.cell, mesh.degree) != ("interval", 1):
            raise ValueError(
                f"{owner}: mesh must have intervals of degree 1, got {mesh.cell} of degree "
                f"{mesh.degree}"
            )
        stiffness = self._positive("axial_stiffness")
        preload = self._not_negative("preload", len(mesh.cells))
        if self.rest_length is not None and preload.any():
            raise ValueError(f"{owner}: give preload or rest_length, not both")
        if self.rest_length is not None:
            _checks.assign(self, rest_length=self._positive("rest_length"))
        _checks.assign(
            self,
            axial_stiffness=stiffness,
            preload=preload,
            mass_per_length=self._not_negative("mass_per_length", len(mesh.cells)),
            node_mass=self._not_negative("node_mass", len(mesh.points)),
            fixed=checked_fixed(owner, self.fixed, mesh),
        )
        if self.slack_damping and not self.tension_only:
            raise ValueError(
                f"{owner}: slack_damping is that of cables, got {self.slack_damping:.6g} of bars "
                "(tension_only=False); give damping"
            )
        if self.dissipating_catch and not self.tension_only:
            raise ValueError(
                f"{owner}: dissipating_catch is that of cables, got bars (tension_only=False)"
            )
        self._check_lengths()
        masses = self.node_mass + np.bincount(
            mesh.cells.ravel(), np.repeat(self.mass_per_length, 2), len(mesh.points)
        )
        if not (masses > 0.0).all():
            raise ValueError(f"{owner}: node {int(np.argmin(masses > 0.0))} has no mass")

    def _check_lengths(self) -> None:
        """Check that nodes are apart where cables take their rest length from it, or are bars."""
        short = np.flatnonzero(self.lengths == 0.0)
        if len(short) == 0:
            return
        found = f"{_checks.named(self, self.name)}: both nodes of cable {int(short[0])} coincide"
        if self.rest_length is None:
            raise ValueError(f"{found}, which needs a rest_length")
        if not self.tension_only:
            raise ValueError(f"{found}, a bar without a direction (tension_only=False)")

    def _positive(self, what: str) -> FloatArray:
        """Checked values (m,) of the cables."""
        found = self._not_negative(what, len(self.mesh.cells))
        if not (found > 0.0).all():
            owner = _checks.named(self, self.name)
            raise ValueError(f"{owner}: {what} must be positive, got {found.min():.6g}")
        return found

    def _not_negative(self, what: str, count: int) -> FloatArray:
        """Checked values (count,) of cables or nodes."""
        owner = _checks.named(self, self.name)
        found = one_or_each(owner, what, getattr(self, what), count)
        if not (found >= 0.0).all():
            raise ValueError(f"{owner}: {what} must not be negative, got {found.min():.6g}")
        return found

    @property
    def lengths(self) -> FloatArray:
        """Lengths (m,) of the cables at the start, m."""
        found: FloatArray = np.linalg.norm(
            np.diff(self.mesh.points[self.mesh.cells], axis=1)[:, 0], axis=1
        )
        return found

    @cached_property
    def unstretched(self) -> FloatArray:
        """Rest lengths (m,) of the cables, m."""
        if self.rest_length is not None:
            return self.rest_length
        found: FloatArray = self.lengths / (1.0 + self.preload / self.axial_stiffness)
        return found

    @property
    def details(self) -> str:
        """See :attr:`Body.details`."""
        kind = "cables" if self.tension_only else "bars"
        return f"{self.elements} {kind}, EA up to {self.axial_stiffness.max():.6g} N"

    @property
    def masses(self) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3) in the body at the start, m, and masses (q,), kg, with its inertia."""
        first, last = np.moveaxis(self.mesh.points[self.mesh.cells], 1, 0)
        inside = [first + t * (last - first) for t in _POINTS]
        half = 0.5 * self.mass_per_length * self.unstretched
        return (
            np.concatenate([*inside, self.mesh.points]),
            np.concatenate([half, half, self.node_mass]),
        )
