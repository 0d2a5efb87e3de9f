# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small elastic bodies and mechanisms for tests of the formalisms."""

from collections.abc import Callable
from typing import Any

import numpy as np

import flexfem as ff
from flexfem import research
from flexfem._types import FloatArray
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import consistent_start

# soft enough that inertia, gravity and elasticity are of one size
RUBBER = ff.Material(youngs_modulus=2e6, poisson_ratio=0.3, density=1200.0)
GRAVITY = (1.0, -9.81, 0.5)
SIZE = 0.04


def mesh(element: str, length: float, elements: int = 1) -> Callable[[Any], Any]:
    def make(comm: Any) -> Any:
        from dolfinx.mesh import create_box, create_interval, create_rectangle

        if element == "beam":
            return create_interval(comm, elements, (0.0, length))
        if element == "plane":
            return create_rectangle(comm, [(0.0, 0.0), (length, SIZE)], (elements, 1))
        return create_box(comm, [(0.0, 0.0, 0.0), (length, SIZE, SIZE)], (elements, 1, 1))

    return make


def matter(element: str, spatial: bool, **more: Any) -> Any:
    if element == "beam":
        return research.BeamMatter(RUBBER, SIZE, 1.5 * SIZE, spatial=spatial, **more)
    return (
        research.PlaneStress(RUBBER, SIZE, **more)
        if element == "plane"
        else research.Solid(RUBBER, **more)
    )


def chord(length: float, components: int, rotations: bool) -> Callable[[FloatArray], Any]:
    """Hold the ends of a beam, or enough of its corners, such that no rigid motion is left."""

    def held(x: FloatArray) -> Any:
        mask = np.zeros((len(x), components), dtype=bool)
        on_axis = np.isclose(x[:, 1:], 0.0).all(axis=1)
        first, last = (on_axis & np.isclose(x[:, 0], end) for end in (0.0, length))
        translations = 3 if components in (3, 6) and not (components == 3 and rotations) else 2
        mask[first, :translations] = True
        mask[last, 1:translations] = True
        if components == 6:
            mask[first, 3] = True
        elif components == 3 and not rotations:
            corner = np.isclose(x, [0.0, SIZE, 0.0]).all(axis=1)
            mask[corner, 2] = True
        return mask

    return held


def body(
    name: str, element: str, spatial: bool, length: float, *, elements: int = 1,
    damping: float = 0.0, degree: int = 1, **start: Any,
) -> research.EnergyBody:  # fmt: skip
    own = matter(element, spatial, damping=damping, degree=degree)
    frame = research.SpatialFrame() if spatial else research.PlanarFrame()
    held = chord(length, own.components, element == "beam")
    return research.EnergyBody(name, own, frame, mesh(element, length, elements), held, **start)


def pair(element: str, spatial: bool, **more: Any) -> research.Mechanism:
    """Two bodies, the first on the ground, with a moment or a force between them."""
    first = body("first", element, spatial, 0.5, **more)
    second = body("second", element, spatial, 0.4, origin=(0.5, 0.0, 0.0), **more)
    end = research.End("first", (0.5, 0.0, 0.0))
    joints = (
        research.Constraint(
            "hinge", (research.End("first", (0.0, 0.0, 0.0)),), research.end_position, (0.0,) * 3
        ),
        research.Constraint(
            "pin", (end, research.End("second", (0.0, 0.0, 0.0))), research.coincidence
        ),
    )
    tip = research.End("second", (0.4, 0.0, 0.0))
    force = research.AppliedForce(
        "push", (tip,), research.end_position, lambda t: 0.3 + t, (0.1, 0.2, 0.3)
    )
    return research.Mechanism("pair", (first, second), joints, (force,), GRAVITY, observed=tip)


def random_state(
    equations: MechanismEquations, rng: np.random.Generator, rate: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Coordinates and rates on the constraints, displaced by some per cent of the size."""
    q, v = equations.start
    equations.start = (
        q + 0.01 * rng.standard_normal(equations.size),
        rate * rng.standard_normal(equations.size),
    )
    result = consistent_start(equations)
    equations.start = q, v
    return result
