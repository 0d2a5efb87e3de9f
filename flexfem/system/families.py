# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks and element families of the flexible bodies on the ranks (collective)."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._types import IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.elements.director_shells import DirectorShells
from flexfem.elements.floating_bodies import FloatingBodies, FloatingGroup
from flexfem.elements.nurbs_beam import NurbsBeams, NurbsCells
from flexfem.elements.rotation_free_shells import RotationFreeShells
from flexfem.elements.se3_beam import BeamCells, SE3Beams
from flexfem.materials.section import Section
from flexfem.mesh.beam_mesh import create_beam_mesh
from flexfem.mesh.shell_mesh import create_shell_mesh
from flexfem.model.bodies import Beam
from flexfem.system.assembly import Assembly
from flexfem.system.director_surface import director_cells
from flexfem.system.floating_nodes import body_data
from flexfem.system.nurbs_lines import NurbsLines
from flexfem.system.placement import Placement
from flexfem.system.shell_cells import shell_cells, shell_laws

__all__ = ["director_block", "floating_block", "nurbs_block", "se3_block", "shell_block"]

#: of the messages that set up the exchange of ghosts
_TAG = 1201


def se3_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, SE3Beams]:
    """Nodes and elements of all SE(3) beams."""
    beams = serial.model.beams_of("se3")
    destination = np.concatenate(placement.cells_of(beams))
    mesh = create_beam_mesh(comm, serial.points, serial.cells.cells, destination)
    data, ids = serial.cells, mesh.cell_ids
    mine = BeamCells(
        mesh.cells, data.body[ids], data.section[ids], data.frames[ids], data.damping[ids]
    )
    frames = serial.frames[mesh.node_ids]
    block = FrameBlock(
        "beams", comm, frames, serial.velocities[mesh.node_ids], mesh.node_ids, mesh.index_map,
        inertial=True, elements=mesh.cell_ids,
    )  # fmt: skip
    owners = _owners(beams, serial.sections)
    return block, SE3Beams(comm, mine, serial.sections, owners, frames)


def nurbs_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, NurbsBeams]:
    """Control points and elements of all NURBS beams."""
    curves = serial.curves
    assert curves is not None
    ranks = placement.cells_of(curves.beams)
    owner = _owners_of_nodes(curves, ranks)
    chosen = [np.flatnonzero(rank == comm.rank) for rank in ranks]
    touched = [curves.nodes(b)[cells].ravel() for b, cells in enumerate(chosen)]
    ids, index_map = _distributed(comm, owner, np.concatenate(touched))
    frames = curves.frames[ids]
    block = FrameBlock(
        "nurbs_beams", comm, frames, curves.velocities[ids], ids, index_map, inertial=True
    )
    data = _cells(curves, chosen, block)
    return block, NurbsBeams(
        comm, data, curves.sections, _owners(curves.beams, curves.sections), frames
    )


def _distributed(comm: MPI.Intracomm, owner: IntArray, touched: IntArray) -> tuple[IntArray, Any]:
    """Nodes of this rank, ghosts last, and their distribution (collective).

    Args:
        comm: communicator.
        owner: rank of every node.
        touched: nodes that the elements of this rank have, any number of times.
    """
    from dolfinx.common import IndexMap

    number = np.empty(len(owner), dtype=np.int64)
    number[np.argsort(owner, kind="stable")] = np.arange(len(owner))
    mine = np.flatnonzero(owner == comm.rank)
    ghosts = np.setdiff1d(touched, mine)
    ids = np.concatenate([mine, ghosts]).astype(np.int64)
    index_map = IndexMap(
        comm, len(mine), number[ghosts].astype(np.int64), owner[ghosts].astype(np.int32), _TAG
    )
    return ids, index_map


def _owners_of_nodes(curves: NurbsLines, ranks: Sequence[IntArray]) -> IntArray:
    """Rank of every control point: the lowest of those of the elements that it touches."""
    owner = np.full(len(curves.frames), np.iinfo(np.int64).max)
    for beam, rank in enumerate(ranks):
        nodes = curves.nodes(beam)
        np.minimum.at(owner, nodes, np.broadcast_to(rank[:, np.newaxis], nodes.shape))
    return owner


def _cells(curves: NurbsLines, chosen: Sequence[IntArray], block: FrameBlock) -> list[NurbsCells]:
    """Elements of this rank by kind; every rank has the same kinds, maybe without elements."""
    data = []
    for (_, vectors), group in groupby(curves.by_kind(), curves.kind):
        beams = list(group)
        counts = [len(chosen[b]) for b in beams]
        nodes = np.concatenate([curves.nodes(b)[chosen[b]] for b in beams])
        data.append(
            NurbsCells(
                nodes=block.local_index(nodes),
                body=np.repeat(curves.numbers[beams], counts),
                section=np.repeat(curves.section[beams], counts),
                shape=np.concatenate([curves.parts[b].shape[chosen[b]] for b in beams]),
                damping=np.repeat([curves.beams[b].damping for b in beams], counts),
                vectors=vectors,
            )
        )
    return data


def _owners(beams: Sequence[Beam], sections: Sequence[Section]) -> list[str]:
    """What messages call each section: the first beam that has it."""
    first = {id(b.section): f'Beam "{b.name}"' for b in reversed(beams)}
    return [first[id(section)] for section in sections]


def shell_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, RotationFreeShells]:
    """Nodes and triangles of all rotation-free shells."""
    surface = serial.surface
    assert surface is not None
    # averaged slopes are those of neighbours, too
    rings = 2 if surface.averaged.any() else 1
    mesh = create_shell_mesh(comm, surface.mesh, placement.triangles, rings)
    ids = mesh.node_ids
    held = surface.held[ids] if surface.held.any() else None
    block = FrameBlock(
        "shells", comm, surface.frames[ids], surface.velocities[ids], ids, mesh.index_map,
        inertial=True, width=3, held=held,
    )  # fmt: skip
    own = np.sort(mesh.cell_ids[: mesh.owned])
    kinds = np.column_stack([surface.averaged, surface.smoothed])
    groups = [
        shell_cells(surface, rows[(kinds[rows] == kind).all(axis=1)], bool(kind[0]), bool(kind[1]),
                    numbers, law, mesh.local)
        for numbers, law in shell_laws(comm, surface)
        for rows in [own[np.isin(surface.section[own], numbers)]]
        for kind in np.unique(kinds[np.isin(surface.section, numbers)], axis=0)
    ]  # fmt: skip
    return block, RotationFreeShells(groups, block)


def director_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, DirectorShells]:
    """Nodes and triangles of all director shells."""
    surface = serial.surface
    assert surface is not None
    assert surface.directors is not None
    nodes, ranks = surface.directors.all, placement.triangles
    owner = np.full(len(surface.frames), np.iinfo(np.int64).max)
    np.minimum.at(owner, nodes.ravel(), np.repeat(ranks, nodes.shape[1]))
    own = np.flatnonzero(ranks == comm.rank)
    ids, index_map = _distributed(comm, owner, nodes[own].ravel())
    block = FrameBlock(
        "shells", comm, surface.frames[ids], surface.velocities[ids], ids, index_map,
        inertial=True, held=surface.held[ids],
    )  # fmt: skip
    cells = director_cells(surface, own, shell_laws(comm, surface), block.local_index)
    return block, DirectorShells(cells, block)


def floating_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, FloatingBodies]:
    """Nodes and integrals of all bodies in floating frames, each of them whole on one rank."""
    nodes = serial.floating
    assert nodes is not None
    none = np.empty(0, dtype=np.int64)
    ids, index_map = _distributed(comm, placement.floating[nodes.body_of_node], none)
    block = FrameBlock(
        "floating_bodies", comm, nodes.frames[ids], nodes.velocities[ids], ids, index_map,
        inertial=True, held=nodes.held[ids] if nodes.held.any() else None,
    )  # fmt: skip
    groups = []
    for kind in nodes.kinds:
        own = [number for number in kind if placement.floating[number] == comm.rank]
        if own:
            body = nodes.bodies[kind[0]]
            every = nodes.first[own][:, np.newaxis] + np.arange(body.nodes)
            local = block.local_index(every).astype(np.int32)
            groups.append(FloatingGroup(body_data(body), local, np.array(own, dtype=np.int64)))
    return block, FloatingBodies(groups)
