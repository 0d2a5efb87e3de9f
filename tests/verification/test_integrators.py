# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrators against closed forms and references: orders, constraints, error control."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.status import Status
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.simulation.dynamics import simulate
from flexfem.simulation.motion.stepping import Simulation
from tests.contract.joint_examples import spatial_slider_crank

ROOT = Path(__file__).parents[2]


def _case(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "cases" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _table(name: str) -> dict[str, np.ndarray]:
    lines = (ROOT / "tests" / "data" / f"{name}.csv").read_text().splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    values = np.array([line.split(",") for line in lines[1:]], dtype=float)
    return dict(zip(lines[0].split(","), values.T, strict=True))


def _columns(table, names: str, prefix: str = "") -> np.ndarray:
    return np.stack([table[prefix + name] for name in names.split()], axis=1)


def _rates(simulation: Simulation) -> float:
    """Largest rate of a row at the accepted state, drives held."""
    rows = simulation.system.constraints
    simulation.system.interface.update()
    rows.evaluate(np.array([1.0, 1.0]))
    return float(np.abs(rows.rates()).max())


class _InertialBlock(FrameBlock):
    """Rigid bodies on R^3 x SO(3)."""

    def __init__(self, *arguments, inertial, **keywords):
        super().__init__(*arguments, inertial=True, **keywords)


def _top_errors(top: str, h: float, span: float, integrator: str, policy: str):
    """Largest errors of x, Omega, joint force in the first fifth and later, and of rows' rates."""
    reference = _table("heavy_top")
    options = RunOptions(
        dt=h, t_end=span, tolerance=1e-10, integrator=integrator, iteration_matrix=policy
    )
    simulation = Simulation(_case("heavy_top").CASE.model(spin=top), options)
    block, rows = simulation.system.parts[0].block, simulation.system.constraints
    count, every, errors, rate = round(span / 0.01) + 1, round(0.01 / h), [], 0.0
    for k in range(count):
        for _ in range(every if k else 0):
            assert simulation.advance(h) is Status.OK
            rate = max(rate, _rates(simulation))
        errors.append([
            block.frames[0, :3] - _columns(reference, "x y z", f"{top}_")[k],
            block.velocity[0, 3:] - _columns(reference, "1 2 3", f"{top}_omega_")[k],
            -rows.forces - _columns(reference, "x y z", f"{top}_force_")[k],
        ])  # fmt: skip
    assert np.abs(rows.values).max() <= 1e-9  # m: positions hold in either form
    x, omega, force = np.swapaxes(np.array(errors), 0, 1)
    force = np.linalg.norm(force, axis=1)
    first = count // 5
    return np.array([np.abs(x).max(), np.abs(omega).max(), force[: first + 1].max(), rate])


@pytest.mark.serial
@pytest.mark.parametrize(
    ("top", "h", "span", "policy"),
    [
        ("slow", 2e-3, 0.5, "auto"),
        ("fast", 1e-3, 0.2, "auto"),
        pytest.param("fast", 1e-3, 0.2, "updated", marks=pytest.mark.slow),
    ],
)
def test_stabilised_heavy_top_is_of_second_order_from_the_first_step(
    monkeypatch, top, h, span, policy
):
    """On R^3 x SO(3), where index 3 has multipliers of first order at first."""
    monkeypatch.setattr("flexfem.families.rigid.family.FrameBlock", _InertialBlock)
    errors = [_top_errors(top, step, span, "stabilized_index2", policy) for step in (h, h / 2)]
    order = np.log2(errors[0] / errors[1])
    assert order[:3].min() >= 1.9
    # m/s: 2e-5 (slow) and 3e-2 (fast) where rates are not constrained
    assert max(e[3] for e in errors) <= 1e-8
    if policy == "auto":
        unstabilised = [
            _top_errors(top, step, span, "generalized_alpha", policy) for step in (h, h / 2)
        ]
        order = np.log2(unstabilised[0] / unstabilised[1])
        # known of the scheme (order 1), and the reason for the stabilised form
        assert order[0] >= 1.9
        assert order[2] <= 1.2
        assert unstabilised[0][3] >= 1e-6
        assert errors[0][2] <= 0.1 * unstabilised[0][2]


def _measured_slider_crank() -> ff.Model:
    """The mechanism with the slider's place, and the crank's angle and rate."""
    model = spatial_slider_crank()
    model.add(
        ff.PositionProbe("slider_at", ff.Marker("slider")),
        ff.Probe("turn", ff.Marker("crank"), ("angle", "rate"), lambda t, s: (
            np.arctan2(-s.rotation[1, 2], s.rotation[2, 2]), s.angular_velocity[0])),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
def test_spatial_slider_crank(integrator):
    """Against a solution of the one equation of motion at 1e-12 (slider, crank angle and rate)."""
    expected = {
        0.25: (0.284860003, 1.947854838, 18.607236332),
        0.5: (0.184952630, -0.699422754, 14.408160810),
        1.0: (0.211721661, -1.652779884, 10.427593001),
    }
    errors = []
    for h in (2e-3, 1e-3):
        options = RunOptions(dt=h, t_end=1.0, tolerance=1e-10, integrator=integrator)
        history = simulate(_measured_slider_crank(), options).history
        rows = [round(t / h) for t in expected]
        found = _columns(history, "slider_at_x angle rate")[rows]
        errors.append(np.abs(found - list(expected.values())).max(axis=0))
    # a joint with another axis in the rod is off by 0.1 rad within a turn
    assert (errors[1] <= (5e-5, 1e-3, 1e-2)).all()
    assert np.log2(errors[0] / errors[1]).min() >= 1.8


@pytest.mark.parametrize(
    "policy", ["auto", *(pytest.param(p, marks=pytest.mark.serial) for p in ("frozen", "updated"))]
)
def test_stabilised_drive_of_a_flexible_arm_keeps_its_rate(policy):
    """Angle and rate of a driven shaft with a beam and a ball on it, at every step."""
    x = np.linspace(0.0, 1.0, 5)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(4), np.arange(1, 5)], axis=1)
    model = ff.Model("arm", mesh=ff.LineMesh(x, cells, {"arm": np.arange(4)}))
    material = ff.Material(2.1e9, 0.3, 7850.0)
    angle, rate = lambda t: 0.5 * t**2 + 0.1 * np.sin(9 * t), lambda t: t + 0.9 * np.cos(9 * t)
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Beam("arm", ff.Section.rectangle(0.02, 0.02, material), damping=1e-4),
        ff.RigidBody("shaft", 1.0, (0.1, 0.1, 0.1)),
        ff.RigidBody("ball", 0.5, (0.01, 0.01, 0.01), position=(1.0, -0.3, 0.0)),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("shaft"), axis=(0, 0, 1)),
        ff.PrescribedAngle("motor", ff.Ground(), ff.Marker("shaft"), axis=(0, 0, 1), angle=angle),
        ff.Rigid("hub", ff.Marker("shaft"), ff.Marker("arm", "start")),
        ff.Spherical("hook", ff.Marker("arm", "end"), ff.Marker("ball", offset=(0, 0.3, 0))),
        ff.Probe("drive", ff.Marker("shaft"), ("angle", "rate"), lambda t, s: (
            np.arctan2(s.rotation[1, 0], s.rotation[0, 0]), s.angular_velocity[2])),
        ff.PositionProbe("tip", ff.Marker("ball")),
    )  # fmt: skip
    ends = {}
    for integrator in ("generalized_alpha", "stabilized_index2"):
        options = RunOptions(
            dt=2e-3, t_end=0.1, tolerance=1e-10, integrator=integrator, iteration_matrix=policy
        )
        outcome = simulate(model, options)
        assert outcome.status == "ok"
        if policy == "frozen":
            assert outcome.summary["factorizations"] == 1
        if outcome.history:  # on the first rank
            t = outcome.history["t"]
            # the start differentiates over dt, and to one side
            miss = np.abs(outcome.history["rate"] - rate(t))[1:].max()
            np.testing.assert_allclose(outcome.history["angle"], angle(t), atol=1e-9)
            ends[integrator] = np.array([outcome.history[f"tip_{k}"][-1] for k in "xyz"])
            # index 3 is off by 1e-4, a rate without the drive's own by 1
            assert miss <= 1e-8 if integrator == "stabilized_index2" else miss >= 1e-6
    if ends:
        # both are of second order: the same motion up to that; a wrong force shows in 1e-2
        np.testing.assert_allclose(*ends.values(), atol=1e-4)


@pytest.mark.serial
def test_stabilised_chain_is_of_second_order_towards_the_converged_step():
    case, reference, errors = _case("chain"), _table("chain_4x8"), []
    for h in (4e-3, 2e-3):
        options = RunOptions(dt=h, t_end=0.4, tolerance=1e-9, integrator="stabilized_index2")
        history = simulate(case.CASE.model(links=4, elements=8), options).history
        found = _columns(history, "x y z", "tip_")[:: round(0.1 / h)]
        exact = _columns(reference, "x y z")[::2][: len(found)]
        errors.append(np.abs(found - exact).max())
    # elements agree to a tenth of their common mesh error, 4.4e-4
    assert errors[-1] <= 2e-4
    assert np.log2(errors[0] / errors[-1]) >= 1.7


@pytest.mark.serial
def test_stabilised_motion_does_not_depend_on_the_factors_of_its_iteration():
    """The part of positions that is not integrated satisfies an equation of its own."""
    ends = []
    for policy in ("auto", "frozen", "updated"):
        options = RunOptions(
            dt=4e-3, t_end=0.2, tolerance=1e-12, integrator="stabilized_index2",
            iteration_matrix=policy,
        )  # fmt: skip
        ends.append(simulate(_measured_slider_crank(), options).history["rate"][-1])
    # with the matrices of the iteration in its equation: 4e-9 apart
    assert np.ptp(ends) <= 1e-11 * abs(ends[0])


def _buffer(stiffness: float) -> ff.Model:
    """A mass of 1 kg at 1 m/s that meets a spring at x = 1 m."""
    model, mass = ff.Model("buffer"), ff.Marker("mass")

    def gap(t, state):
        return 1.0 - state.position[0]

    model.add(
        ff.RigidBody("mass", 1.0, (0.1, 0.1, 0.1), velocity=(1.0, 0, 0)),
        ff.Prismatic("rail", ff.Ground(), mass, axis=(1, 0, 0)),
        ff.SpringDamper("buffer", ff.Ground((2.0, 0, 0)), mass, stiffness=stiffness,
                        rest_length=1.0),
        ff.Event("touch", mass, gap, ff.LockJoint("buffer", hold=False), direction=-1, once=False),
        ff.Event("leave", mass, gap, ff.ReleaseJoint("buffer"), direction=1, once=False),
        ff.PositionProbe("at", mass),
    )  # fmt: skip
    model.release("buffer")
    return model


@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
def test_error_control_resolves_an_impact_on_a_stiff_spring(integrator):
    """Half a period of 2 pi sqrt(m/k) = 6.3 ms in contact, the rest of 1.5 s in free flight."""
    contact = np.pi / np.sqrt(1e6)
    end, errors, steps = 1.0 - (0.5 - contact), [], []
    for tolerance in (1e-5, 1e-6, 1e-7):
        options = RunOptions(
            dt=0.05, t_end=1.5, adaptive=True, error_tolerance=tolerance, tolerance=1e-11,
            integrator=integrator,
        )  # fmt: skip
        outcome = simulate(_buffer(1e6), options)
        history, summary = outcome.history, outcome.summary
        assert [event["name"] for event in summary["events"]] == ["touch", "leave"]
        errors.append(abs(history["at_x"][-1] - end))
        steps.append(summary["steps"])
        # every accepted step of the grid is recorded, and every multiple of dt is met
        grid = np.arange(31) * 0.05
        assert np.abs(history["t"][:, np.newaxis] - grid).min(axis=0).max() <= 1e-12
        assert len(history["t"]) >= 50
        # steps of the grid are 2^-k dt, save those to and from the two events
        ratio = np.log2(0.05 / np.diff(history["t"]))
        assert (np.abs(ratio - np.round(ratio)) <= 1e-6).all()
    # a tenth of the local error per step makes 10^(-2/3) of the error at the end
    rates = np.log10(np.array(errors[:-1]) / errors[1:])
    assert (rates >= 0.45).all()
    assert (rates <= 0.9).all()
    # 1500 equal steps are off by 6.3e-4, 7500 by 3.0e-5; steps that stay small after the contact
    # would save less than half of them
    assert errors[0] <= 2e-4
    assert errors[1] <= 4e-5
    assert max(steps[:2]) <= 100


def _whip() -> ff.Model:
    """A flexible pendulum that a short load hits."""
    x = np.linspace(0.0, 1.0, 9)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(8), np.arange(1, 9)], axis=1)
    model = ff.Model("whip", mesh=ff.LineMesh(x, cells, {"whip": np.arange(8)}))
    section = ff.Section.rectangle(0.02, 0.02, ff.Material(2.1e9, 0.3, 7850.0))
    model.add(
        ff.Beam("whip", section, damping=1e-3),
        ff.Revolute("pin", ff.Ground(), ff.Marker("whip", "start"), axis=(0, 0, 1)),
        ff.PointForce("hit", ff.Marker("whip", "end"), (0.0, 50.0, 0.0), amplitude=lambda t: (
            np.sin(np.pi * min(max((t - 0.1) / 0.05, 0.0), 1.0)) ** 4)),
        ff.PositionProbe("tip", ff.Marker("whip", "end")),
    )  # fmt: skip
    return model


@pytest.mark.parametrize("policy", ["frozen", "auto"])
def test_error_control_keeps_the_factors_of_each_step_size(monkeypatch, policy):
    options = RunOptions(
        dt=0.04, t_end=0.4, adaptive=True, error_tolerance=1e-4, iteration_matrix=policy,
        tolerance=1e-8,
    )  # fmt: skip
    simulation, sizes = Simulation(_whip(), options), set()
    solve = GeneralizedAlpha.solve

    def observed(self, system, policy, h):
        sizes.add(h)
        return solve(self, system, policy, h)

    monkeypatch.setattr(GeneralizedAlpha, "solve", observed)
    for step in range(10):
        assert simulation.advance(0.04, 0.04 * (step + 1)) is Status.OK
    counters = simulation.system.counters
    assert len(sizes) >= 3  # the hit takes smaller steps than the rest
    assert simulation.rejected >= 1
    assert counters.fallbacks == 0
    if policy == "frozen":
        # without the kept factors every change of size costs one
        assert counters.factorizations == len(sizes)
    assert simulation.time == 0.4


@pytest.mark.serial
def test_error_control_follows_the_tolerance_of_a_flexible_body():
    reference = simulate(_whip(), RunOptions(dt=5e-4, t_end=0.4, tolerance=1e-9)).history
    errors, steps = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        options = RunOptions(
            dt=0.04, t_end=0.4, adaptive=True, error_tolerance=tolerance, tolerance=1e-9
        )
        outcome = simulate(_whip(), options)
        errors.append(abs(outcome.history["tip_y"][-1] - reference["tip_y"][-1]))
        steps.append(outcome.summary["steps"])
    assert errors[0] > errors[1] > errors[2]
    # accelerations of unresolved vibrations taken at their face value ask for ten times the steps
    assert errors[2] <= 1e-3
    assert steps[2] <= 1000


def _block_on_a_spring() -> ff.Model:
    model, block = ff.Model("block"), ff.Marker("block")
    model.add(
        ff.RigidBody("block", 2.0, (0.1, 0.2, 0.3), position=(1.3, 0.0, 0.0)),
        ff.Prismatic("guide", ff.Ground(), block, axis=(1, 0, 0)),
        ff.SpringDamper("spring", ff.Ground(), block, stiffness=18.0, rest_length=1.0),
    )
    return model


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("rho_inf", [1.0, 0.6])
@pytest.mark.parametrize(
    "integrator",
    ["generalized_alpha", "stabilized_index2", "energy_momentum", "independent_coordinates"],
)
def test_estimated_errors_are_those_of_a_step(integrator, rho_inf):
    """Of a vibration with 3 rad/s, whose true motion from any state is known; two step sizes."""
    w, errors = 3.0, []
    for count in (26, 52):
        h = np.pi / (2.0 * w) / count  # to where the rate of the acceleration is largest
        options = RunOptions(
            dt=h, t_end=1.0, integrator=integrator, rho_inf=rho_inf, tolerance=1e-13,
            adaptive=True, error_tolerance=0.1,
        )  # fmt: skip
        simulation = Simulation(_block_on_a_spring(), options)
        block = simulation.system.parts[0].block
        for _ in range(count):
            x, v = block.frames[0, 0] - 1.0, block.velocity[0, 0]
            assert simulation.advance(h) is Status.OK
        true = 1.0 + x * np.cos(w * h) + v / w * np.sin(w * h) - block.frames[0, 0]
        errors.append((simulation._error, abs(true)))
    estimated, true = np.transpose(errors)
    # the estimate is of a time a step earlier; a wrong constant is off by 10 % and more
    np.testing.assert_allclose(estimated, true, rtol=0.05)
    # third order: one more or less is a factor of two
    np.testing.assert_allclose(estimated[0] / estimated[1], 8.0, rtol=0.1)
