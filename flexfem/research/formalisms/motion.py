# SPDX-License-Identifier: LGPL-3.0-or-later
"""A mechanism under one formalism as equations in a vector of coordinates, to be integrated.

Lagrange's and Gibbs and Appell's equations have multipliers and are of second order: they go to
generalized-alpha as they are. Maggi's and Hamilton's have schemes of their own, which use the same
object: see ``schemes.maggi_alpha`` and ``schemes.hamilton_midpoint``.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.research.equations.vector_equations import Motion, Picture, VectorEquations
from flexfem.research.formalisms.description.joints import End
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import consistent_start, saddle, unknowns

__all__ = ["FormalismMotion"]

#: Cells of meshes as VTK calls them.
_VTK = {"interval": "line", "triangle": "triangle", "tetrahedron": "tetra"}


class FormalismMotion(VectorEquations):
    """Equations of motion of a mechanism by one formalism.

    The history has the position of the observed end, ``x, y, z`` (m), and the ``energy`` (J).

    Attributes:
        model: the equations of the mechanism.
        formalism: name of the formalism.
    """

    columns: Sequence[str] = ("x", "y", "z", "energy")

    def __init__(self, model: MechanismEquations, formalism: str) -> None:
        """Bring the declared state to the constraints.

        Raises:
            InputError: that is impossible, or constraints are redundant.
        """
        self.model, self.formalism = model, formalism
        self.size, self.multipliers = model.size, model.constraints
        self._start = consistent_start(model)
        self._form = "gibbs_appell" if formalism == "gibbs_appell" else "lagrange"
        declared = model.mechanism
        self._end = declared.observed or End(declared.bodies[-1].name)

    def start(self) -> tuple[FloatArray, FloatArray]:
        """See :class:`Equations`."""
        return self._start

    def forces(self, t: float, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """F(q, q', q'') - Q: the equations of motion without constraints, (n,)."""
        return self.model.vector(self._form, q, v, a) - self.model.forces(q, t)

    def residual(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
    ) -> FloatArray:
        """See :class:`Equations`."""
        r = self.forces(t, q, v, a) + multipliers @ self.model.jacobian(q)
        return np.concatenate([r, self.model.gaps(q, t)])

    def force_tangent(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray,
        dv: float, da: float,
    ) -> FloatArray:  # fmt: skip
        """Derivative (n, n) of `forces` and of the constraint forces; see `tangent`."""
        K = self.model.matrix("tangent", (1.0, dv, da), q, v, a)
        self.model.add_constraint_stiffness(q, t, multipliers, K)
        return K

    def tangent(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray,
        dv: float, da: float,
    ) -> FloatArray:  # fmt: skip
        """See :class:`Equations`."""
        K = self.force_tangent(t, q, v, a, multipliers, dv, da)
        return saddle(K, self.model.jacobian(q))

    def observe(self, motion: Motion) -> Sequence[float]:
        """See :class:`Equations`."""
        position = self.model.position(self._end, motion.q)
        return [*position, sum(self.model.energy(motion.q, motion.v))]

    def pictures(self, motion: Motion) -> Mapping[str, Picture]:
        """Series ``bodies_<cells>`` of the deformed bodies, one for each type of cell.

        Point data: ``displacement`` from the start, m. Cell data: ``body``, its number.
        """
        parts: dict[str, list[tuple[Any, ...]]] = {}
        for number, nodes in enumerate(self.model.nodes.values()):
            used, cells = nodes.corners()
            now, then = nodes.positions(motion.q)[used], nodes.positions(self._start[0])[used]
            own = parts.setdefault(_VTK[nodes.body.matter.cell], [])
            first = sum(len(part[0]) for part in own)
            own.append((now, now - then, cells + first, np.full(len(cells), number)))
        pictures = {}
        for kind, own in parts.items():
            points, moved, cells, bodies = (np.concatenate(part) for part in zip(*own, strict=True))
            pictures[f"bodies_{kind}"] = Picture(
                points, cells, kind, {"displacement": moved}, {"body": bodies}
            )
        return pictures

    def summary(self) -> Mapping[str, Any]:
        """See :class:`Equations`."""
        return {
            "formalism": self.formalism,
            "unknowns": unknowns(self.formalism, self.model),
            "multipliers": 0 if self.formalism == "maggi" else self.multipliers,
            "coordinates": self.size,
            "elements": self.model.elements,
        }

    def identity(self) -> Mapping[str, str]:
        """See :class:`Equations`."""
        return {**super().identity(), "formalism": self.formalism}
