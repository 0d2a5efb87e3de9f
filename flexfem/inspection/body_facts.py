# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass, mass centre, inertia, size and unknowns of the bodies of a model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from flexfem._fields import Renamed
from flexfem._types import FloatArray
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3

__all__ = ["BodyFacts", "MassFacts", "body_facts", "total"]


@dataclass(frozen=True)
class MassFacts:
    """Mass properties at the start.

    Attributes:
        mass: kg.
        centre: mass centre in inertial axes, (3,), m; without mass the middle.
        inertia: about the mass centre in inertial axes, (3, 3), kg m^2.
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray


@dataclass(frozen=True)
class BodyFacts:
    """A body in numbers.

    Attributes:
        body: the body or point mass of the model.
        kind: "point mass", or what its family calls it: "beam", "shell", "rigid body", "floating
            body", "element body".
        find_masses: computes its mass properties, on first use.
        size: edges of its box along the inertial axes, (3,), m.
        elements: number of its finite elements.
        nodes: number of its nodes; nodes that shells share count for the first of them.
        unknowns: of these nodes.
        fixed: number of fixed unknowns.
    """

    body: Any
    kind: str
    find_masses: Callable[[], MassFacts] = field(repr=False)
    size: FloatArray
    elements: int = 0
    nodes: int = 0
    unknowns: int = 0
    fixed: int = 0

    @cached_property
    def masses(self) -> MassFacts:
        """Its mass properties; of flexible bodies as they are unstrained."""
        return self.find_masses()

    @property
    def name(self) -> str:
        """Name of the body."""
        name: str = self.body.name
        return name

    @property
    def degrees_of_freedom(self) -> int:
        """Unknowns that are not fixed."""
        return self.unknowns - self.fixed

    freedoms = Renamed("degrees_of_freedom")
    held = Renamed("fixed")


def body_facts(serial: NumberedModel) -> list[BodyFacts]:
    """Bodies of a model in its order, then its cables with mass, point masses last."""
    facts = dict[str, BodyFacts]()
    for family in serial.families.values():
        nodes, held = family.node_counts()
        number = {body.name: k for k, body in enumerate(family.bodies)}
        width = family.held.shape[1]
        for body in family.own:
            points, k = family.outline(body), number[body.name]
            masses = partial(_masses, partial(family.inertia, body), points.mean(axis=0))
            facts[body.name] = BodyFacts(
                body, family.noun, masses, np.ptp(points, axis=0),
                family.elements(body), int(nodes[k]), int(nodes[k]) * width, int(held[k]),
            )  # fmt: skip
    # bodies in the order of the model, then cables with mass
    order = dict.fromkeys([body.name for body in serial.model.bodies]) | facts
    found = [facts[name] for name in order]
    for mass in serial.model.point_masses:
        at = serial.marker_pose(mass.marker).position
        own = partial(_masses, partial(serial.mass_inertia, mass), at)
        found.append(BodyFacts(mass, "point mass", own, np.zeros(3)))
    return found


def total(facts: Sequence[MassFacts]) -> MassFacts:
    """Mass properties of several bodies together."""
    mass = sum(one.mass for one in facts)
    centres = np.array([one.centre for one in facts]).reshape(-1, 3)
    weights = np.array([one.mass for one in facts]) if mass > 0.0 else np.ones(len(facts))
    centre = weights @ centres / max(weights.sum(), 1e-300)
    inertia = np.zeros((3, 3))
    for one in facts:
        arm = one.centre - centre
        inertia += one.inertia + one.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassFacts(mass, centre, inertia)


def _masses(about: Callable[[FloatArray], FloatArray], near: FloatArray) -> MassFacts:
    """Mass properties, given the inertia matrix about any frame and a point (3,) of the body."""
    matrix = about(se3.frame(near, np.eye(3)))
    mass = float(matrix[0, 0])
    if mass <= 0.0:
        return MassFacts(0.0, near, np.zeros((3, 3)))
    arm = np.array([matrix[1, 5], matrix[2, 3], matrix[0, 4]]) / mass  # of -m skew(arm)
    inertia = matrix[3:, 3:] - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassFacts(mass, near + arm, 0.5 * (inertia + inertia.T))
