# SPDX-License-Identifier: LGPL-3.0-or-later
"""Systems of one shell under a load, and what the load does to its nodes."""

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3
from flexfem.system.build import build
from flexfem.system.system import System

__all__ = ["disturb", "inertial", "load_forces", "loaded", "sums"]


def loaded(
    shell: ff.Shell, mesh: ff.SurfaceMesh, load: object, comm: MPI.Intracomm = MPI.COMM_WORLD
) -> System:
    """System of a shell and a load at t = 0 (collective)."""
    model = ff.Model("test", surface=mesh)
    model.add(shell, load)
    model.validate()
    system = build(NumberedModel(model), comm, split_above=1)
    system.set_time(0.0)
    return system


def disturb(system: System, rng: np.random.Generator, size: float) -> None:
    """Another shape, in axes rotated at random; the same on all ranks."""
    block = system.parts[0].block
    moves = size * rng.normal(size=(block.size_global, 3))[block.node_ids]
    turns = so3.exp(rng.normal(size=(block.size_global, 3)))[block.node_ids]
    block.frames[:] = se3.frame(block.start_frames[:, :3] + moves, turns)


def load_forces(system: System, scale: float = 1.0) -> np.ndarray:
    """(n_owned, width) forces of the loads alone, node axes; the last three are moments."""
    (part,) = system.parts
    part.block.residual[:] = 0.0
    part.forces.add_residual(part.block, system.factors, scale)
    for inside in part.line_forces:
        inside.add_residual(part.block, system.factors, scale)
    part.block.add_ghosts()
    return -part.block.owned_residual


def inertial(system: System, local: np.ndarray) -> np.ndarray:
    """Forces (n, 3) in inertial axes."""
    frames = system.parts[0].block.frames[: len(local)]
    return np.einsum("nij,nj->ni", se3.rotation(frames), local[:, :3])


def sums(system: System) -> np.ndarray:
    """Resultant and moment about the inertial origin (collective)."""
    found = inertial(system, load_forces(system))
    points = system.parts[0].block.frames[: len(found), :3]
    both = np.concatenate([found.sum(axis=0), np.cross(points, found).sum(axis=0)])
    return system.comm.allreduce(both)
