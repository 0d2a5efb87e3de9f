# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exchange of nodes at joints between ranks, and numbers of rows over all ranks."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build
from flexfem.system.system import System

COMM = MPI.COMM_WORLD
pytestmark = pytest.mark.three_ranks


def chain() -> System:
    """Bodies in a row with joints of different numbers of rows, and a beam that may be split."""
    x = np.linspace(6.0, 7.0, 9)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(8), np.arange(1, 9)], axis=1)
    section = ff.Section.circle(0.05, ff.Material(2e9, 0.3, 1000.0))
    model = ff.Model("chain", mesh=ff.LineMesh(x, cells, {"rod": np.arange(8)}))
    model.add(ff.Beam("rod", section))
    for k in range(6):
        model.add(ff.RigidBody(f"body_{k}", 1.0 + k, (0.1, 0.2, 0.3), position=(k + 0.5, 0, 0)))
    ends = [
        (ff.Marker(f"body_{k}", offset=(-0.5, 0, 0)), ff.Marker(f"body_{k}", offset=(0.5, 0, 0)))
        for k in range(6)
    ]
    model.add(ff.Revolute("pin_0", ff.Ground(), ends[0][0], axis=(0, 0, 1)))
    for k in range(1, 6):
        at = ends[k - 1][1], ends[k][0]
        kind = ff.Spherical if k % 2 else ff.Revolute
        model.add(kind(f"pin_{k}", *at, **({} if k % 2 else {"axis": (0, 1, 0)})))
    model.add(ff.Rigid("root", ends[5][1], ff.Marker("rod", "start")))
    model.add(ff.PointOnPlane("rest", ff.Ground(), ff.Marker("rod", "end"), axis=(0, 0, 1)))
    model.validate()
    return build(NumberedModel(model), COMM, split_above=3)


def test_tables_of_nodes_hold_what_their_owners_have():
    """Frames, increments, velocities and Newton steps, on each rank that has a joint there."""
    system = chain()
    face = system.interface
    known = {}
    for part in system.parts:
        block = part.block
        for k, node in enumerate(block.node_ids):
            about = 1000.0 * (part.kind + 1) + 10.0 * float(node) + np.arange(12.0)
            block.frames[k], block.increment[k] = about, -about[:6]
            block.velocity[k], block.step[k] = 2.0 * about[:6], 3.0 * about[:6]
            if k < block.owned:
                known[part.kind, int(node)] = about
    everywhere = {key: v for part in COMM.allgather(known) for key, v in part.items()}
    face.update()
    face.update_steps()
    assert len(face.keys) > 0
    for slot, (kind, node) in enumerate(face.keys):
        about = everywhere[int(kind), int(node)]
        # a slot of another node, or one that no message fills, has another number or zero
        np.testing.assert_array_equal(face.frames[slot], about)
        np.testing.assert_array_equal(face.increments[slot], -about[:6])
        np.testing.assert_array_equal(face.velocities[slot], 2.0 * about[:6])
        np.testing.assert_array_equal(face.steps[slot], 3.0 * about[:6])


def test_rows_are_numbered_once_over_all_ranks():
    rows = chain().constraints
    owned = rows.numbers[rows.owned > 0.0]
    every = np.concatenate(COMM.allgather(owned))
    # each rank from zero again would use numbers twice
    np.testing.assert_array_equal(np.sort(every), np.arange(rows.size_global))
    mine = {
        (joint.index, r - rows.start[i]): int(rows.numbers[r])
        for i, joint in enumerate(rows.joints)
        for r in range(rows.start[i], rows.start[i + 1])
    }
    # joints on several ranks have the numbers of their owner on all of them
    merged: dict[tuple[int, int], int] = {}
    for others in COMM.allgather(mine):
        for key, number in others.items():
            assert merged.setdefault(key, number) == number
    assert len(merged) == rows.size_global
