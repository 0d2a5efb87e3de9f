# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces by laws of users, with states of their own, against springs and closed forms."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import expm

import flexfem as ff
from flexfem.constraints.elements.differences import law_derivatives
from flexfem.core.laws import ElementMotion
from flexfem.lie import so3
from tests.histories import columns

STIFFNESS, DAMPING, REST = 400.0, 3.0, 0.4
#: A hydraulic cylinder between a mass and the ground: oil on both sides of its piston.
MASS, AREA, BULK, VOLUME, LEAK = 2000.0, 5e-3, 1.2e9, 1e-3, 2e-12
FLOW = 1e-3


def spring(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    """A spring and damper between every two markers."""
    arm = ends.positions[1::2] - ends.positions[::2]
    length = np.sqrt((arm**2).sum(axis=1))
    along = arm / length[:, np.newaxis]
    rate = ((ends.velocities[1::2] - ends.velocities[::2]) * along).sum(axis=1)
    pull = (STIFFNESS * (length - REST) + DAMPING * rate)[:, np.newaxis] * along
    return np.stack([pull, -pull], axis=1).reshape(-1, 3)


def spring_slopes(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    """Its derivatives by positions and velocities of both markers."""
    arm = ends.positions[1::2] - ends.positions[::2]
    length = np.sqrt((arm**2).sum(axis=1))[:, np.newaxis, np.newaxis]
    along = arm[:, :, np.newaxis] / length
    outer = along @ along.transpose(0, 2, 1)
    across = (np.eye(3) - outer) / length
    moving = (ends.velocities[1::2] - ends.velocities[::2])[:, :, np.newaxis]
    rate = along.transpose(0, 2, 1) @ moving
    by_place = STIFFNESS * outer + (STIFFNESS * (length - REST) + DAMPING * rate) * across
    by_place = by_place + DAMPING * along @ moving.transpose(0, 2, 1) @ across
    out = np.zeros((len(arm), 12, 24))
    for row, column in np.ndindex(2, 2):
        sign = 1.0 if row != column else -1.0
        rows = slice(6 * row, 6 * row + 3)
        out[:, rows, 12 * column : 12 * column + 3] = sign * by_place
        out[:, rows, 12 * column + 6 : 12 * column + 9] = sign * DAMPING * outer
    return out


def frame(springs: bool, **options: Any) -> ff.Model:
    """Two beams, a body, and springs between all, also inside an element of a beam."""
    lines = {f"beam{k}": [(0.0, float(k), 0.0), (1.0, float(k), 0.0)] for k in (0, 1)}
    section = ff.Section.circle(0.03, ff.Material(2e8, 0.3, 2000.0))
    model = ff.Model("frame", mesh=ff.LineMesh.straight(lines, 3))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for k, name in enumerate(lines):
        model.add(ff.Beam(name, section, orientation=(0.0, 1.0, 0.0)))
        model.add(ff.Rigid(f"clamp{k}", ff.Ground((0.0, k, 0.0)), ff.Marker(name, "start")))
    inertia = (1e-3, 2e-3, 2e-3)
    model.add(ff.RigidBody("load", 0.3, inertia, position=(1.2, 0.5, 0.3)))
    places = [(0.0, -0.1, 0.0), (0.0, 0.1, 0.0), (0.1, 0.0, 0.05), (0.1, 0.05, 0.0),
              (-0.1, 0.0, 0.1), (0.0, 0.0, -0.1)]  # fmt: skip
    corners = [ff.Marker("load", offset=place) for place in places]
    others = [ff.Marker("beam0", 0.55), ff.Marker("beam1", "end")]
    others += [ff.Ground(x) for x in ((1.5, 0.5, 0.6), (1.5, 0.9, 0.8), (0.9, 0.4, 0.8),
                                      (1.3, 0.4, -0.3))]  # fmt: skip
    pairs = list(zip(others, corners, strict=True))
    if springs:
        for k, (a, b) in enumerate(pairs):
            own = {"stiffness": STIFFNESS, "damping": DAMPING, "rest_length": REST}
            model.add(ff.SpringDamper(f"spring{k}", a, b, **own))
    else:
        ends = [marker for pair in pairs for marker in pair]
        model.add(ff.Force("springs", ends, spring, each=2, **options))
    model.add(ff.PositionProbe("at", ff.Marker("load")), ff.PositionProbe("tip", pairs[0][0]))
    model.add(ff.EnergyProbe(), ff.ReactionProbe("held", "clamp0"))
    return model


#: Columns that springs and forces share; what springs store is work of a force.
SHARED = [f"{name}_{axis}" for name in ("at", "tip") for axis in "xyz"] + ["held_fx", "held_fz"]


def assert_alike(found: Any, wanted: Any, tolerance: float) -> None:
    for name in SHARED:
        scale = np.abs(wanted[name]).max()
        np.testing.assert_allclose(found[name], wanted[name], atol=tolerance * scale, err_msg=name)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "integrator",
    ["generalized_alpha", pytest.param("stabilized_index2", marks=pytest.mark.slow)],
)
def test_springs_as_forces_move_as_springs(integrator: str) -> None:
    """On all ranks as on one, and with derivatives of the user's as with differences.

    Both solve the same equations to the tolerance. A force that were taken from the last step, or
    a damper left out, would move the load by 1e-3 of its way.
    """
    options = ff.RunOptions(dt=5e-3, t_end=0.1, tolerance=1e-10, integrator=integrator, quiet=True)
    wanted = columns(ff.simulate(frame(springs=True), options))
    found = columns(ff.simulate(frame(springs=False), options))
    assert_alike(found, wanted, 1e-8)
    assert_alike(columns(ff.simulate(frame(False, jacobian=spring_slopes), options)), found, 1e-9)
    alone = ff.simulate(frame(springs=False), options, comm=MPI.COMM_SELF).history
    assert_alike(found, alone, 1e-9)
    # of second order in a step that is coarse for the beams; work of the wrong sign doubles it
    largest = np.abs(found["energy_work"]).max()
    assert np.abs(found["energy_balance"]).max() < 0.02 * largest


@pytest.mark.serial
def test_derivatives_of_users_are_those_of_differences() -> None:
    """At a state where all turn and move; a wrong sign of a part is off by its whole size."""
    rng = np.random.default_rng(4)
    ends = [ff.Marker("a"), ff.Marker("b")]
    own = ff.Force("f", ends, spring, jacobian=spring_slopes).element_law
    law = ff.Force("f", ends, spring).element_law
    turns = so3.exp(rng.normal(size=(2, 3)))
    poses = np.concatenate([rng.normal(size=(2, 3)), turns.reshape(2, 9)], axis=1)[np.newaxis]
    motion = ElementMotion(0.0, poses, rng.normal(size=(1, 2, 6)))
    given = (np.zeros(1, dtype=np.int64), motion, np.zeros((1, 0)))
    wanted = law_derivatives(law, *given, np.zeros(0))
    np.testing.assert_allclose(law_derivatives(own, *given, np.zeros(0)), wanted, atol=1e-5)


@pytest.mark.slow_on_ranks
def test_statics() -> None:
    """It finds where springs hold the load, which a force without stiffness would not."""
    options = ff.StaticOptions(load_steps=1, stabilise=True, quiet=True)
    wanted = columns(ff.solve_static(frame(springs=True), options))
    assert_alike(columns(ff.solve_static(frame(springs=False), options)), wanted, 1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_relaxation() -> None:
    """It finds the same place."""
    options = ff.StaticOptions(load_steps=1, stabilise=True, quiet=True)
    wanted = columns(ff.solve_static(frame(springs=True), options))
    relaxed = columns(ff.relax(frame(springs=False), ff.RelaxationOptions(quiet=True)))
    for name in SHARED[:6]:
        # the tolerance of relaxation; without the force at rest the load falls for ever
        assert relaxed[name][-1] == pytest.approx(wanted[name][-1], abs=1e-4)


@pytest.mark.parametrize(
    "start",
    [
        pytest.param("rest", marks=pytest.mark.three_ranks),
        pytest.param("equilibrium", marks=pytest.mark.serial),
    ],
)
def test_modes(start: str) -> None:
    """Frequencies and damping; a stiffness or damper left out changes them by more than 1 %."""
    options = ff.ModeOptions(modes=6, start=start, quiet=True)
    wanted = ff.find_modes(frame(springs=True), options)
    found = ff.find_modes(frame(springs=False), options)
    assert found.status == wanted.status == "ok"
    np.testing.assert_allclose(found.modes.eigenvalues, wanted.modes.eigenvalues, rtol=1e-6)


def ram(t: float, ends: ff.Ends, z: np.ndarray, parameters: np.ndarray) -> Any:
    """Pressures on both sides of the piston: their rates by the flow, the motion and a leak."""
    arm = ends.positions[1] - ends.positions[0]
    along = arm / np.linalg.norm(arm)
    rate = (ends.velocities[1] - ends.velocities[0]) @ along
    push = AREA * (z[0] - z[1]) * along
    flow = parameters[0] - AREA * rate - LEAK * (z[0] - z[1])
    return np.stack((-push, push)), None, BULK / VOLUME * np.array([flow, -flow])


def cylinder(flow: float = FLOW, **options: Any) -> ff.Model:
    """A mass on a guide that a cylinder pushes."""
    model = ff.Model("cylinder")
    body = ff.Marker("mass")
    given = {"states": 2, "initial": (5e5, 5e5), "parameters": (flow,)} | options
    model.add(
        ff.RigidBody("mass", MASS, (10.0, 10.0, 10.0), position=(1.0, 0.0, 0.0)),
        ff.Prismatic("guide", ff.Ground(), body, axis=(1.0, 0.0, 0.0)),
        ff.Force("ram", [ff.Ground(), body], ram, **given),
        ff.PositionProbe("at", body), ff.EnergyProbe(), ff.ReactionProbe("push", "ram"),
    )  # fmt: skip
    return model


def exact_place(t: np.ndarray) -> np.ndarray:
    """Place of the mass by the matrix exponential, the flow beginning at t = 0."""
    stiff = BULK / VOLUME
    A = np.zeros((4, 4))
    A[0, 1], A[1, 2] = 1.0, AREA / MASS
    A[2, 1:] = -2.0 * stiff * AREA, -2.0 * stiff * LEAK, 2.0 * stiff * FLOW
    return np.array([1.0 + (expm(A * time) @ (0.0, 0.0, 0.0, 1.0))[0] for time in t])


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize(
    "integrator",
    ["generalized_alpha", pytest.param("independent_coordinates", marks=pytest.mark.slow)],
)
def test_a_hydraulic_cylinder_is_stiff(integrator: str) -> None:
    """With steps that resolve its vibration of 173 rad/s, and with ones that do not.

    An explicit force makes a step of 5 ms grow without bound. Errors fall with the square of the
    step: by 4 where it is half.
    """
    gaps = []
    for dt in (5e-3, 1e-3, 5e-4):
        options = ff.RunOptions(dt=dt, t_end=0.1, integrator=integrator, quiet=True)
        found = columns(ff.simulate(cylinder(), options))
        gaps.append(np.abs(found["at_x"] - exact_place(found["t"])).max())
    assert gaps[0] < 2e-3  # of a way of 20 mm, with a vibration of 1.2 mm
    assert 3.2 < gaps[1] / gaps[2] < 4.8


def test_its_vibration_is_a_mode() -> None:
    """States are unknowns of the linearised equations: ``sqrt(2 B A^2 / (V m))`` and a leak."""
    square, loss = 2.0 * BULK * AREA**2 / (VOLUME * MASS), 2.0 * BULK * LEAK / VOLUME
    wanted = -0.5 * loss + 1j * np.sqrt(square - 0.25 * loss**2)
    found = ff.find_modes(cylinder(0.0), ff.ModeOptions(modes=2, quiet=True))
    assert found.status == "ok"
    # round-off; with pressures that stay as they are there is no vibration at all
    assert found.modes.eigenvalues[-1] == pytest.approx(wanted, rel=1e-7)
    poles = ff.linearize(cylinder(0.0), ff.LinearOptions()).poles
    assert np.abs(poles - wanted).min() < 1e-7 * abs(wanted)


def test_states_are_steady_in_equilibrium() -> None:
    """A load takes the pressures that carry it, by a leak that feeds on a pump."""

    def law(t: float, ends: ff.Ends, z: np.ndarray) -> Any:
        force = np.zeros((1, 3))
        force[0, 0] = AREA * z[0] - 1e4 * (ends.positions[0, 0] - 1.0)
        return force, None, BULK / VOLUME * np.array([FLOW - 1e-9 * z[0]])

    model = ff.Model("held")
    body = ff.Marker("mass")
    model.add(
        ff.RigidBody("mass", MASS, (10.0, 10.0, 10.0), position=(1.0, 0.0, 0.0)),
        ff.Prismatic("guide", ff.Ground(), body, axis=(1.0, 0.0, 0.0)),
        ff.Force("ram", [body], law, states=1), ff.PositionProbe("at", body),
    )  # fmt: skip
    rest = 1.0 + AREA * FLOW / 1e-9 / 1e4
    options = ff.StaticOptions(load_steps=1, quiet=True)
    found = columns(ff.solve_static(model, options))
    assert found["at_x"][-1] == pytest.approx(rest, rel=1e-9)
    # a motion that starts there stays there: 1e-2 m with pressures that begin at zero
    run = ff.RunOptions(dt=2e-3, t_end=0.1, start="equilibrium", quiet=True)
    assert np.abs(columns(ff.simulate(model, run))["at_x"] - rest).max() < 1e-7


def test_restart(shared_tmp_path: Path) -> None:
    """States, and the derivatives that steps use, are in checkpoints."""
    options: dict[str, Any] = {"dt": 1e-3, "quiet": True}
    whole = columns(ff.simulate(cylinder(), ff.RunOptions(t_end=0.04, **options)))
    first = ff.RunOptions(t_end=0.02, output=shared_tmp_path, checkpoint_every=20, **options)
    ff.simulate(cylinder(), first)
    file = shared_tmp_path / "checkpoint_000020.h5"
    rest = columns(ff.simulate(cylinder(), ff.RunOptions(t_end=0.04, restart=file, **options)))
    for name in ("at_x", "push_fx", "energy_work"):
        # the same numbers; without the states the mass would begin to vibrate by 1 mm
        np.testing.assert_allclose(rest[name][-20:], whole[name][-20:], rtol=1e-11)


@pytest.mark.serial
def test_explicit_forces_act_a_step_late() -> None:
    """A soft spring by accepted states: its error is of first order in the step."""
    ends = [ff.Ground(), ff.Marker("mass")]
    gaps = {}
    for every in ("iteration", "step"):
        model = ff.Model("soft")
        model.add(ff.RigidBody("mass", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0)))
        model.add(ff.Force("pull", ends, soft, every=every), ff.PositionProbe("at", ends[1]))
        found = columns(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.5, quiet=True)))
        gaps[every] = np.abs(found["at_x"] - np.cos(found["t"])).max()
    assert gaps["iteration"] < 1e-6
    assert 1e-5 < gaps["step"] < 1e-3


def soft(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    """A linear spring of 1 N/m to the origin on the second marker."""
    return np.stack((ends.positions[1], -ends.positions[1]))


@pytest.mark.serial
def test_compiled_laws_are_the_same() -> None:
    ends, places = [ff.Ground(), ff.Marker("mass")], []
    for compiled in (False, True):
        model = ff.Model("soft")
        model.add(ff.RigidBody("mass", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0)))
        model.add(ff.Force("pull", ends, soft, compiled=compiled), ff.PositionProbe("at", ends[1]))
        places.append(ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=0.1, quiet=True)).history)
    np.testing.assert_allclose(places[1]["at_x"], places[0]["at_x"], rtol=1e-13)
