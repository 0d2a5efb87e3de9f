# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid-body motions without stiffness, in searches for equilibria."""

from collections.abc import Iterator

from flexfem.analyses.statics import StaticOptions
from flexfem.inspection.finding import Finding, listed
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.mobility import free_motions, holding


def find(inspection: Inspection) -> Iterator[Finding]:
    """Free motions in statics; contacts may support the bodies."""
    options, model = inspection.options, inspection.model
    if not isinstance(options, StaticOptions) or options.stabilise or model.contacts:
        return
    count, parts = free_motions(inspection, holding(inspection))
    if not count:
        return
    names = [name for i in parts for name in inspection.parts.names[i]]
    kinds = "one way" if count == 1 else f"{count} ways"
    yield Finding(
        "statics", listed([f'"{name}"' for name in names]),
        f"free rigid-body motion in {kinds}: no joint, spring or fixed edge resists it",
        "constrain them, or use --stabilise if their loads hold them in place",
    )  # fmt: skip
