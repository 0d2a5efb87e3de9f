# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fixtures of several files: one beam of its own, a gmsh model."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest


class OneBeam:
    """The block of one beam, its cells split over the ranks so that there are ghosts."""

    #: velocity, acceleration and stiffness factors of a step of about 0.1 s: no term dominates
    shifts = np.array([12.0, 70.0, 1.0])

    def __init__(
        self, points: np.ndarray, section: Any, damping: float = 0.0, inertial: bool = False
    ) -> None:
        from mpi4py import MPI

        import flexfem as ff
        from flexfem.layout.numbered_model import NumberedModel
        from flexfem.mesh.line_mesh import LineMesh
        from flexfem.system.build import build

        cells = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
        mesh = LineMesh(points, cells, {"beam": np.arange(len(cells))})
        model = ff.Model("test", mesh=mesh)
        model.add(ff.Beam("beam", section, damping=damping))
        model.validate()
        self.comm, self.most = MPI.COMM_WORLD, MPI.MAX
        part = build(NumberedModel(model), self.comm, split_above=1).parts[0]
        self.block, self.beams = part.block, part.elements
        self.gravity = np.zeros(3)
        self.block.inertial = inertial

    def random(self, rng: np.random.Generator, scale: float) -> np.ndarray:
        """Twists (n, 6) of the local nodes that ranks agree on."""
        return scale * rng.normal(size=(self.block.size_global, 6))[self.block.node_ids]

    def disturb(self, rng: np.random.Generator) -> None:
        """A deformed, moving, accelerated trial state with finite increments."""
        from flexfem.lie import se3

        block = self.block
        block.frames0[:] = se3.retract(block.start_frames, self.random(rng, 0.25))
        block.increment[:] = self.random(rng, 0.2)
        block.velocity[:] = self.random(rng, 0.8)
        block.acceleration[:] = self.random(rng, 1.5)
        block.frames[:] = se3.retract(block.frames0, block.increment)

    def state(self) -> SimpleNamespace:
        names = ("frames", "increment", "velocity", "acceleration")
        return SimpleNamespace(**{name: getattr(self.block, name).copy() for name in names})

    def move(self, state: SimpleNamespace, step: np.ndarray, shifts: np.ndarray) -> None:
        """Set the trial state that a local twist of all nodes leads to, with its velocities."""
        from flexfem.lie import se3

        block = self.block
        if block.inertial:
            self._move_inertial(state, step, shifts)
            return
        block.increment[:] = se3.log(se3.compose(se3.exp(state.increment), se3.exp(step)))
        change = block.increment - state.increment
        block.frames[:] = se3.retract(block.frames0, block.increment)
        block.velocity[:] = state.velocity + shifts[0] * change
        block.acceleration[:] = state.acceleration + shifts[1] * change

    def _move_inertial(self, state: SimpleNamespace, step: np.ndarray, shifts: np.ndarray) -> None:
        """The same where translations and their rates are integrated in inertial axes."""
        from flexfem.lie import se3, so3

        block = self.block

        def increment(frames: np.ndarray) -> np.ndarray:
            start = np.swapaxes(se3.rotation(block.frames0), -1, -2)
            turned = so3.log(start @ se3.rotation(frames))
            return np.concatenate([frames[:, :3] - block.frames0[:, :3], turned], axis=1)

        block.frames[:] = se3.compose(state.frames, se3.exp(step))
        block.increment[:] = increment(block.frames)
        change = block.increment - increment(state.frames)
        R = se3.rotation(state.frames)
        V, spin = state.velocity[:, :3], state.velocity[:, 3:]
        speed = np.einsum("nij,nj->ni", R, V) + shifts[0] * change[:, :3]
        rate = state.acceleration[:, :3] + np.cross(spin, V)
        rate = np.einsum("nij,nj->ni", R, rate) + shifts[1] * change[:, :3]
        back = np.swapaxes(se3.rotation(block.frames), -1, -2)
        block.velocity[:, :3] = np.einsum("nij,nj->ni", back, speed)
        block.velocity[:, 3:] = spin + shifts[0] * change[:, 3:]
        block.acceleration[:, :3] = np.einsum("nij,nj->ni", back, rate) - np.cross(
            block.velocity[:, 3:], block.velocity[:, :3]
        )
        block.acceleration[:, 3:] = state.acceleration[:, 3:] + shifts[1] * change[:, 3:]

    def _collect(self, add: Callable[[], None]) -> np.ndarray:
        self.block.residual[:] = 0.0
        add()
        self.block.add_ghosts()
        return self.block.owned_residual.copy()

    def residual(self, scale: float = 1.0, strains: Any = None) -> np.ndarray:
        """Owned rows of the residual, with the stresses of given strains."""
        from flexfem.layout.tangent_request import TangentRequest

        request = TangentRequest(strains)
        return self._collect(
            lambda: self.beams.add_residual(self.block, self.gravity, scale, request)
        )

    def action(self, step: np.ndarray, shifts: np.ndarray, scale: float) -> np.ndarray:
        """Owned rows of the tangent's action on a step."""
        self.block.step[:] = step
        return self._collect(lambda: self.beams.add_action(self.block, self.gravity, shifts, scale))

    def product(self, step: np.ndarray, shifts: np.ndarray, scale: float) -> np.ndarray:
        """Owned rows of the cell matrices times a step."""
        matrices = self.beams.tangent(self.block, self.gravity, shifts, scale)
        cells = self.beams.data.cells
        local = np.einsum("mij,mj->mi", matrices, step[cells].reshape(-1, 12)).reshape(-1, 2, 6)
        return self._collect(lambda: np.add.at(self.block.residual, cells, local))

    def strain(self) -> np.ndarray:
        return self.beams.resultants(self.block.frames)[0]

    def energy(self) -> float:
        """Strain energy (collective)."""
        return self.total(self.beams.energies(self.block.frames))

    def total(self, values: np.ndarray) -> Any:
        """Sum over the first axis and all ranks."""
        return self.comm.allreduce(values.sum(axis=0))

    def largest(self, values: np.ndarray) -> float:
        """Largest size of an entry on all ranks."""
        return self.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=self.most)

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Rows of the owned nodes in the order of the input, on every rank."""
        block = self.block
        out = np.zeros((block.size_global, values.shape[1]))
        out[block.node_ids[: block.owned]] = values[: block.owned]
        return self.comm.allreduce(out)

    def wrench(self, local: np.ndarray) -> np.ndarray:
        """Sum of local nodal forces and moments, inertial axes, about the inertial origin."""
        from flexfem.lie import se3

        frames = self.block.frames[: self.block.owned]
        back = np.swapaxes(se3.adjoint(se3.inverse(frames)), -1, -2)
        return self.total(np.einsum("nij,nj->ni", back, local))

    def momenta(self) -> np.ndarray:
        """Linear momentum and angular momentum about the inertial origin."""
        block, kept = self.block, self.block.acceleration.copy()
        block.acceleration[:] = 0.0
        without = self.residual()
        block.acceleration[:] = block.velocity  # the residual is linear in the acceleration
        moving = self.residual()
        block.acceleration[:] = kept
        return self.wrench(moving - without)

    def rigidly(self, velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Local twists of a rigid motion about the inertial origin."""
        from flexfem.lie import se3

        back = np.swapaxes(se3.rotation(self.block.frames), -1, -2)
        speed = velocity + np.cross(spin, self.block.frames[:, :3])
        return np.concatenate([np.einsum("nij,nj->ni", back, speed), back @ spin], axis=1)


@pytest.fixture
def one_beam() -> type[OneBeam]:
    """Class of a beam on all ranks, created collectively."""
    return OneBeam


class OneNurbs(OneBeam):
    """The block of one NURBS beam on this process: elements of one degree that share end nodes."""

    def __init__(
        self, points: np.ndarray, degree: int, section: Any, damping: float = 0.0,
        weights: np.ndarray | None = None, turns: np.ndarray | None = None, inertial: bool = True,
        vectors: bool = False,
    ) -> None:  # fmt: skip
        """Create the beam.

        Args:
            points: (n, 3) control points, n - 1 a multiple of the degree.
            degree: of the elements.
            section: of the beam.
            damping: stiffness-proportional, s.
            weights: (n,) of the control points, all one when None.
            turns: (n, 3) rotation vectors of the control points' frames, all zero when None.
            inertial: as in the block.
            vectors: as in ``NurbsCells``.
        """
        from math import comb

        from mpi4py import MPI

        from flexfem.families.beam_nurbs.elements import NurbsCells

        self.degree, count = degree, (len(points) - 1) // degree
        nodes = degree * np.arange(count)[:, np.newaxis] + np.arange(degree + 1)
        powers = np.zeros((degree + 1, degree + 1))
        for i in range(degree + 1):
            for j in range(i, degree + 1):
                powers[i, j] = (-1) ** (j - i) * comb(degree, i) * comb(degree - i, j - i)
        weights = np.ones(len(points)) if weights is None else weights
        numbers = np.zeros(count, dtype=np.int64)
        cells = NurbsCells(
            nodes, numbers, numbers, weights[nodes][..., np.newaxis] * powers,
            np.full((count, 1), damping), vectors,
        )  # fmt: skip
        self.comm, self.most, self.gravity = MPI.COMM_SELF, MPI.MAX, np.zeros(3)
        self.create(points, turns, [cells], [section], inertial)

    def create(
        self, points: np.ndarray, turns: np.ndarray | None, data: Any, sections: Any,
        inertial: bool = True,
    ) -> None:  # fmt: skip
        """Create block and beams from the elements of all degrees."""
        from dolfinx.common import IndexMap

        from flexfem.core.nodes.frame_block import FrameBlock
        from flexfem.families.beam_nurbs.elements import NurbsBeams
        from flexfem.lie import se3, so3

        n = len(points)
        frames = se3.frame(points, so3.exp(np.zeros((n, 3)) if turns is None else turns))
        index_map = IndexMap(self.comm, n)
        self.block = FrameBlock(
            "nurbs", self.comm, frames, np.zeros((n, 6)), np.arange(n), index_map, inertial
        )
        owners = [f"Section {i}" for i in range(len(sections))]
        self.beams = NurbsBeams(self.comm, data, sections, owners, frames)

    def matrix(
        self, shifts: np.ndarray, scale: float = 1.0, *, local: bool = False, strains: Any = None
    ) -> np.ndarray:
        """Dense matrix of all nodes."""
        from flexfem.layout.tangent_request import TangentRequest

        request = TangentRequest(strains, local=local)
        values = self.beams.values(self.block, self.gravity, shifts, scale, request)
        n, first = 6 * len(self.block.frames), 0
        dense = np.zeros((n, n))
        for cells in self.beams.connectivity:
            width = 6 * cells.shape[1]
            for nodes in cells:
                at = (6 * nodes[:, np.newaxis] + np.arange(6)).ravel()
                dense[np.ix_(at, at)] += values[first : first + width**2].reshape(width, width)
                first += width**2
        assert first == len(values)
        return dense

    def product(self, step: np.ndarray, shifts: np.ndarray, scale: float) -> np.ndarray:
        """The matrix times a step."""
        return (self.matrix(shifts, scale) @ step.ravel()).reshape(-1, 6)


@pytest.fixture
def one_nurbs() -> type[OneNurbs]:
    """Class of a NURBS beam on this process."""
    return OneNurbs


@pytest.fixture
def gmsh_model() -> Iterator[Any]:
    """A fresh gmsh model, closed again at the end."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("test")
    yield gmsh.model
    gmsh.finalize()
