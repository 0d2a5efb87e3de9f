# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion in a vector of coordinates: order, constraints, output, restart, failure."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse

import flexfem as ff
from flexfem._checks import InputError
from flexfem.io.tables.history import read_history
from flexfem.lie import so3
from flexfem.research.equations.run.simulate import simulate_equations
from flexfem.research.equations.vector_equations import DRIVER, Motion, Picture, VectorEquations

GRAVITY = 9.81


class Source:
    """A source of given equations."""

    drivers = {"dynamics": DRIVER}  # noqa: RUF012

    def __init__(self, make: Callable[[], VectorEquations]) -> None:
        self._make = make

    def validate(self) -> None: ...

    def equations(self, comm: Any) -> VectorEquations:
        return self._make()


class Oscillator(VectorEquations):
    """Two masses with springs and a damper, driven; the exact answer is known."""

    size, linear, columns = 2, True, ("x", "y")
    M = np.diag([1.0, 2.0])
    K = np.array([[40.0, -10.0], [-10.0, 30.0]])
    C = 0.02 * K

    def start(self) -> tuple[Any, Any]:
        return np.array([1.0, -0.5]), np.array([0.0, 2.0])

    def residual(self, t: float, q: Any, v: Any, a: Any, multipliers: Any) -> Any:
        return self.M @ a + self.C @ v + self.K @ q - np.array([np.sin(3.0 * t), 0.0])

    def tangent(self, t: float, q: Any, v: Any, a: Any, multipliers: Any, dv: Any, da: Any) -> Any:
        return self.K + dv * self.C + da * self.M

    def observe(self, motion: Motion) -> Any:
        return motion.q

    def exact(self, t: float) -> Any:
        """Matrix exponential of the first-order form with the drive as two more unknowns."""
        from scipy.linalg import expm

        a = np.zeros((6, 6))
        a[:2, 2:4] = np.eye(2)
        a[2:4, :2], a[2:4, 2:4] = -np.linalg.solve(self.M, self.K), -np.linalg.solve(self.M, self.C)
        a[2, 4] = 1.0
        a[4, 5], a[5, 4] = 3.0, -3.0
        q, v = self.start()
        return (expm(a * t) @ np.concatenate([q, v, [0.0, 1.0]]))[:2]


class Pendulum(VectorEquations):
    """Point mass at distance one from the origin: two coordinates, one multiplier."""

    size, multipliers, columns, angles = 2, 1, ("angle", "tension", "energy"), ("angle",)

    def __init__(self, sparse: bool = False, end: float = np.inf, speed: float = 8.0) -> None:
        self.sparse, self.end, self.speed = sparse, end, speed

    def start(self) -> tuple[Any, Any]:
        return np.array([0.0, -1.0]), np.array([self.speed, 0.0])

    def residual(self, t: float, q: Any, v: Any, a: Any, multipliers: Any) -> Any:
        if t > self.end:
            return np.full(3, np.nan)
        forces = a + [0.0, GRAVITY] + 2.0 * multipliers[0] * q
        return np.concatenate([forces, [q @ q - 1.0]])

    def tangent(self, t: float, q: Any, v: Any, a: Any, multipliers: Any, dv: Any, da: Any) -> Any:
        out = np.zeros((3, 3))
        out[:2, :2] = (da + 2.0 * multipliers[0]) * np.eye(2)
        out[:2, 2] = out[2, :2] = 2.0 * q
        return scipy.sparse.csr_matrix(out) if self.sparse else out

    def pictures(self, motion: Motion) -> Any:
        points = np.array([[0.0, 0.0, 0.0], [*motion.q, 0.0]])
        return {"rod": Picture(points, np.array([[0, 1]]), "line", {"u": points})}

    def observe(self, motion: Motion) -> Any:
        q, v = motion.q, motion.v
        energy = 0.5 * v @ v + GRAVITY * q[1]
        return np.arctan2(q[0], -q[1]), 2.0 * motion.multipliers[0], energy


class Top(VectorEquations):
    """Free rigid body: the increments of its rotation are no coordinates."""

    size, columns = 3, ("lx", "ly", "lz")
    inertia = np.array([1.0, 2.0, 3.0])

    def start(self) -> tuple[Any, Any]:
        return np.eye(3).reshape(-1), np.array([0.1, 4.0, 0.2])

    def add(self, q: Any, increment: Any) -> Any:
        return (q.reshape(3, 3) @ so3.exp(increment)).reshape(-1)

    def residual(self, t: float, q: Any, v: Any, a: Any, multipliers: Any) -> Any:
        return self.inertia * a + np.cross(v, self.inertia * v)

    def tangent(self, t: float, q: Any, v: Any, a: Any, multipliers: Any, dv: Any, da: Any) -> Any:
        j = np.diag(self.inertia)
        return da * j + dv * (so3.skew(v) @ j - so3.skew(self.inertia * v))

    def observe(self, motion: Motion) -> Any:
        return motion.q.reshape(3, 3) @ (self.inertia * motion.v)


def run(make: Callable[[], VectorEquations], **options: Any) -> Any:
    return simulate_equations(Source(make), ff.RunOptions(quiet=True, **options))


def test_linear_equations_are_solved_to_second_order_with_one_iteration_a_step() -> None:
    errors = []
    for dt in (0.02, 0.01):
        out = run(Oscillator, dt=dt, t_end=1.0, rho_inf=0.6)
        assert out.summary["newton_iterations"] == out.summary["steps"]
        if out.history:
            tip = [out.history["x"][-1], out.history["y"][-1]]
            errors.append(np.abs(tip - Oscillator().exact(1.0)).max())
    if errors:
        # first order would give 2; an inconsistent initial acceleration a larger error
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
        assert errors[1] < 2e-3


@pytest.mark.parametrize(
    "matrix", ["auto", pytest.param("frozen", marks=pytest.mark.serial), "updated"]
)
def test_constraints_hold_and_multipliers_are_those_of_the_pendulum(matrix: str) -> None:
    out = run(
        lambda: Pendulum(sparse=matrix == "auto"), dt=2e-3, t_end=1.5, iteration_matrix=matrix,
        tolerance=1e-10,
    )  # fmt: skip
    assert out.status == "ok"
    if matrix == "updated":
        assert out.summary["newton_iterations"] < 4 * out.summary["steps"]
    if out.history:
        angle, tension = out.history["angle"], out.history["tension"]
        assert angle[-1] > 3.0 * np.pi  # more than a turn: within [-pi, pi] if not continued
        # rope: m g cos + m v^2 / l with v^2 from the energy; lost multipliers are off by much more
        speed2 = 64.0 - 2.0 * GRAVITY * (1.0 - np.cos(angle))
        assert np.allclose(tension, speed2 + GRAVITY * np.cos(angle), atol=0.02 * 73.8)
        assert tension[0] == pytest.approx(64.0 + GRAVITY, rel=1e-4)


def test_rotations_as_coordinates() -> None:
    momenta = []
    for dt in (0.02, 0.01):
        out = run(Top, dt=dt, t_end=4.0, rho_inf=1.0)
        if out.history:
            h = out.history
            drift = [h[c] - h[c][0] for c in ("lx", "ly", "lz")]
            momenta.append(np.abs(drift).max())
    if momenta:
        # 8 N m s that turns about an unstable axis: second order, off by O(1) if turned wrongly
        assert momenta[1] < 0.02
        assert 3.0 < momenta[0] / momenta[1] < 5.0


@pytest.mark.three_ranks
def test_restart_goes_on_as_if_nothing_had_been(shared_tmp_path: Path) -> None:
    common: dict[str, Any] = {"dt": 5e-3, "iteration_matrix": "updated"}
    whole = run(Pendulum, t_end=0.2, output=shared_tmp_path / "whole", **common)
    folder = shared_tmp_path / "parts"
    run(Pendulum, t_end=0.1, output=folder, checkpoint_every=20, **common)
    restart = folder / "checkpoint_000020.h5"
    with pytest.raises(InputError, match="other equations"):
        run(Top, t_end=0.2, restart=restart, **common)
    again = run(Pendulum, t_end=0.2, output=folder, restart=restart, **common)
    assert again.summary["restarted_at_step"] == 20
    assert again.summary["steps"] == whole.summary["steps"] == 40
    if not again.history:
        return
    a, b = (
        read_history(shared_tmp_path / "whole" / "history.csv"),
        read_history(folder / "history.csv"),
    )
    assert len(b["t"]) == 41
    for name, values in a.items():
        assert np.array_equal(values, b[name]), name
    assert (folder / "rod.pvd").read_text() == (shared_tmp_path / "whole/rod.pvd").read_text()
    assert (folder / "rod.pvd").read_text().count("timestep") == 5


@pytest.mark.three_ranks
def test_failure_keeps_what_was_computed(shared_tmp_path: Path) -> None:
    out = run(lambda: Pendulum(end=0.101), dt=0.01, t_end=0.2, output=shared_tmp_path)
    # the last half of a step that still works is 0.100 to 0.10094
    assert "at t = 0.1" in out.status
    if not out.history:
        return  # the first rank may still be writing
    summary = json.loads((shared_tmp_path / "summary.json").read_text())
    assert summary["status"] == out.status
    # the step, its halves and theirs down to the sixth, each of which fails once at the end
    assert summary["rejected_steps"] == 7
    table = read_history(shared_tmp_path / "history.csv")
    assert table["t"][-1] == pytest.approx(0.1)
    assert list(shared_tmp_path.glob("checkpoint_*.h5"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"integrator": "energy_momentum"}, "integrator 'energy_momentum'"),
        ({"adaptive": True}, "adaptive True"),
        ({"start": "equilibrium"}, "start 'equilibrium'"),
        ({"iteration_matrix": "material"}, "iteration_matrix 'material'"),
    ],
)
def test_options_without_meaning_are_refused(options: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(Oscillator, dt=0.1, t_end=1.0, **options)


@pytest.mark.three_ranks
def test_inconsistent_start_is_refused() -> None:
    class Off(Pendulum):
        def start(self) -> tuple[Any, Any]:
            return np.array([0.0, -1.1]), np.zeros(2)

    class Fast(Pendulum):
        def start(self) -> tuple[Any, Any]:
            return np.array([0.0, -1.0]), np.array([0.0, 1.0])

    with pytest.raises(InputError, match=r"constraint 0 of the equations is 0.21 at the start"):
        run(Off, dt=0.1, t_end=1.0)
    with pytest.raises(InputError, match="rate of constraint 0 of the equations is -2"):
        run(Fast, dt=0.1, t_end=1.0)
