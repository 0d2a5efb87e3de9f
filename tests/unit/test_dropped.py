# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models that are dropped give back their communicators, of which MPI has about two thousand."""

import gc
from collections.abc import Callable, Iterator
from dataclasses import replace

from mpi4py import MPI

import pytest

import flexfem as ff
from flexfem.la.dropped import destroy_dropped
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.system import Shifts

MOTION = ff.RunOptions(dt=1e-3, t_end=1e-3, split_above=1)


def cantilevers() -> ff.Model:
    """Two beams of both kinds, which ranks share, joined in the middle; a body."""
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    section = ff.Section.rectangle(0.02, 0.01, steel)
    line = ff.NurbsCurve.line((1.0, 0.0, 0.0), (0.5, 0.0, 0.0), degree=2, elements=3)
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}, elements=3)
    model = ff.Model("cantilevers", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", section),
        ff.Beam("curve", section, curve=line),
        ff.Rigid("left", ff.Ground(), ff.Marker("rod", "start")),
        ff.Rigid("right", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("curve", "start")),
        ff.Spherical("middle", ff.Marker("rod", "end"), ff.Marker("curve", "end")),
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(0.5, 0.0, 0.0)),
        ff.Rigid("weld", ff.Marker("rod", "end"), ff.Marker("bob")),
    )
    return model


def sheet() -> ff.Model:
    """A hinged sheet of shell over a plane."""
    model = ff.Model("sheet", surface=ff.SurfaceMesh.rectangle("sheet", (0.4, 0.2), (4, 2)))
    section = ff.ShellSection.isotropic(2e-3, ff.Material(2e9, 0.3, 7800.0))
    model.add(
        ff.Shell("sheet", section, edges={"sheet_left": "hinged"}),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Contact("floor", "sheet", surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -1e-3)))),
    )
    return model


def block() -> ff.Model:
    """A bar of solid that a joint holds."""
    mesh = ff.SolidMesh.box((0.3, 0.1, 0.1), (3, 1, 1))
    law = ff.laws.NeoHookean.from_young(2e7, 0.3)
    bar = ff.Solid("bar", law, mesh, density=1000.0, degree=1)
    model = ff.Model("block")
    model.add(
        bar, ff.Gravity((0.0, 0.0, -9.81)),
        ff.Rigid("wall", ff.Ground((0.0, 0.05, 0.05)), bar.surface_marker("x0")),
    )  # fmt: skip
    return model


ITERATIVE = ff.StaticOptions(load_steps=1, linear_solver="iterative", split_above=1)
RUNS: dict[str, Callable[[MPI.Intracomm], ff.Outcome]] = {
    "frozen": lambda comm: ff.simulate(cantilevers(), MOTION, comm=comm),
    "updated": lambda comm: ff.simulate(
        cantilevers(), replace(MOTION, iteration_matrix="updated"), comm=comm
    ),
    "adaptive": lambda comm: ff.simulate(cantilevers(), replace(MOTION, adaptive=True), comm=comm),
    "shell": lambda comm: ff.simulate(sheet(), MOTION, comm=comm),
    "statics": lambda comm: ff.solve_static(
        cantilevers(), ff.StaticOptions(load_steps=1, critical_points=True), comm=comm
    ),
    "iterative": lambda comm: ff.simulate(
        block(), replace(MOTION, linear_solver="iterative"), comm=comm
    ),
    "iterative statics": lambda comm: ff.solve_static(block(), ITERATIVE, comm=comm),
    "modes": lambda comm: ff.find_modes(cantilevers(), ff.ModeOptions(modes=2), comm=comm),
}


@pytest.fixture(autouse=True)
def _without_collector() -> Iterator[None]:
    """The collector would free cycles of objects, too, but at a time of its own on every rank."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


class Counted:
    """A communicator that counts its copies, and copies of these, that live on this rank."""

    def __init__(self) -> None:
        self.alive = 0
        self._key = MPI.Comm.Create_keyval(self._copied, self._freed)
        self.comm = MPI.COMM_WORLD.Dup()
        self.comm.Set_attr(self._key, "counted")

    def _copied(self, comm: MPI.Comm, key: int, value: str) -> str:
        self.alive += 1
        return value

    def _freed(self, comm: MPI.Comm, key: int, value: str) -> None:
        self.alive -= 1

    def free(self) -> None:
        self.comm.Free()
        MPI.Comm.Free_keyval(self._key)


@pytest.fixture
def counted() -> Iterator[Counted]:
    one = Counted()
    yield one
    destroy_dropped(one.comm)
    one.free()


@pytest.mark.parametrize("name", RUNS)
def test_dropped_models_leave_no_communicators(name: str, counted: Counted) -> None:
    left = []
    for _ in range(2):
        assert RUNS[name](counted.comm).status == "ok"
        destroy_dropped(counted.comm)
        left.append(counted.alive)
    # DOLFINx keeps some for good; each run leaves 4 more if rows and lines hold one another
    assert left[1] == left[0]


def test_a_model_begins_with_the_end_of_those_before(counted: Counted) -> None:
    numbers = []
    for _ in range(3):
        RUNS["frozen"](counted.comm)
        numbers.append(counted.alive)
    # on two ranks 3 more each time if none is destroyed
    assert numbers == numbers[:1] * 3


@pytest.mark.slow_on_ranks
def test_older_factors_leave_no_communicators(counted: Counted) -> None:
    """In a run that factorises again and again, or whose sliders change the pattern."""
    simulation = Simulation(cantilevers(), MOTION, counted.comm)
    frozen = FrozenSolver(simulation.system)

    def again(first: int) -> None:
        for k in range(first, first + 5):
            frozen.factor(Shifts(0.0, 1e6 * k, 1e-6))
            TangentSolver(simulation.system).step(Shifts(0.0, 1e6 * k, 1e-6))

    again(1)
    before = counted.alive
    again(6)
    # 15 more on two ranks if none is destroyed
    assert counted.alive == before
