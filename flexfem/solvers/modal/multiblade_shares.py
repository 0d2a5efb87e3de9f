# SPDX-License-Identifier: LGPL-3.0-or-later
"""What moves in modes in multiblade coordinates: support, drive, blades together or in whirls."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import se3
from flexfem.solvers.modal.mode_errors import ComplexArray
from flexfem.solvers.modal.mode_shapes import Modes
from flexfem.solvers.modal.multiblade import MultibladeLinearization, harmonics

__all__ = ["SHARES", "shares"]

#: Parts of the kinetic energy, in the order of their columns.
SHARES = ("support", "drive", "collective", "forward", "backward", "other")


def shares(modes: Modes) -> FloatArray:
    """Shares of the modes' energies, (k, 8) (collective).

    Columns: those of ``SHARES``, of 1; the share of the motion along the axis in that of the
    blades relative to the rotor's first body, and in the motion of this body.

    The blades' motion ``Re((a cos psi_k + b sin psi_k) exp(i omega t))`` is the sum of one that
    travels with the rotation, of amplitude ``(a + i b)/2``, and one against it, ``(a - i b)/2``.
    """
    lin = modes.linearization
    assert isinstance(lin, MultibladeLinearization)
    mass = lin.matrices().mass
    moved = lin.multiply(lin.coordinates(), modes.shapes)
    moved[:, lin.states_range] = 0.0
    twists, axis = _reference(lin, moved)
    spin = twists[:, 3:] @ axis
    carried, spun = _rigid(lin, twists, on_blades=True), _rigid(lin, _about(lin, axis, spin))
    blades = _of_blades(lin, moved) - carried

    def energies(motions: ComplexArray) -> FloatArray:
        work: ComplexArray = lin.total(np.sum(motions.conj() * lin.multiply(mass, motions), axis=1))
        return work.real

    sense = 1.0j if lin.spin >= 0.0 else -1.0j
    own = [energies(_pattern(lin, blades, 0, 0))]
    own += [energies(_whirl(lin, blades, unit)) for unit in (sense, -sense)]
    others = np.maximum(energies(blades) - sum(own), 0.0)
    support = energies(moved - blades - spun)
    found = np.stack([support, energies(spun), *own, others], axis=1)
    found /= np.maximum(found.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    ways = np.abs(twists[:, :3]) ** 2
    way = np.abs(twists[:, :3] @ axis) ** 2 / np.maximum(ways.sum(axis=1), np.finfo(float).tiny)
    return np.column_stack([found, _flap(lin, blades, axis), way])


def _reference(
    lin: MultibladeLinearization, moved: ComplexArray
) -> tuple[ComplexArray, FloatArray]:
    """Motion (k, 6) of the rotor's first body in inertial axes, of its origin, and the axis."""
    system, at = lin.system, [0]
    for part in system.parts:
        at.append(at[-1] + part.block.sizes[0])

    def values(part: int, node: int) -> ComplexArray:
        block = system.parts[part].block
        first = at[part] + block.width * node
        own: ComplexArray = moved[:, first : first + 6]
        R = se3.rotation(block.frames[node])
        return np.concatenate([own[:, :3] @ R.T, own[:, 3:] @ R.T], axis=1)

    found = lin.rotor.of_reference(values)
    return found, lin.rotor.present(system)[0]


def _about(lin: MultibladeLinearization, axis: FloatArray, spin: ComplexArray) -> ComplexArray:
    """Rotations (k, 6) of the rotor's first body about the axis, as it is carried by it."""
    _, centre = lin.rotor.present(lin.system)
    place = _place(lin)
    unit = np.concatenate([np.cross(axis, place - centre), axis])
    found: ComplexArray = spin[:, np.newaxis] * unit
    return found


def _place(lin: MultibladeLinearization) -> FloatArray:
    """Position of the rotor's first body."""
    parts = lin.system.parts
    return lin.rotor.of_reference(lambda part, node: se3.position(parts[part].block.frames[node]))


def _rigid(
    lin: MultibladeLinearization, twists: ComplexArray, *, on_blades: bool = False
) -> ComplexArray:
    """Motions (k, n) of this rank's nodes that turn as one body with motions (k, 6) of the first.

    Args:
        lin: the rotor.
        twists: motion of the first body's origin, and rotation, in inertial axes.
        on_blades: True for the nodes of blades alone.
    """
    place, out = _place(lin), []
    for part, nodes in zip(lin.system.parts, lin.rotor.nodes, strict=True):
        block = part.block
        frames = block.frames[: block.owned]
        R, arms = se3.rotation(frames), se3.position(frames) - place
        used = (nodes.blade >= 0 if on_blades else nodes.turning)[: block.owned]
        moving = twists[:, np.newaxis, :3] + np.cross(twists[:, np.newaxis, 3:], arms)
        local = np.einsum("nji,knj->kni", R, moving)
        turned = np.einsum("nji,kj->kni", R, twists[:, 3:])
        both = np.concatenate([local, turned], axis=2)[:, :, : block.width]
        out.append((both * used[:, np.newaxis]).reshape(len(twists), -1))
    out.append(np.zeros((len(twists), lin.states.count)))
    return np.concatenate(out, axis=1)


def _of_blades(lin: MultibladeLinearization, moved: ComplexArray) -> ComplexArray:
    """The same motions of nodes of blades alone."""
    matrix = lin.matrix(np.eye(len(lin.rotor.angles)))
    found = lin.multiply(matrix, moved)
    found[:, lin.states_range] = 0.0
    return found


def _pattern(
    lin: MultibladeLinearization, blades: ComplexArray, to: int, of: int, size: float = 1.0
) -> ComplexArray:
    """Part of the blades' motions in one multiblade coordinate, moved to another."""
    columns = harmonics(lin.rotor.angles)
    return lin.multiply(lin.matrix(size * np.outer(columns[:, to], columns[:, of])), blades)


def _whirl(lin: MultibladeLinearization, blades: ComplexArray, unit: complex) -> ComplexArray:
    """Cosine part of the blades' motions that travel in one sense."""
    size = np.sqrt(0.5)
    return _pattern(lin, blades, 1, 1, size) + unit * _pattern(lin, blades, 1, 2, size)


def _flap(lin: MultibladeLinearization, blades: ComplexArray, axis: FloatArray) -> FloatArray:
    """(k,) share of the motion along the axis in the squares of displacements of the blades."""
    along, every, at = np.zeros(len(blades)), np.zeros(len(blades)), 0
    for part in lin.system.parts:
        block = part.block
        own = blades[:, at : at + block.sizes[0]].reshape(len(blades), -1, block.width)[:, :, :3]
        at += block.sizes[0]
        ways = se3.rotation(block.frames[: block.owned]).transpose(0, 2, 1) @ axis
        along += (np.abs(np.einsum("kni,ni->kn", own, ways)) ** 2).sum(axis=1)
        every += (np.abs(own) ** 2).sum(axis=(1, 2))
    both = lin.total(np.array([along, every]))
    share: FloatArray = both[0] / np.maximum(both[1], np.finfo(float).tiny)
    return share
