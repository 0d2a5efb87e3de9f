# SPDX-License-Identifier: LGPL-3.0-or-later
"""The distributed mesh of shells: ownership, patches, numbering and exchange on 1, 2, 3 ranks."""

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.three_ranks


def two_plates():
    """Plates with nodes of their own that coincide along x = 1."""
    left = ff.SurfaceMesh.rectangle("left", (1.0, 1.0), (6, 5))
    right = ff.SurfaceMesh.grid("right", np.linspace(1, 2, 5), np.linspace(0, 1, 6))
    return ff.SurfaceMesh.join([left, right])


def three_wings():
    """Three bodies that share the nodes of one edge line: three cells at one facet of the mesh."""
    y = np.linspace(0.0, 1.0, 4)
    axis = np.column_stack([0 * y, y, 0 * y])
    points, triangles, bodies = [axis], [], {}
    for wing in range(3):
        angle = 2.0 * np.pi * wing / 3.0
        first, number = 4 * (wing + 1), 6 * wing
        points.append(axis + np.array([np.cos(angle), 0.0, np.sin(angle)]))
        for j in range(3):
            triangles += [[j, first + j, j + 1], [first + j, first + j + 1, j + 1]]
        bodies[f"wing_{wing}"] = np.arange(number, number + 6)
    return ff.SurfaceMesh(np.concatenate(points), triangles, bodies)


def halves(mesh, size):
    """Ranks in strips across both bodies."""
    x = mesh.points[mesh.triangles].mean(axis=1)[:, 0]
    return np.minimum((x / 2.0 * size).astype(int), size - 1)


def scattered(mesh, size):
    """Neighbours on different ranks nearly everywhere."""
    return np.random.default_rng(7).integers(0, size, len(mesh.triangles))


def last(mesh, size):
    """All on the last rank, the others stay empty."""
    return np.full(len(mesh.triangles), size - 1)


def by_body(mesh, size):
    return mesh.body % size


@pytest.fixture(
    params=[
        (two_plates, halves), (two_plates, scattered), (two_plates, last), (two_plates, by_body),
        (three_wings, by_body), (three_wings, scattered),
    ],
    ids=lambda pair: f"{pair[0].__name__}-{pair[1].__name__}",
)  # fmt: skip
def distributed(request):
    from mpi4py import MPI

    from flexfem.mesh.distributed.shell_mesh import create_shell_mesh

    comm = MPI.COMM_WORLD
    mesh = request.param[0]()
    destination = request.param[1](mesh, comm.size)
    return comm, mesh, destination, create_shell_mesh(comm, mesh, destination)


def test_every_cell_is_owned_once_by_its_rank(distributed):
    comm, mesh, destination, part = distributed
    mine = part.cell_ids[: part.owned]
    np.testing.assert_array_equal(np.sort(mine), np.flatnonzero(destination == comm.rank))
    np.testing.assert_array_equal(part.body, mesh.body[part.cell_ids])


def test_cells_and_patches_are_those_of_the_input(distributed):
    _, mesh, _, part = distributed
    # Identified by number: positions cannot tell the coincident nodes apart
    np.testing.assert_array_equal(part.node_ids[part.cells], mesh.triangles[part.cell_ids])
    there = part.opposite >= 0
    opposite = np.where(there, part.node_ids[part.opposite], -1)
    np.testing.assert_array_equal(opposite, mesh.topology.opposite[part.cell_ids[: part.owned]])


def test_ghosts_are_the_neighbours_on_other_ranks(distributed):
    comm, mesh, destination, part = distributed
    around = mesh.topology.neighbours[destination == comm.rank]
    around = np.unique(around[around >= 0])
    expected = around[destination[around] != comm.rank]
    np.testing.assert_array_equal(np.sort(part.cell_ids[part.owned :]), expected)


def test_every_node_has_one_owner(distributed):
    comm, mesh, _, part = distributed
    assert part.index_map.size_global == len(mesh.points)
    owners = np.zeros(len(mesh.points))
    owners[part.node_ids[: part.index_map.size_local]] = 1.0
    np.testing.assert_array_equal(comm.allreduce(owners), 1.0)


def test_scatter_brings_the_owners_values(distributed):
    import dolfinx

    _, mesh, _, part = distributed
    values = np.random.default_rng(3).normal(size=(len(mesh.points), 3))
    vector = dolfinx.la.vector(part.index_map, 3)
    rows = vector.array.reshape(-1, 3)
    rows[:] = np.nan
    rows[: part.index_map.size_local] = values[part.node_ids[: part.index_map.size_local]]
    vector.scatter_forward()
    np.testing.assert_array_equal(rows, values[part.node_ids])


@pytest.mark.serial
def test_split_bodies_are_cut_into_strips(rng):
    """A long body in no order, split into four, beside a small one that stays whole."""
    from flexfem.mesh.distributed.partition import partition_bodies, strips

    long = ff.SurfaceMesh.rectangle("long", (1.0, 10.0), (4, 40))
    mesh = ff.SurfaceMesh.join([long, ff.SurfaceMesh.rectangle("small", (1.0, 1.0), (2, 2))])
    order = rng.permutation(320)
    triangles = np.concatenate([mesh.triangles[:320][order], mesh.triangles[320:]])
    mesh = ff.SurfaceMesh(mesh.points, triangles, mesh.bodies)
    parts = partition_bodies([320, 8], [3, 3], {}, 4, split_above=100)
    ranks = np.concatenate([strips(mesh, mesh.bodies["long"], parts[0]), parts[1]])
    assert np.bincount(ranks).tolist() == [82, 82, 82, 82]
    assert (ranks[320:] == 3).all()
    over = mesh.topology.neighbours
    cut = (over >= 0) & (ranks[over] != ranks[:, np.newaxis])
    # Three cuts of four squares' width; cuts along the number alone meet nearly every triangle
    assert cut.any(axis=1).sum() < 3 * 3 * 4
