# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice between factors and Krylov methods, and counters of the latter; without PETSc."""

from dataclasses import dataclass, field

__all__ = ["LinearSolver", "SolveCounts"]

#: Unknowns of a body from which ``auto`` iterates: of its steps, where factors of a compact one
#: take some 10 GB and as much time as 20 steps with iterations, and of its masses at the start.
_LARGE, _LARGE_MASSES = 300_000, 20_000
#: Bulk over shear modulus from which ``auto`` does not iterate: iterations grow with its root, some
#: 190 of a solve to 1e-10 here.
_INCOMPRESSIBLE = 100.0


@dataclass
class SolveCounts:
    """Counters of iterative solves on this rank.

    Attributes:
        solves, iterations: their numbers.
        failed: solves that have not converged.
        setups: hierarchies that were made.
    """

    solves: int = 0
    iterations: int = 0
    failed: int = 0
    setups: int = 0


@dataclass(frozen=True)
class LinearSolver:
    """Choice between factors and Krylov methods.

    Attributes:
        kind: "auto", "direct" or "iterative".
        tolerance: relative accuracy of solves by Krylov methods, in the norm of the preconditioned
            residual.
        counts: counters of the run.
    """

    kind: str = "direct"
    tolerance: float = 1e-8
    counts: SolveCounts = field(default_factory=SolveCounts)

    def iterates(self, rows: int, bulk_over_shear: float) -> bool:
        """True for bodies that can be solved iteratively.

        Args:
            rows: their unknowns together.
            bulk_over_shear: the largest ratio of their moduli at small strains.
        """
        suits = rows >= _LARGE and bulk_over_shear <= _INCOMPRESSIBLE
        return self.kind == "iterative" or (self.kind == "auto" and suits)

    def iterates_masses(self, rows: int) -> bool:
        """True for bodies of so many unknowns together: masses need no factorisation."""
        return self.kind == "iterative" or rows >= _LARGE_MASSES
