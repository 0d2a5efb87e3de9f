# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids with the energy-momentum integrator: forces, motions, restart, refusals."""

from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.families.solid.family import SolidFamily
from flexfem.integrators.energy_momentum.mechanics import StepMechanics
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.system import Shifts
from tests.histories import columns
from tests.unit.test_solids import CELLS, COMM, LAWS, NEO, box, system
from tests.verification.benchmarks.solid_flight import DENSITY, MODULI, block, drifts


def step(s: SimpleNamespace, h: float) -> tuple[StepMechanics, Any]:
    """Equations of a step of a body that turns, is strained, and changes both."""
    mechanics = StepMechanics(s.all, 0.0)
    state = mechanics._parts[id(s.all.parts[0])].state
    X, flat = s.block.start_frames[:, :3].copy(), s.solid.plane is not None
    for turned, frames in ((0.1, s.block.frames0), (0.5, s.block.frames)):
        x = X + 0.1 * np.column_stack([np.sin(X[:, 1] + turned), X[:, 0] ** 2, 0.3 * X[:, 2]])
        c, d = np.cos(turned), np.sin(turned)
        if s.solid.plane == "axisymmetric":
            c, d = 1.0, turned  # a ring does not turn, it is sheared
        R = np.array([[c, 0.0, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]])
        R[0, 1] = -d * (s.solid.plane != "axisymmetric")
        frames[:, :3] = (x * (1.0, 1.0, not flat)) @ R.T
    s.block.velocity[:] = 0.0
    mechanics.begin(s.all, h, np.ones(0))
    return mechanics, state


def check_step(s: SimpleNamespace, conservative: bool = True) -> None:
    """Work of the mean forces, their resultant, and matrices against differences."""
    h, block, elements = 0.1, s.block, s.elements
    mechanics, state = step(s, h)
    x0, x1 = state.frames0[:, :3].copy(), block.frames[:, :3].copy()
    shifts, (part,) = Shifts(2.0 / h, 4.0 / h**2, h * h / 4.0), s.all.parts
    way = np.sin(1.0 + 3.0 * block.start_frames[:, :3] + np.arange(3))
    way[:, 2] *= s.solid.plane is None

    def force(at: float) -> np.ndarray:
        block.frames[:, :3] = x1 + at * way
        state.rates[:, :3] = state.law[2] * (block.frames[:, :3] - x0)
        mechanics.evaluate(s.all, shifts)
        return block.owned_residual / mechanics.weight

    def summed(values: np.ndarray) -> np.ndarray:
        return COMM.allreduce(values[: block.owned].sum(axis=0))

    found = np.zeros_like(x1)
    found[: block.owned] = force(0.0)
    momentum = elements.mass @ state.rates[:, :3] / h
    padded = np.zeros((len(x1), 6))
    padded[:, :3] = momentum  # summed over the cells of all ranks
    block.residual[:] = padded
    block.add_ghosts()
    found[: block.owned] -= block.owned_residual
    size = COMM.allreduce(np.abs(found).max(), op=MPI.MAX)
    energies = [COMM.allreduce(elements.energies(f).sum()) for f in (state.frames0, block.frames)]
    work = summed((found * (x1 - x0)).sum(axis=1))
    lost = COMM.allreduce(elements.losses(state.frames0, block.frames, h).sum())
    # round-off; stresses of either end, or their mean, miss by tenths or by 1e-3
    assert work == pytest.approx(energies[1] - energies[0] + lost, rel=1e-11)
    assert conservative or lost > 0.0
    ring = s.solid.plane == "axisymmetric"
    # of a ring that along its axis alone
    assert np.abs(summed(found)[1 if ring else slice(None)]).max() < 1e-11 * size
    if not ring:  # stresses that are not symmetric would have a moment of the size of the forces
        assert np.abs(summed(np.cross(0.5 * (x0 + x1), found))).max() < 1e-11 * size
    change = (force(1e-6) - force(-1e-6)) / 2e-6
    force(0.0)
    block.residual[:], block.step[:, :3] = 0.0, way
    mechanics.add_own_action(s.all, part, shifts, 1.0 / mechanics.weight, None)
    action, largest = block.owned_residual.copy(), COMM.allreduce(np.abs(change).max(), op=MPI.MAX)
    # differences; a term missing in the tangent is 1e-2 of it
    assert np.abs(action - change).max(initial=0.0) < 1e-6 * largest
    matrices = mechanics.cells(s.all, part, shifts, shifts.request()).reshape(-1, 3, 3)
    ((rows, across),) = elements.couplings
    block.residual[:] = 0.0
    own = np.einsum("kij,kj->ki", matrices, way[across[:, 0]]) / mechanics.weight
    np.add.at(block.residual[:, :3], rows[:, 0], own)
    block.add_ghosts()
    assert np.abs(block.owned_residual - action).max(initial=0.0) < 1e-12 * largest


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=() if n == "tetrahedra" else pytest.mark.slow)
        for n, (*_, plane) in CELLS.items()
        if plane != "stress"  # refused
    ],
)
def test_mean_forces_do_the_work_of_the_energy(name):
    """In cells of all shapes, with and without a dilatation, neither turned nor moved."""
    cell, degree, formulation, plane = CELLS[name]
    check_step(
        system(
            ff.Solid("body", NEO, box(cell), density=2.0, degree=degree, plane=plane,
                     formulation=formulation)
        )
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("name", ["damped", "mooney", "ogden", "tissue"])
def test_mean_forces_of_laws(name):
    """With viscous forces, whose work is what the cells lose."""
    s = system(ff.Solid("body", LAWS[name], box("tetrahedron"), density=2.0, degree=1))
    check_step(s, conservative=name != "damped")


@pytest.mark.three_ranks
def test_tumbling_block_keeps_energy_and_momenta(shared_tmp_path):
    """Simo and Tarnow's block, thrown: the whole motion, and from a checkpoint, on any ranks."""
    body = ff.Solid(
        "block", ff.laws.NeoHookean(*MODULI), block(1, 2), density=DENSITY, degree=1,
        velocity=(1.0, 2.0, 0.5), angular_velocity=(1.0, 0.5, 1.5),
        start_velocities=lambda x: 2.0 * np.sin(x[:, [1, 2, 0]]),
    )  # fmt: skip
    model = ff.Model("block")
    model.add(body, ff.EnergyProbe(), ff.MomentumProbe("all"))
    options = {
        "dt": 0.1, "t_end": 1.6, "integrator": "energy_momentum", "rho_inf": 1.0,
        "tolerance": 1e-12, "split_above": 1, "checkpoint_every": 12,
    }  # fmt: skip
    history = columns(ff.simulate(model, ff.RunOptions(output=shared_tmp_path, **options)))
    energy, angular, linear = drifts(history, 0.0)
    # generalized-alpha changes energy and angular momentum by 1e-2 and more
    assert energy < 1e-11
    assert angular < 1e-12
    assert linear < 1e-12
    # strains of a fifth: a scheme for small strains would not do
    assert history["energy_strain"].max() > 0.02 * history["energy_kinetic"].max()
    assert history["energy_kinetic"][-1] == pytest.approx(END, rel=1e-9)
    restart = sorted(shared_tmp_path.glob("checkpoint*"))[0]
    again = ff.RunOptions(output=shared_tmp_path, restart=restart, **options)
    assert columns(ff.simulate(model, again))["energy_kinetic"][-1] == pytest.approx(END, rel=1e-9)


#: Kinetic energy at the end on one rank, J.
END = 47958.85706698255


@pytest.mark.slow_on_ranks
def test_solids_in_mechanisms_keep_their_energy(shared_tmp_path):
    """Hung from a mean place, bonded to a plate, with a spring, a pressure, weight and a floor."""
    mesh = ff.SolidMesh.box((1.0, 0.2, 0.2), (4, 1, 1), "tetrahedron")
    bar = ff.Solid(
        "bar", NEO, mesh, density=1000.0, angular_velocity=(0, 1, 0.5), touching="boundary"
    )
    model = ff.Model("bar")
    plate = ff.Marker("plate", offset=(-0.1, 0.0, 0.0))
    model.add(
        bar,
        ff.RigidBody("plate", mass=3.0, inertia=0.1 * np.eye(3), position=(1.1, 0.1, 0.1),
                     velocity=(-0.05, 0.5, -1.1), angular_velocity=(0, 1, 0.5)),
        ff.RigidPoints("bond", plate, nodes=bar.node_markers("x1")),
        ff.Spherical("pin", ff.Ground((0.0, 0.1, 0.1)), bar.surface_marker("x0")),
        ff.SpringDamper("spring", ff.Ground((0.5, 0.1, 1.0)), bar.point_marker((0.5, 0.1, 0.1)),
                        stiffness=3e3),
        ff.SurfacePressure("around", "bar", "boundary", 2e3),
        ff.Contact("floor", "bar", surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -0.01)))),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.EnergyProbe(),
        ff.ContactProbe("floor_at", "floor"),
    )  # fmt: skip
    history = columns(
        ff.simulate(
            model,
            ff.RunOptions(
                output=shared_tmp_path, dt=4e-3, t_end=0.048, integrator="energy_momentum",
                rho_inf=1.0, tolerance=1e-10, split_above=1,
            ),
        )
    )  # fmt: skip
    assert history["floor_at_normal"].max() > 1.0
    assert history["energy_strain"].max() > 1.0
    # a discrete gradient that is not exact leaves what generalized-alpha does, 1e-3 and more
    assert np.abs(history["energy_balance"]).max() < 1e-9 * history["energy_kinetic"][0]


@pytest.mark.slow
@pytest.mark.serial
def test_stiff_vibrations_decay_by_the_given_radius():
    """Modes that no step resolves: each step multiplies strains by -rho_inf, as with beams."""
    law, mesh = ff.laws.NeoHookean.from_young(1e4, 0.4), ff.SolidMesh.box((1, 1, 1), (1, 1, 1))
    model = ff.Model("cube")
    model.add(
        ff.Solid("cube", law, mesh, density=1.0, degree=1, fixed={"x0": "xyz"},
                 start_velocities=lambda x: 0.1 * x[:, [0, 2, 1]] * x[:, :1] ** 2),
        ff.EnergyProbe(),
    )  # fmt: skip
    options = ff.RunOptions(
        dt=1.0,
        t_end=8.0,
        integrator="energy_momentum",
        rho_inf=0.5,
        tolerance=1e-12,
        quiet=True,
        every=1,
    )
    strain = ff.simulate(model, options).history["energy_strain"]
    # periods are hundredths of the steps; without the stresses' part nothing would decay
    assert np.sqrt(strain[-1] / strain[-2]) == pytest.approx(0.5, abs=0.01)


@pytest.mark.serial
def test_what_has_no_mean_forces_is_refused():
    """One line that names the body or the joint."""

    mesh = ff.SolidMesh.box((1.0, 1.0, 1.0), (1, 1, 1), "tetrahedron")

    def body(law: Any = NEO) -> ff.Solid:
        return ff.Solid("bar", law, mesh, density=1.0)

    def check(law: Any, dissipates: bool = False) -> None:
        model = ff.Model("refused")
        model.add(body(law))
        SolidFamily(NumberedModel(model), 0).check_energy_momentum(dissipates)

    start = 'Solid "bar": the integrator energy_momentum does not support'
    with pytest.raises(ValueError, match=f"^{start} internal variables$"):
        check(LAWS["relaxing"])
    with pytest.raises(ValueError, match=f"^{start} parameters that change with time$"):
        check(LAWS["muscle"])
    unknown = ff.laws.Hyperelastic(lambda F, p: F[0, 0] * p.a, {"a": 1.0})
    with pytest.raises(
        ValueError, match=f"^{start} rho_inf below 1 for a law without positive moduli"
    ):
        check(unknown, dissipates=True)
    model = ff.Model("refused")
    end = body().surface_marker("x1")
    model.add(body(), ff.Rigid("weld", ff.Ground((1.0, 0.5, 0.5)), end))
    options = ff.RunOptions(dt=1e-3, t_end=1e-3, integrator="energy_momentum", rho_inf=1.0)
    with pytest.raises(ValueError, match=r'^Rigid "weld": .* markers on lines, or on surfaces'):
        ff.simulate(model, options)
