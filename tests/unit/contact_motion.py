# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of models with contact, and their tangents by differences."""

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.lie import se3
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.probes import ProbeRecorder


def sheet(name, nodes, size, at, tilt=0.0):
    """Square sheet in a plane."""
    u = np.linspace(-0.5, 0.5, nodes) * size

    def place(p):
        return np.c_[p[:, 0] + at[0], p[:, 1] + at[1], at[2] + tilt * p[:, 0]]

    return ff.SurfaceMesh.grid(name, u, u, place)


def ball(radius, rings):
    """Closed mesh of a sphere, with normals outwards: a cube blown up."""
    u = np.linspace(-1.0, 1.0, rings + 1)
    flat = ff.SurfaceMesh.grid("side", u, u)
    points, triangles = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            first, second = ((axis + 1) % 3, (axis + 2) % 3)[:: int(sign)]
            p = np.empty((len(flat.points), 3))
            p[:, axis], p[:, first], p[:, second] = sign, flat.points[:, 0], flat.points[:, 1]
            triangles.append(flat.triangles + len(flat.points) * len(points))
            points.append(np.tan(0.25 * np.pi * p))
    every = np.concatenate(points)
    every *= radius / np.linalg.norm(every, axis=1)[:, None]
    _, first, at = np.unique(every.round(9) + 0.0, axis=0, return_index=True, return_inverse=True)
    faces = at[np.concatenate(triangles)]
    return ff.SurfaceMesh(every[first], faces, {"ball": np.arange(len(faces))})


def moved(model, steps, comm=None, dt=2e-4, **options):
    """Simulation after some steps, and columns of the history (first rank)."""
    options.setdefault("split_above", 20)
    options.setdefault("rho_inf", 0.9)
    settings = RunOptions(dt=dt, t_end=1.0, **options)
    simulation = Simulation(model, settings, comm)
    recorder = ProbeRecorder(simulation.system, simulation.serial, depth=1000)
    recorder.record(0.0)
    for _ in range(steps):
        assert simulation.advance(dt) is Status.OK
        recorder.record(simulation.system.time)
    rows = [values for _, values in recorder.flush()]
    columns = np.array(rows).reshape(-1, len(recorder.columns)).T
    return simulation, dict(zip(recorder.columns, columns, strict=True))


def same_on_ranks(model, steps, **options):
    """Compare the history on all ranks with that on one; returns the latter."""
    _, history = moved(model, steps, **options)
    _, alone = moved(model, steps, MPI.COMM_SELF, **options)
    if MPI.COMM_WORLD.rank == 0:
        for name, values in alone.items():
            # rounding: measured 1e-12; a triangle of another rank left out changes 1e-1
            scale = max(abs(values).max(), 1e-3)
            np.testing.assert_allclose(history[name], values, atol=1e-9 * scale, err_msg=name)
    return alone


def check_tangents(system, accuracy=1e-6, h=1e-8):
    """Compare actions and entries of contacts with differences of their forces.

    Returns:
        Largest entries of the differences in each block.
    """
    parts = [part for part in system.parts if part.contacts is not None]
    rng = np.random.default_rng(0)
    steps, starts = [], []
    for part in parts:
        block = part.block
        # one step for every node, the same on all ranks
        count = block.comm.allreduce(int(block.node_ids.max(initial=0)), op=MPI.MAX) + 1
        step = rng.normal(size=(count, 6))[block.node_ids]
        step[:, block.width :] = 0.0
        if block.dirichlet is not None:
            step[:, : block.width][block.dirichlet] = 0.0
        steps.append(step)
        starts.append(block.frames.copy())

    def forces(h):
        for part, step, start in zip(parts, steps, starts, strict=True):
            part.block.frames[:] = se3.retract(start, h * step)
            part.block.residual[:] = 0.0
        for part in parts:
            part.contacts.add_residual(1.0)
        return [part.block.owned_residual.copy() for part in parts]

    expected = [(a - b) / (2 * h) for a, b in zip(forces(h), forces(-h), strict=True)]
    forces(0.0)
    for part, step in zip(parts, steps, strict=True):
        part.block.step[:], part.block.residual[:] = step, 0.0
    for part in parts:
        part.contacts.add_action(1.0)
    largest = []
    for i, part in enumerate(parts):
        block = part.block
        action = block.hold(block.owned_residual.copy())
        product = np.zeros(block.sizes[1])
        for j, other in enumerate(parts):
            every = np.zeros(other.block.sizes[1])
            numbers = other.block.global_ids[: other.block.owned, None]
            width = other.block.width
            own = (width * numbers + np.arange(width)).ravel()
            every[own] = steps[j][: other.block.owned, :width].ravel()
            every = block.comm.allreduce(every)
            rows, columns, values = part.contacts.entries(1.0, other.kind)
            np.add.at(product, rows, values * every[columns])
        product = block.comm.allreduce(product)
        own = block.width * block.global_ids[: block.owned, None] + np.arange(block.width)
        size = block.comm.allreduce(abs(expected[i]).max(initial=0.0), op=MPI.MAX)
        largest.append(size)
        held = block.hold(expected[i])
        np.testing.assert_allclose(action, held, atol=accuracy * size)
        # the same numbers in another order
        np.testing.assert_allclose(product[own], action, atol=1e-11 * size)
    return largest
