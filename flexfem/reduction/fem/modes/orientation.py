# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signs of modes, and directions of those of one frequency, equal on any number of ranks."""

from itertools import pairwise

import numpy as np
import ufl
from dolfinx import fem

from flexfem._types import FloatArray
from flexfem.kernels.ffcx_options import compiled_form
from flexfem.reduction.fem.body.blocks import assemble_rows, own_rows, projected
from flexfem.reduction.fem.body.linear_body import LinearBody

__all__ = ["Orientation"]

#: Relative difference of eigenvalues up to which modes count as having one frequency.
_EQUAL = 1e-4
#: Frequencies that many modes may share; more get directions that depend on the partition.
_FAMILY = 8


class Orientation:
    """Fixed forces without any symmetry that distinguish modes.

    In a family of c modes of one frequency, the first is the only one on which the first force does
    work, the second one that on which the second does and the later ones do not, and so on, and
    all of this work is positive.
    """

    def __init__(self, body: LinearBody, size: float, centre: FloatArray) -> None:
        """Compile and assemble the forces (collective).

        Args:
            body: the body.
            size: of the body, m.
            centre: of the body, m.
        """
        domain, rows = body.space.mesh, own_rows(body.space)
        self._comm = domain.comm
        wave, phase = fem.Constant(domain, np.zeros(3)), fem.Constant(domain, np.zeros(()))
        pull = fem.Constant(domain, np.zeros(3))
        v = ufl.TestFunction(body.space)
        middle = fem.Constant(domain, np.array(centre))
        form = compiled_form(
            sum(
                ufl.cos(ufl.dot(wave, m.position - middle) + phase)
                * ufl.dot(pull, m.displacement(v))
                * ufl.dx(domain, degree=4)
                for m in body.masses
            )
        )
        rng = np.random.default_rng(1)  # arbitrary numbers, the same on all ranks
        self.forces = np.zeros((rows, _FAMILY))
        for i in range(_FAMILY):
            wave.value[:] = rng.uniform(1.0, 6.0, 3) / size
            phase.value[...] = rng.uniform(0.0, 2.0 * np.pi)
            pull.value[:] = rng.uniform(0.5, 1.5, 3)
            self.forces[:, i] = assemble_rows(form, rows)

    def families(self, eigenvalues: FloatArray) -> list[slice]:
        """Runs of equal ones among ascending eigenvalues."""
        count = len(eigenvalues)
        jumps = np.flatnonzero(np.diff(eigenvalues) > _EQUAL * np.abs(eigenvalues[1:])) + 1
        edges = [0, *jumps.tolist(), count]
        return [slice(a, b) for a, b in pairwise(edges) if b > a]

    def turn(self, modes: FloatArray, eigenvalues: FloatArray) -> FloatArray:
        """The modes, each family in its chosen orientation (collective)."""
        work = projected(self._comm, self.forces, modes)
        turned = modes.copy()
        for family in self.families(eigenvalues):
            values = work[:, family]
            # values = L Q, L lower triangular
            q, r = np.linalg.qr(values.T, mode="complete")
            signs = np.sign(np.diagonal(r))
            width = min(len(signs), q.shape[1])
            q[:, :width] *= np.where(signs[:width] < 0.0, -1.0, 1.0)
            turned[:, family] = modes[:, family] @ q
        return turned
