# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of forces and springs that are written in UFL, against the same laws in Python."""

import math
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem.constraints.elements.differences import law_derivatives
from flexfem.core.laws import ElementMotion
from flexfem.kernels.users.ufl_function import UFLFunction

A, B = ff.Marker("a"), ff.Marker("b")
OPTIONS = ff.RunOptions(dt=0.02, t_end=0.4, quiet=True)


def magnet(t: Any, ends: Any, z: Any, p: Any) -> Any:
    """Moment along the third axis in a field of 1/r, with a leaky current and drag."""
    d, m = ends.positions[0], ends.rotations[0][:, 2]
    r = ufl.sqrt(ufl.dot(d, d))
    f = z[0] * m[0] * d / r**3 - p[0] * ends.velocities[0]
    turn = ufl.cross(d, m) / r - p[0] * ends.angular_velocities[0]
    return [f], [turn], [ufl.sin(3.0 * t) - p[1] * z[0]]


def with_arrays(t: float, ends: ff.Ends, z: np.ndarray, p: np.ndarray) -> Any:
    d, m = ends.positions[0], ends.rotations[0][:, 2]
    r = np.sqrt(d @ d)
    f = z[0] * m[0] * d / r**3 - p[0] * ends.velocities[0]
    turn = np.cross(d, m) / r - p[0] * ends.angular_velocities[0]
    return f[np.newaxis], turn[np.newaxis], np.array([np.sin(3.0 * t) - p[1] * z[0]])


def force(law: Any, **given: Any) -> ff.Force:
    return ff.Force("m", [B], law, states=1, initial=[0.4], parameters=[0.3, 2.0], **given)


def model(*forces: ff.Joint) -> ff.Model:
    made = ff.Model("m")
    made.add(
        ff.RigidBody("a", 1.0, (0.1, 0.2, 0.3)),
        ff.RigidBody("b", 1.0, (0.1, 0.2, 0.3), position=(1.0, 0.0, 0.0), velocity=(0.4, 0.0, 0.0)),
        *forces, ff.PositionProbe("at", B), ff.EnergyProbe("energy"),
    )  # fmt: skip
    return made


@pytest.mark.slow_on_ranks
def test_a_force_is_the_same_as_in_python() -> None:
    """1e-12: histories differ by round-off alone, by 1e-4 with a wrong sign of any term."""
    found = [
        ff.simulate(model(one), OPTIONS).history
        for one in (force(with_arrays), force(magnet, jacobian="ufl"))
    ]
    for name, values in found[0].items():
        assert np.abs(found[1][name] - values).max() < 1e-12, name


@pytest.mark.serial
def test_derivatives_are_exact() -> None:
    """1e-8: central differences are exact to 1e-10; any wrong column is off by 0.01 and more."""
    law = force(magnet, jacobian="ufl").element_law
    rng = np.random.default_rng(1)
    frame = np.concatenate([rng.normal(size=3), _rotation(rng).ravel()])
    motion = ElementMotion(0.3, frame[np.newaxis, np.newaxis], rng.normal(size=(1, 1, 6)))
    element, z = np.array([0]), np.array([[0.7]])
    found = law.derivatives(element, motion, z)
    assert found is not None
    plain = force(with_arrays).element_law
    wanted = law_derivatives(plain, element, motion, z, np.ones(1))
    assert np.abs(found - wanted).max() < 1e-8


def _rotation(rng: np.random.Generator) -> np.ndarray:
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.asarray(q * np.sign(np.linalg.det(q)))


@pytest.mark.three_ranks
def test_elements_on_ranks() -> None:
    """Drag on three bodies by numbers of their own; 1e-4: error of steps, ways differ by 0.02."""
    made, names = ff.Model("m"), ["a", "b", "c"]
    for k, name in enumerate(names):
        made.add(
            ff.RigidBody(
                name, 1.0, (1.0, 1.0, 1.0), position=(3.0 * k, 0.0, 0.0), velocity=(0.0, 1.0, 0.0)
            ),
            ff.PositionProbe(f"at_{name}", ff.Marker(name)),
        )
    world = MPI.COMM_WORLD
    drags = [[0.5], [1.0], [2.0]]

    def drag(t: Any, ends: Any, z: Any, p: Any) -> Any:
        return [-p[0] * ends.velocities[0]]

    markers = [ff.Marker(name) for name in names]
    made.add(ff.Force("drag", markers, drag, parameters=drags, each=1, jacobian="ufl"))
    found = ff.simulate(made, OPTIONS).history
    for (c,), name in zip(drags, names, strict=True):
        at = world.bcast(float(found[f"at_{name}_y"][-1]) if world.rank == 0 else 0.0)
        assert abs(at - (1.0 - math.exp(-0.4 * c)) / c) < 1e-4


@pytest.mark.serial
def test_springs_and_friction() -> None:
    """As `test_a_force_is_the_same_as_in_python`."""
    found = []
    for one, drag, coefficient in (
        (
            lambda x, v: 80.0 * math.tanh(5.0 * x) + (50.0 * x if x > 0.0 else 10.0 * x),
            lambda x, v, t, p: p[0] * v * v * v * t,
            lambda speed: 0.3 + 0.1 * math.exp(-speed),
        ),
        (
            lambda x, v: (
                80.0 * ufl.tanh(5.0 * x) + ufl.conditional(ufl.gt(x, 0.0), 50.0 * x, 10.0 * x)
            ),
            lambda x, v, t, p: p[0] * v**3 * ufl.as_ufl(t),
            lambda speed: 0.3 + 0.1 * ufl.exp(-speed),
        ),
    ):
        guide = ff.Prismatic("guide", A, B, axis=(1.0, 0.0, 0.0))
        made = model(
            guide,
            ff.SpringDamper("spring", A, B, force=one, rest_length=1.7),
            ff.CustomForce(
                "drag", A, B, axis=(1.0, 0.0, 0.0), motion="translation", force=drag,
                parameters=(0.5,),
            ),
            ff.JointFriction("friction", guide, coefficient=coefficient, velocity=0.1),
        )  # fmt: skip
        found.append(ff.simulate(made, OPTIONS).history)
    for name, values in found[0].items():
        assert np.abs(found[1][name] - values).max() < 1e-12, name


@pytest.mark.serial
def test_the_same_law_is_compiled_once() -> None:
    """However many variables of UFL there were before: the second one takes the first one's file.

    Names with the variables' numbers in them would be found again by no other run.
    """
    modules = {
        UFLFunction.of_vector("energy", lambda x: ufl.cos(x[0]) * x[1], 2)._module.__name__
        for _ in range(2)
    }
    assert len(modules) == 1


def foreign(t: Any, ends: Any, z: Any) -> Any:
    mesh = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
    return [ufl.Constant(mesh) * ends.positions[0]]


@pytest.mark.serial
@pytest.mark.parametrize(
    ("law", "message"),
    [
        (lambda t, ends, z: [ends.positions[0][0]], r"forces of the shape \(1, 3\), got \(1,\)"),
        (lambda t, ends, z: None, r"law must return .*\(1, 3\) for forces, got .None"),
        (lambda t, ends, z: ["pull"], r"UFL expressions of the shape \(1, 3\) for forces, got"),
        (lambda t, ends, z: [np.linalg.norm(ends.nothing)], r"no attribute 'nothing'"),
        (foreign, r"depends on c_\d+, which is none of its arguments"),
    ],
)
def test_mistakes(law: Any, message: str) -> None:
    made = model(ff.Force("f", [A], law, jacobian="ufl"))
    with pytest.raises(ValueError, match=rf'^Force "f": law: .*{message}'):
        ff.simulate(made, OPTIONS)


@pytest.mark.serial
def test_arguments() -> None:
    with pytest.raises(ValueError, match=r'^Force "m": compiled must be False where jacobian'):
        force(magnet, jacobian="ufl", compiled=True)
    with pytest.raises(TypeError, match=r'must be a function of t, ends, z, or "ufl", got'):
        force(magnet, jacobian="sympy")
