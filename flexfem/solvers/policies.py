# SPDX-License-Identifier: LGPL-3.0-or-later
"""Policies of the Newton method by name: when the iteration matrix is factorised.

``updated`` uses a new matrix in every iteration, ``material`` the same without geometric
stiffness. ``frozen`` keeps the factors of the bodies for each step size. ``auto`` does the same,
but renews them if the iteration contracts slowly. All fall back to the exact fresh matrix for
a step on which they fail; a further failure is left to the driver, which halves the step.

Assembled matrices have nothing of the friction of contacts, which acts beside factors. With it,
``updated`` is ``frozen``, and there is no fallback.
"""

from flexfem.solvers.frozen.policy import AutoPolicy, FrozenPolicy
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.newton.iteration import NewtonOptions
from flexfem.solvers.newton.policy import MaterialPolicy, Policy, UpdatedPolicy
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import System

__all__ = ["create_policy"]


def create_policy(
    name: str,
    system: System,
    options: NewtonOptions,
    tangent: TangentSolver,
    mechanics: Mechanics = END_POINT,
) -> Policy:
    """Policy of the given name for some equations: "updated", "material", "frozen" or "auto"."""
    kinds: dict[str, type[UpdatedPolicy] | type[FrozenPolicy]] = {
        "updated": UpdatedPolicy,
        "material": MaterialPolicy,
        "frozen": FrozenPolicy,
        "auto": AutoPolicy,
    }
    rub = any(contacts.rubs for contacts in system.contacts)
    kind = FrozenPolicy if rub and name == "updated" else kinds[name]
    return kind(system, options, tangent, mechanics)
