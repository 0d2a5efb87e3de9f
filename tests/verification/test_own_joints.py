# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that scripts put together of rows and laws, with the public names alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from tests.histories import columns

COMM = MPI.COMM_WORLD
G, THRUST = 9.81, 400.0
LENGTH = 1.0
SECTION = ff.Section.circle(0.04, ff.Material(2.1e11, 0.3, 7850.0))


def viscous(x: float, v: float, t: float, parameters: tuple[float]) -> float:
    """Torque of friction, N m."""
    (drag,) = parameters
    return drag * v


@dataclass(frozen=True, eq=False)
class Bearing(ff.AxisJoint):
    """Elastic across its axis, with play along it, and a torque of friction about it."""

    radial: float = 1e6
    axial: float = 2e5
    damping: float = 500.0
    play: float = 1e-3
    drag: float = 0.05

    def rows(self, poses: Sequence[ff.Pose], t: float) -> tuple[ff.Row, ...]:
        """See ``Joint.rows``."""
        a, b = poses
        frame = np.linalg.svd(self.direction[np.newaxis])[2]
        p = frame[1]
        turn = ff.Term(
            ff.RowKind.ANGLE, u=a.rotation.T @ self.direction, p=a.rotation.T @ p,
            v=b.rotation.T @ p,
        )  # fmt: skip
        laws = [
            ff.laws.spring(self.axial, self.damping, backlash=self.play),
            *2 * [ff.laws.spring(self.radial, self.damping)],
        ]
        along = [
            ff.Row((ff.Term(ff.RowKind.ALONG, u=a.rotation.T @ u),), law=law)
            for u, law in zip(frame, laws, strict=True)
        ]
        drag = ff.laws.custom(self.owner, viscous, (self.drag,))
        return (*along, ff.Row((turn,), law=drag))


def shaft(omega: float = 0.0, play: float = 1e-3) -> ff.Model:
    """A shaft of two beams in two bearings, under its weight and a thrust along it."""
    ends = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.5 * LENGTH), (0.0, 0.0, LENGTH)]
    mesh = ff.LineMesh.straight({"left": ends[:2], "right": ends[1:]}, elements=4)
    model = ff.Model("shaft", mesh=mesh)
    spin = {"angular_velocity": (0.0, 0.0, omega)} if omega else {}
    for name, end, place in (("left", "start", ends[0]), ("right", "end", ends[2])):
        model.add(ff.Beam(name, SECTION, **spin))
        marker = ff.Marker(name, end)
        model.add(Bearing(f"bearing_{name}", ff.Ground(place), marker, play=play))
        model.add(ff.ReactionProbe(f"load_{name}", f"bearing_{name}"))
        model.add(ff.PositionProbe(f"at_{name}", marker))
    model.add(
        ff.Gravity((0.0, -G, 0.0)),
        ff.Rigid("coupling", ff.Marker("left", "end"), ff.Marker("right", "start")),
        ff.PointForce("thrust", ff.Marker("left", "start"), (0.0, 0.0, THRUST)),
        ff.EnergyProbe("energy"),
    )
    return model


@pytest.mark.three_ranks
def test_loads_and_places_at_rest() -> None:
    weight = SECTION.mass_per_length * LENGTH * G
    model = shaft(play=0.0)  # a slack shaft has no equilibrium to begin with
    axis = (0.0, 0.0, 1.0)  # nothing else holds the shaft's rotation
    hold = ff.Ground(), ff.Marker("left", "start")
    model.add(ff.TorsionalSpringDamper("hold", *hold, axis=axis, stiffness=10.0))
    options = ff.StaticOptions(gravity_load="constant", load_steps=2, quiet=True)
    history = columns(ff.solve_static(model, options))
    found = {name: values[-1] for name, values in history.items()}
    for side in ("left", "right"):
        # half of the weight each; a bearing without its spring lets the shaft fall
        assert abs(found[f"load_{side}_fy"]) == pytest.approx(0.5 * weight, rel=1e-9)
        assert found[f"at_{side}_y"] == pytest.approx(-0.5 * weight / 1e6, rel=1e-9)
    # the thrust is taken by both; the shaft is shorter by some 0.1 um
    moved = np.array([found["at_left_z"], found["at_right_z"] - LENGTH])
    assert moved.mean() == pytest.approx(0.5 * THRUST / 2e5, abs=2e-7)


def test_motions_on_all_ranks_and_after_a_restart(shared_tmp_path: Path) -> None:
    """Energy taken by drag, springs and stops is in the balance; a restart repeats the rest."""
    options: dict[str, Any] = {"dt": 5e-4, "quiet": True, "tolerance": 1e-10, "split_above": 2}
    whole = ff.RunOptions(t_end=0.05, output=shared_tmp_path / "whole", **options)
    found = columns(ff.simulate(shaft(30.0), whole))
    alone = COMM.bcast(
        ff.simulate(shaft(30.0), ff.RunOptions(t_end=0.05, **options), comm=MPI.COMM_SELF).history
    )
    for name, values in found.items():
        scale = max(np.abs(values).max(), 1e-6)
        # reported forces of the start differ by rounding; a row on the wrong rank is another force
        np.testing.assert_allclose(values, alone[name], atol=1e-9 * scale, err_msg=name)
    largest = np.abs(found["energy_kinetic"]).max()
    assert np.abs(found["energy_balance"]).max() < 1e-3 * largest
    half = ff.RunOptions(
        t_end=0.025, output=shared_tmp_path / "half", checkpoint_every=50, **options
    )
    ff.simulate(shaft(30.0), half)
    (file,) = sorted((shared_tmp_path / "half").glob("checkpoint_*.h5"))[-1:]
    rest = ff.RunOptions(t_end=0.05, output=shared_tmp_path / "rest", restart=file, **options)
    again = columns(ff.simulate(shaft(30.0), rest))
    for name in ("at_left_y", "at_right_z", "energy_kinetic"):
        scale = np.abs(found[name]).max()
        np.testing.assert_allclose(again[name][-1], found[name][-1], atol=1e-9 * scale)


@dataclass(frozen=True, eq=False)
class Shaker(ff.AxisJoint):
    """A spring and damper whose rest moves."""

    stiffness: float = 800.0
    damping: float = 5.0
    backlash: float = 0.0

    driven = True

    def rows(self, poses: Sequence[ff.Pose], t: float) -> tuple[ff.Row, ...]:
        """See ``Joint.rows``."""
        a, _ = poses
        law = ff.laws.spring(self.stiffness, self.damping, backlash=self.backlash)
        term = ff.Term(ff.RowKind.ALONG, u=a.rotation.T @ self.direction)
        return (ff.Row((term,), 0.1 * (1.0 - np.cos(15.0 * t)), law),)


def shaken(**shaker: float) -> ff.Model:
    """A mass on the shaker's spring."""
    mass, axis = ff.Marker("mass"), (1.0, 0.0, 0.0)
    model = ff.Model("shaken")
    model.add(
        ff.RigidBody("mass", 2.0, (0.1, 0.1, 0.1)),
        ff.Prismatic("guide", ff.Ground(), mass, axis=axis),
        Shaker("shaker", ff.Ground(), mass, axis=axis, **shaker),
        ff.PositionProbe("at", mass),
    )
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize(
    "integrator",
    ["generalized_alpha", "energy_momentum"],
)
def test_a_drive_works_on_the_spring_that_it_moves(integrator: str) -> None:
    """Against the equation of motion, with the energy that the damper takes as a third unknown."""
    model = shaken()
    model.add(ff.EnergyProbe("energy"))
    options = ff.RunOptions(dt=5e-4, t_end=0.5, quiet=True, integrator=integrator)
    found = columns(ff.simulate(model, options))

    def rates(t: float, state: np.ndarray) -> list[float]:
        x, v, _ = state
        force = 800.0 * (x - 0.1 * (1.0 - np.cos(15.0 * t))) + 5.0 * v
        return [v, -force / 2.0, 5.0 * v**2]

    exact = solve_ivp(rates, (0.0, 0.5), np.zeros(3), rtol=1e-10, atol=1e-12).y[:, -1]
    assert found["at_x"][-1] == pytest.approx(exact[0], abs=4e-5)
    assert found["energy_dissipation"][-1] == pytest.approx(exact[2], rel=1e-3)
    # the spring's own energy counted as work once more is off by 13 J
    assert np.abs(found["energy_balance"]).max() < 1e-4


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("shaker", [{}, {"damping": 0.0}, {"damping": 0.0, "backlash": 0.01}])
def test_no_spurious_energy_is_seen_without_a_probe(shaker: dict[str, float]) -> None:
    outcome = ff.simulate(shaken(**shaker), ff.RunOptions(dt=5e-4, t_end=0.5, quiet=True))
    assert outcome.status == "ok"
    assert not [line for line in outcome.summary["warnings"] if "energy" in line]


@dataclass(frozen=True, eq=False)
class Pusher(ff.Joint):
    """Soft across, and a drive of constant acceleration along x: the first row is no equation."""

    driven = True

    def rows(self, poses: Sequence[ff.Pose], t: float) -> tuple[ff.Row, ...]:
        """See ``Joint.rows``."""
        a, _ = poses
        x, y, _ = a.rotation.T @ np.eye(3)
        across = ff.Row((ff.Term(ff.RowKind.ALONG, u=y),), law=ff.laws.spring(100.0))
        return across, ff.Row((ff.Term(ff.RowKind.ALONG, u=x),), 0.4 * t + 1.5 * t**2)


@pytest.mark.three_ranks
def test_a_drive_behind_a_spring_in_one_joint() -> None:
    mass = ff.Marker("mass")
    model = ff.Model("pushed")
    model.add(
        ff.RigidBody("mass", 2.0, (0.1, 0.1, 0.1)),
        Pusher("pusher", ff.Ground(), mass),
        ff.Probe("speed", mass, ["speed"], lambda t, s: [s.velocity[0]]),
        ff.ReactionProbe("force", "pusher"),
    )
    found = columns(ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=0.1, quiet=True)))
    # a drive whose rates are not seen leaves the start at rest, and reports no force there
    np.testing.assert_allclose(found["speed"], 0.4 + 3.0 * found["t"], atol=1e-9)
    np.testing.assert_allclose(np.abs(found["force_fx"]), 2.0 * 3.0, atol=1e-6)
