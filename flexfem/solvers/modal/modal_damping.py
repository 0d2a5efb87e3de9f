# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dampers of the modes of a model without stress, see :class:`flexfem.ModalDamping`."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import scipy.linalg

from flexfem._types import BoolArray, FloatArray
from flexfem.layout.elements import DampedElements
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.modal_damping import ModalDamping
from flexfem.solvers.modal.linearization import Linearization
from flexfem.solvers.modal.modes import solve_pencil
from flexfem.solvers.modal.pencil import Pencil
from flexfem.system.build import build
from flexfem.system.modal_dampers import ModalDampers, StrainModes, row_of, strain_of
from flexfem.system.system import BlockPart, System

__all__ = ["attach_modal_damping"]

#: Relative residual of the squared frequencies: forces are equal on ranks as shapes are.
_ACCURACY = 1e-11
#: The same above which the ratio of a mode, or its shape, would be another one.
_WRONG = 1e-6
#: Modes computed beyond those that are asked for.
_MORE = 3
#: Relative difference of frequencies below which modes are one with several shapes.
_EQUAL = 1e-5
#: Least part of a mode's strain energy in the damped bodies.
_OWN = 0.5


def attach_modal_damping(serial: NumberedModel, system: System, split_above: int) -> None:
    """Give a system the dampers of its model's modes, if it has any (collective).

    The modes are those of a second system of the same model, without velocities, loads and initial
    strains, with the elements on the same ranks.

    Raises:
        ValueError: modes cannot be computed, or a function of ratios fails; on all ranks.
    """
    dampings = serial.model.modal_dampings
    if not dampings:
        return
    twin = build(serial, system.comm, split_above)
    omega, shapes = _elastic_modes(twin, dampings)
    found = [_dampers(twin, damping, omega, shapes) for damping in dampings]
    parts: dict[int, StrainModes] = {}
    for k, part in enumerate(system.parts):
        if part.elements is not None and k in found[0].parts:
            own = [dampers.parts[k] for dampers in found]
            strains = [strain for modes in own for strain in modes.strains]
            stresses = np.concatenate([modes.stresses for modes in own])
            parts[k] = StrainModes(part.block, part.elements, strains, stresses)
    factors = np.concatenate([dampers.factors for dampers in found])
    system.modal_dampers = ModalDampers(system.comm, _owner(dampings), factors, parts)


def _elastic_modes(twin: System, dampings: Sequence[ModalDamping]) -> tuple[FloatArray, FloatArray]:
    """Frequencies (k,), rad/s, and shapes (k, n) of unit modal mass of the lowest elastic modes."""
    owner = _owner(dampings)
    linearization = _stress_free(twin)
    pencil = Pencil.of(linearization).undamped()
    if not pencil.symmetric:
        raise ValueError(f"{owner}: the model has a stiffness that is not symmetric without stress")
    count = max(damping.count for damping in dampings)
    rows = twin.constraints
    rigid = int(twin.comm.allreduce(int(np.sum(rows.owned * rows.rigid))))
    freedoms = max(twin.unknowns - rigid, 1)
    asked = min(count + 6, freedoms)
    while True:
        solution = solve_pencil(pencil, asked, _MORE, 0.0, _ACCURACY)
        if solution.failure:
            raise ValueError(f"{owner}: {solution.failure}")
        elastic = np.flatnonzero(~solution.zero & (solution.values.imag > 0.0))
        zeros = len(solution.values) - len(elastic)
        if len(elastic) >= count or asked == freedoms or zeros + count <= asked:
            break
        asked = min(zeros + count, freedoms)
    if len(elastic) < min(count, freedoms - zeros):
        raise ValueError(f"{owner}: only {len(elastic)} of {count} modes converged, ask for fewer")
    if not len(elastic):
        raise ValueError(f"{owner}: the model has no elastic modes")
    wrong = int(solution.doubtful(_WRONG)[elastic[:count]].sum()) + (solution.missing or 0)
    if wrong:
        raise ValueError(
            f"{owner}: {wrong} of {count} modes are inaccurate or were not found, ask for fewer"
        )
    shapes = np.ascontiguousarray(solution.vectors[elastic].real)
    return solution.values[elastic].imag, _orthonormal(linearization, pencil, shapes)


def _owner(dampings: Sequence[ModalDamping]) -> str:
    return " and ".join(f'ModalDamping "{damping.name}"' for damping in dampings)


def _stress_free(twin: System) -> Linearization:
    """Linearise at rest, without loads, gravity and initial strains (collective)."""
    for part in twin.parts:
        part.block.velocity[:] = part.block.acceleration[:] = 0.0
    twin.set_time(0.0)
    twin.set_initial_strains(0.0)
    twin.factors[:] = 0.0
    twin.gravity = np.zeros(3)
    linearization = Linearization(twin)
    linearization.evaluate(np.zeros(twin.constraints.size))
    return linearization


def _orthonormal(linearization: Linearization, pencil: Pencil, shapes: FloatArray) -> FloatArray:
    """Shapes (k, n) of unit modal mass, those of equal frequencies made orthogonal (collective)."""
    momenta = linearization.multiply(pencil.matrices.mass, shapes.astype(np.complex128)).real
    gram = linearization.total(shapes @ momenta.T).real
    lower = np.linalg.cholesky(0.5 * (gram + gram.T))
    found: FloatArray = scipy.linalg.solve_triangular(lower, shapes, lower=True)
    return found


def _dampers(
    twin: System, damping: ModalDamping, omega: FloatArray, shapes: FloatArray
) -> ModalDampers:
    """The dampers of the modes that store most of their energy in the damped bodies."""
    last = min(damping.count, len(omega)) - 1
    omega = omega[: int(np.sum(omega <= (1.0 + _EQUAL) * omega[last]))]
    parts, energies = _strain_modes(twin, damping, shapes[: len(omega)])
    ratios = _ratios(damping, omega)
    # any shapes are found of one frequency; wanted are those of damped and of other bodies
    turn = twin.comm.bcast(_separated(omega, energies))
    omega = np.sqrt(turn**2 @ omega**2)
    shares = np.einsum("ki,ij,kj->k", turn, energies, turn) / omega**2
    kept = np.flatnonzero(shares >= _OWN).tolist()
    factors = 2.0 * ratios[kept] / (omega[kept] ** 3 * shares[kept] ** 2)
    chosen = {k: _combined(own, turn[kept]) for k, own in parts.items()}
    return ModalDampers(twin.comm, _owner([damping]), factors, chosen)


def _separated(omega: FloatArray, energies: FloatArray) -> FloatArray:
    """Rotation (k, k) of modes among those of one frequency that makes energies (k, k) diagonal."""
    turn = np.zeros_like(energies)
    for own in _of_one_frequency(omega):
        turn[own, own] = np.linalg.eigh(energies[own, own])[1].T
    return turn


def _of_one_frequency(omega: FloatArray) -> list[slice]:
    """Modes (k,) of each frequency."""
    breaks = np.flatnonzero(omega[1:] > (1.0 + _EQUAL) * omega[:-1]) + 1
    return [slice(*ends) for ends in pairwise([0, *breaks.tolist(), len(omega)])]


def _combined(modes: StrainModes, turn: FloatArray) -> StrainModes:
    """Combinations (m, k) of modes."""
    groups = [np.array(group) for group in zip(*modes.strains, strict=True)]
    strains = [[np.tensordot(row, group, 1) for group in groups] for row in turn]
    return replace(modes, strains=strains, stresses=turn @ modes.stresses)


def _strain_modes(
    twin: System, damping: ModalDamping, shapes: FloatArray
) -> tuple[dict[int, StrainModes], FloatArray]:
    """Strains of shapes (k, n) in the damped bodies by part, and twice their energies (k, k), J."""
    parts: dict[int, StrainModes] = {}
    energies, first = np.zeros((len(shapes), len(shapes))), 0
    for number, part in enumerate(twin.parts):
        block, elements, size = part.block, part.elements, part.block.sizes[0]
        own, first = shapes[:, first : first + size], first + size
        if not isinstance(elements, DampedElements):
            continue
        chosen = _chosen(part, damping)
        strains, stresses = [], []
        for shape in own:
            block.owned_step[:] = shape.reshape(-1, block.width)
            block.spread_step()
            whole = strain_of(elements, block.frames, block.step)
            kept, forces = elements.strain_products(whole, chosen)
            strains.append(kept)
            stresses.append(row_of(forces))
        shape_of_rows = len(shapes), len(stresses[0])
        rows = np.array(stresses).reshape(shape_of_rows)
        energies += rows @ np.array([row_of(kept) for kept in strains]).reshape(rows.shape).T
        parts[number] = StrainModes(block, elements, strains, rows)
    return parts, np.asarray(twin.comm.allreduce(energies, op=MPI.SUM))


def _chosen(part: BlockPart, damping: ModalDamping) -> BoolArray:
    """(m,) True for the cells of the damped bodies."""
    assert part.elements is not None
    names = damping.bodies
    damped = [names is None or body.name in names for body in part.family.bodies]
    return np.array(damped, dtype=np.bool_)[part.elements.body]


def _ratios(damping: ModalDamping, omega: FloatArray) -> FloatArray:
    """Ratios (k,), the same for modes of the same frequency."""
    ratios = damping.ratios(omega / (2.0 * np.pi)).copy()
    for own in _of_one_frequency(omega):
        ratios[own] = ratios[own.start]
    return ratios
