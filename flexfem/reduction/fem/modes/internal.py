# SPDX-License-Identifier: LGPL-3.0-or-later
"""Internal functions of a body with fixed interfaces: modes, inertia-relief functions, or all."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import scipy.linalg

from flexfem._types import BoolArray, FloatArray
from flexfem.reduction.fem.body.blocks import multiply, projected, same_everywhere
from flexfem.reduction.fem.body.ties import Ties
from flexfem.reduction.fem.modes.eigenmodes import dense_modes, sparse_modes
from flexfem.reduction.fem.modes.orientation import Orientation
from flexfem.reduction.fem.modes.response import StaticResponse
from flexfem.reduction.fem.modes.spectrum import Choice, Spectrum, choose_modes

__all__ = ["BASES", "LARGEST", "Pieces", "internal_functions", "orthonormal", "ritz"]

#: Kinds of internal functions.
BASES = ("craig_bampton", "free_free", "full")
#: Unknowns of a mesh up to which all of them may be coordinates.
LARGEST = 1500
#: Unknowns up to which all modes are computed at once.
_DENSE = 300
#: Unknowns for each mode that is computed alone.
_SPARSE = 8
#: Part of a function that is new, relative, below which it is none.
_DEPENDENT = 1e-7


@dataclass(frozen=True, eq=False)
class Pieces:
    """Data that internal functions are computed from; blocks have this rank's rows.

    Attributes:
        stiffness: matrix of all rows.
        mass: matrix of all rows.
        response: static responses, interfaces at rest.
        ties: of the interfaces.
        static: (rows, 6 k) displacements by the interface coordinates.
        rigid: (rows, r) rigid motions that the body has, translations first.
        orientation: of modes.
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    response: StaticResponse
    ties: Ties
    conditions: FloatArray
    static: FloatArray
    rigid: FloatArray
    orientation: Orientation


def internal_functions(owner: str, pieces: Pieces, basis: str, choice: Choice) -> FloatArray:
    """This rank's rows of the functions, orthonormal by mass (collective).

    Args:
        owner: for messages.
        pieces: parts of the modes.
        basis: of BASES.
        choice: number of modes.

    Raises:
        ValueError: more modes than there are.
    """

    def moved(modes: FloatArray) -> FloatArray:
        return _moved_mass(pieces, modes)

    def choose(spectrum: Spectrum) -> FloatArray:
        return choose_modes(owner, choice, spectrum, pieces.orientation, moved)

    size = pieces.stiffness.getSize()[0]
    most = size // _SPARSE
    if basis == "full" or size <= _DENSE:
        every = dense_modes(
            pieces.stiffness, pieces.mass, pieces.response.fixed & ~_pins(pieces), pieces.conditions
        )
        clamped = Spectrum(lambda count: every, len(every[0]))
    else:
        every = None
        clamped = Spectrum(
            lambda count: sparse_modes(
                pieces.stiffness,
                pieces.mass,
                pieces.response.respond,
                pieces.orientation.forces[:, 0],
                count,
            ),
            None,
            most,
        )
    if basis != "free_free" or not pieces.ties.interfaces:
        return choose(clamped)
    if every is not None:
        found = _free_modes(pieces, np.hstack([pieces.static[:, ~pieces.ties.held], every[1]]))
        free = Spectrum(lambda count: found, len(found[0]))
    else:
        inverse = FreeResponse(pieces)
        free = Spectrum(
            lambda count: sparse_modes(
                pieces.stiffness,
                pieces.mass,
                inverse.respond,
                pieces.orientation.forces[:, 0],
                count,
            ),
            None,
            most,
        )
    modes = choose(free)
    inner = modes - pieces.static @ _interface_motion(pieces, modes)
    # responses to the inertia forces of rigid motions: with the static functions these are the
    # attachment functions of a free body
    relief = pieces.response.respond(multiply(pieces.mass, pieces.rigid))
    functions = orthonormal(pieces, np.hstack([relief, inner]))
    values, functions = ritz(pieces, functions)
    return pieces.orientation.turn(functions, values)


def _pins(pieces: Pieces) -> BoolArray:
    """Rows that are fixed though no interface prescribes them."""
    pins = pieces.response.fixed.copy()
    pins[pieces.ties.fixed] = False
    return pins


def _moved_mass(pieces: Pieces, modes: FloatArray) -> FloatArray:
    """Effective modal masses along the axes, relative to the whole mass."""
    comm = pieces.stiffness.comm.tompi4py()
    momenta = multiply(pieces.mass, pieces.rigid)
    whole = np.diagonal(projected(comm, pieces.rigid, momenta))
    part: FloatArray = projected(comm, momenta, modes) ** 2 / whole[:, np.newaxis]
    translations = min(3, pieces.rigid.shape[1] // 2 + pieces.rigid.shape[1] % 2)
    return part[:translations]


def _interface_motion(pieces: Pieces, functions: FloatArray) -> FloatArray:
    """(6 k, m) interface coordinates of functions that are rigid where interfaces are."""
    comm, ties = pieces.stiffness.comm.tompi4py(), pieces.ties
    motion = np.zeros((len(ties.held), functions.shape[1]))
    motion[ties.averaged] = projected(comm, ties.means, functions)
    moved = np.flatnonzero(~ties.held & ~np.isin(np.arange(len(ties.held)), ties.averaged))
    if len(moved):
        own = ties.motion[:, moved]
        gram = projected(comm, own, own)
        scale = 1.0 / np.sqrt(np.diagonal(gram))[:, np.newaxis]
        rhs = scale * projected(comm, own, functions)
        motion[moved] = scale * np.linalg.solve(scale * gram * scale.T, rhs)
    return motion


class FreeResponse:
    """Displacements by forces less their rigid part, interfaces free to move, mean axes."""

    def __init__(self, pieces: Pieces) -> None:
        """Prepare the small matrices (collective)."""
        self._pieces = pieces
        self._comm = pieces.stiffness.comm.tompi4py()
        self._static = pieces.static[:, ~pieces.ties.held]
        self._momenta = multiply(pieces.mass, pieces.rigid)
        self._inertia = projected(self._comm, pieces.rigid, self._momenta)
        k = projected(self._comm, self._static, multiply(pieces.stiffness, self._static))
        self._scale = 1.0 / np.sqrt(np.diagonal(k))[:, np.newaxis]
        values, vectors = np.linalg.eigh(self._scale * (0.5 * (k + k.T)) * self._scale.T)
        # as many zeros as there are rigid motions
        rigid = pieces.rigid.shape[1]
        self._inverse = (vectors[:, rigid:] / values[rigid:]) @ vectors[:, rigid:].T

    def respond(self, force: FloatArray) -> FloatArray:
        """Displacements (rows, columns) (collective)."""
        pieces, comm = self._pieces, self._comm
        rigid, inertia = pieces.rigid, self._inertia
        force = force - self._momenta @ np.linalg.solve(inertia, projected(comm, rigid, force))
        generalised = self._scale * projected(comm, self._static, force)
        u = pieces.response.respond(force)
        u += self._static @ (self._scale * (self._inverse @ generalised))
        u -= rigid @ np.linalg.solve(inertia, projected(comm, self._momenta, u))
        return u


def _free_modes(pieces: Pieces, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Elastic modes in the span of a basis that contains all rigid motions (collective)."""
    comm = pieces.stiffness.comm.tompi4py()
    m = projected(comm, basis, multiply(pieces.mass, basis))
    k = projected(comm, basis, multiply(pieces.stiffness, basis))
    # massless interface coordinates have infinite frequencies
    shift = np.trace(k) / np.trace(m) * 1e-6
    inverse, vectors = scipy.linalg.eigh(m, k + shift * m)
    elastic = slice(0, len(inverse) - pieces.rigid.shape[1])
    inverse, vectors = inverse[elastic], vectors[:, elastic]
    moving = inverse > 1e-12 * inverse.max(initial=0.0)
    values = (1.0 / inverse[moving] - shift)[::-1]
    modes = basis @ (vectors[:, moving] / np.sqrt(inverse[moving]))[:, ::-1]
    return same_everywhere(comm, values), modes


def orthonormal(pieces: Pieces, functions: FloatArray) -> FloatArray:
    """Orthonormal by mass; functions that depend on those before them are left out (collective)."""
    comm = pieces.stiffness.comm.tompi4py()
    kept = np.zeros((len(functions), 0))
    for column in functions.T:
        u = column[:, np.newaxis]
        before = float(projected(comm, u, multiply(pieces.mass, u))[0, 0])
        if before <= 0.0:
            continue
        for _ in range(2):  # twice is enough
            u = u - kept @ projected(comm, kept, multiply(pieces.mass, u))
        after = float(projected(comm, u, multiply(pieces.mass, u))[0, 0])
        if after > _DEPENDENT**2 * before:
            kept = np.hstack([kept, u / np.sqrt(after)])
    return kept


def ritz(pieces: Pieces, functions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn functions that are orthonormal by mass so that they are by stiffness (collective)."""
    comm = pieces.stiffness.comm.tompi4py()
    k = projected(comm, functions, multiply(pieces.stiffness, functions))
    values, vectors = np.linalg.eigh(0.5 * (k + k.T))
    return same_everywhere(comm, values), functions @ same_everywhere(comm, vectors)
