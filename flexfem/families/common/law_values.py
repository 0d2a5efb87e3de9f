# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of user-defined laws, compiled once for all sections that differ in parameters only."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.forms.beam_law import LawExpressions, law_form
from flexfem.kernels.driver import NO_NODES, CellKernel, Cells, cell_kernel, evaluate, plain_cells
from flexfem.kernels.ffcx import compile_kernel
from flexfem.materials.matrices import check_definite
from flexfem.materials.section_law import SectionLaw

__all__ = ["LawValues"]

#: Viscous stress at rest that still counts as round-off, relative to the viscosity.
_AT_REST = 1e-12
#: Constants of kernels that have none.
_NOTHING = np.zeros(1)


class LawValues:
    """Energies, stresses and their derivatives at given strains.

    Attributes:
        parameters: (s, p) of each section.
        viscous: True if the law has a dissipation potential.
    """

    def __init__(
        self, comm: MPI.Intracomm, law: LawExpressions, laws: Sequence[SectionLaw],
        owners: Sequence[str],
    ) -> None:  # fmt: skip
        """Compile the law and check it at zero strain (collective).

        Args:
            comm: communicator.
            law: the form that all of the laws share.
            laws: the law of each section, with its parameters.
            owners: names of the sections in messages.

        Raises:
            ValueError: the law cannot be compiled, or is not usable at zero strain; on all ranks.
        """
        self.parameters = np.array([list(p.parameters.values()) for p in laws])
        self.viscous = law.dissipation is not None
        self._kernel = _compile(comm, law, f"{owners[0]}: {laws[0].owner}")
        self._cells = self._room(0)
        rest = np.zeros((len(laws), 6))
        values = self.at(rest, rest, np.arange(len(laws)))
        for one, owner, row in zip(laws, owners, values, strict=True):
            where = f"{owner}: {one.owner}"
            _check_energy(where, row, one.allow_unstable)
            if self.viscous:
                _check_dissipation(where, row[43:49], row[49:].reshape(6, 6))

    def at(self, strain: FloatArray, rate: FloatArray, sections: IntArray) -> FloatArray:
        """Values (m, k) of ``forms.beam_law.LawForm`` at strains and their rates (m, 6)."""
        count = len(strain)
        if len(self._cells.own) != count:  # mostly that of the last call: a new record is slow
            self._cells = self._room(count)
        cells, values = self._cells, np.empty((count, self._kernel.size))
        cells.own[:, :6], cells.own[:, 6:], cells.section[:] = strain, rate, sections
        evaluate(self._kernel.memory, cells.memory, NO_NODES, _NOTHING, values)
        return values

    def _room(self, count: int) -> Cells:
        """Cells for a number of strains and their rates."""
        section = np.zeros(count, dtype=np.int64)
        return plain_cells(np.empty((count, 12)), section=section, sections=self.parameters)


def _compile(comm: MPI.Intracomm, law: LawExpressions, owner: str) -> CellKernel:
    """Compile a law by itself, so that an error of the compiler is raised here."""
    form = law_form(law)
    try:
        compiled = compile_kernel(comm, form.form, form.coefficients)
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{owner}: cannot be compiled: {reason[:200]}") from error
    names = ("strain", "rate", "parameters")[: len(form.coefficients)]
    own = {"strain": (0, 6), "rate": (6, 6)}
    section = {"parameters": (0, law.count)} if law.count else {}
    return cell_kernel(compiled, form.size, names, {}, own, section)


def _check_energy(owner: str, values: FloatArray, allow_unstable: bool) -> None:
    """Check energy, stress and stiffness at zero strain."""
    for what, part in (
        ("energy", values[:1]), ("stress", values[1:7]), ("stiffness", values[7:43])
    ):  # fmt: skip
        if not np.isfinite(part).all():
            bad = part[~np.isfinite(part)][0]
            raise ValueError(f"{owner}: {what} at zero strain must be finite, got {bad:g}")
    if not allow_unstable:
        what = "stiffness at zero strain (unless allow_unstable=True)"
        check_definite(owner, what, values[7:43].reshape(6, 6), semidefinite=False)


def _check_dissipation(owner: str, stress: FloatArray, viscosity: FloatArray) -> None:
    """Check that viscous stress vanishes at rest and that slow motion dissipates energy."""
    if not (np.isfinite(stress).all() and np.isfinite(viscosity).all()):
        raise ValueError(
            f"{owner}: viscous stress and viscosity at zero strain and rate must be finite, got "
            f"{stress.tolist()} and a matrix with the sum {viscosity.sum():g}"
        )
    if np.abs(stress).max() > _AT_REST * np.abs(viscosity).max():
        raise ValueError(
            f"{owner}: the viscous stress at zero strain rate must be zero, got {stress.tolist()}"
        )
    check_definite(owner, "viscosity at zero strain and rate", viscosity, semidefinite=True)
