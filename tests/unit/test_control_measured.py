# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers that read joint forces, strains, momenta and energies."""

import shutil
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
Z = (0.0, 0.0, 1.0)
HEARD: list[np.ndarray] = []


def _train(controller: ff.Controller) -> ff.Model:
    """Two cars, 2 and 1 kg, coupled rigidly; a motor pushes the first one."""
    first, second = ff.Marker("first"), ff.Marker("second", offset=(-1.0, 0.0, 0.0))
    model = ff.Model("train")
    model.add(
        ff.RigidBody("first", 2.0, (0.1, 0.1, 0.1)),
        ff.RigidBody("second", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.Prismatic("rail", ff.Ground(), first, axis=(1.0, 0.0, 0.0)),
        ff.Rigid("coupling", first, second),
        ff.Actuator("motor", ff.Ground(), first, axis=(1.0, 0.0, 0.0), motion="translation"),
        ff.ReactionProbe("pull", "coupling"),
        controller,
    )
    return model


@pytest.mark.serial
def test_a_joint_force_is_that_at_the_end_of_the_step():
    """The coupling pulls by a third of the motor's force, of which the law adds 1.5 to 10 N."""
    law = lambda t, y: 10.0 + 1.5 * y[0]  # noqa: E731
    model = _train(ff.Controller("law", ["pull_fx"], ["motor"], law, sample_time=0.01))
    history = ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.1, quiet=True)).history
    # u_k = 10 + 1.5 u_(k-1) / 3, from no force before the start
    expected = 20.0 * (1.0 - 0.5 ** np.arange(1, 12))
    # a force that is a step older, or not measured, would miss 15 N after the first step by 5 N
    assert history["law_motor"] == pytest.approx(expected, rel=1e-9)
    assert history["pull_fx"][1:] == pytest.approx(expected[:-1] / 3.0, rel=1e-9)


@pytest.mark.serial
def test_continuous_laws_read_what_follows_from_the_motion():
    """Momentum is mass times velocity, as a function of a marker says as well."""
    outcomes = []
    for measured in ("all_px", "px"):
        law = ff.Controller("drag", [measured], ["push"], lambda t, y: 1.0 - 4.0 * y[0])
        ball = ff.Marker("ball")
        model = ff.Model("ball")
        model.add(
            ff.RigidBody("ball", 2.0, (0.1, 0.1, 0.1)),
            ff.PointForce("push", ball, (1.0, 0.0, 0.0)),
            ff.MomentumProbe("all"),
            ff.Probe("by_marker", ball, ["px"], lambda t, at: [2.0 * at.velocity[0]]),
            law,
        )
        outcomes.append(ff.simulate(model, ff.RunOptions(dt=0.02, t_end=1.0, quiet=True)))
    first, second = (outcome.history["px"] for outcome in outcomes)
    # momenta of the step before, not extrapolated, would change the first digits
    assert first == pytest.approx(second, rel=1e-12)
    # p' = 1 - 4 p
    assert first[-1] == pytest.approx(0.25 * (1.0 - np.exp(-4.0)), rel=2e-3)


class Listener:
    """Feeds back curvature and a joint force, and notes all that it gets."""

    def __init__(self) -> None:
        self.state = np.zeros(2)

    def update(self, t: float, y: np.ndarray) -> np.ndarray:
        HEARD.append(np.array([t, *y]))
        self.state = 0.5 * self.state + 0.5 * y[:2]
        return np.array([-3.0 - 2.0 * self.state[0], 0.1 * self.state[1] - 1e-3 * y[2]])


MEASURED = ["root_kappa3", "elbow_force_fy", "energy_work", "both_lz", "elbow_force", "angle"]


def _arms() -> ff.Model:
    """Two flexible arms in series with motors, which are driven by what is measured inside."""
    points = {"upper": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "fore": [(1.0, 0, 0), (2.0, 0, 0)]}
    model = ff.Model("arms", mesh=ff.LineMesh.straight(points, elements=3))
    section = ff.Section.rectangle(0.03, 0.02, ff.Material(2.1e9, 0.3, 7850.0))
    root, elbow, fore = (
        ff.Marker("upper", "start"),
        ff.Marker("upper", "end"),
        ff.Marker("fore", "start"),
    )
    model.add(
        ff.Beam("upper", section),
        ff.Beam("fore", section),
        ff.Revolute("shoulder", ff.Ground(), root, axis=Z),
        ff.Revolute("elbow", elbow, fore, axis=Z),
        ff.Actuator("first", ff.Ground(), root, axis=Z),
        ff.Actuator("second", elbow, fore, axis=Z, force=lambda t: 2.0 * t),
        ff.StrainProbe("root", "upper", 0.0),
        ff.ReactionProbe("elbow_force", "elbow"),
        ff.EnergyProbe(),
        ff.MomentumProbe("both"),
        ff.Probe("turn", root, ["angle"], lambda t, at: [at.rotation[1, 0]]),
        ff.Controller("listener", MEASURED, ["first", "second"], Listener(), 0.01),
        ff.Controller("continuous", ["root_kappa3"], ["push"], lambda t, y: -y[0]),
        ff.PointForce("push", ff.Marker("fore", "end"), (0.0, 1.0, 0.0)),
    )
    return model


@pytest.mark.three_ranks
def test_laws_hear_what_the_history_shows_on_all_ranks():
    options = ff.RunOptions(dt=0.005, t_end=0.1, quiet=True)
    HEARD.clear()
    spread = ff.simulate(_arms(), options)
    assert spread.status == "ok"
    assert len(HEARD) == (11 if COMM.rank == 0 else 0)
    heard = np.array(HEARD)
    alone = ff.simulate(_arms(), options, comm=MPI.COMM_SELF)
    if COMM.rank:
        return
    force = [f"elbow_force_{c}" for c in ("fx", "fy", "fz", "mx", "my", "mz")]
    columns = ["t", *MEASURED[:4], *force, "angle"]
    for column, name in zip(heard.T, columns, strict=True):
        shown = spread.history[name][::2]
        # those of the step before would differ in the first digits
        error = np.abs(column - shown)[1:].max()  # at the start outputs do not act yet
        assert error <= 1e-12 * np.abs(shown).max(), name
    for name, column in alone.history.items():
        largest = max(np.abs(column).max(), 1e-3)
        # a rank's share that is missing or counts twice would change the first digits
        assert np.abs(spread.history[name] - column).max() < 1e-9 * largest, name
    assert np.abs(alone.history["root_kappa3"]).max() > 1e-2
    assert np.abs(alone.history["elbow_force_fy"]).max() > 0.1


def test_restart_goes_on_with_what_was_measured(shared_tmp_path):
    common: dict[str, Any] = {"dt": 0.005, "quiet": True, "checkpoint_every": 7}
    whole = ff.simulate(_arms(), ff.RunOptions(t_end=0.07, **common))
    first, second = shared_tmp_path / "a", shared_tmp_path / "b"
    ff.simulate(_arms(), ff.RunOptions(t_end=0.035, output=first, **common))
    if COMM.rank == 0:
        shutil.copytree(first, second)
    COMM.Barrier()
    file = first / "checkpoint_000007.h5"
    resumed = ff.simulate(_arms(), ff.RunOptions(t_end=0.07, output=second, restart=file, **common))
    if COMM.rank == 0:
        for name, column in whole.history.items():
            # energies that start again, or an extrapolation without its past, change first digits
            largest = max(np.abs(column).max(), 1e-3)
            assert np.abs(resumed.history[name] - column).max() < 1e-11 * largest, name


@pytest.mark.serial
def test_continuous_laws_cannot_read_joint_forces():
    """They would follow the output at once."""
    model = _train(ff.Controller("law", ["pull"], ["motor"], lambda t, y: 0.0))
    with pytest.raises(ValueError, match=r'"pull" of ReactionProbe "pull" .* give .* sample_time'):
        model.validate()
