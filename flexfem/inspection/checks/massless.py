# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies without mass, where a motion is looked for."""

from collections.abc import Iterator

from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.model.bodies import PointMass


def find(inspection: Inspection) -> Iterator[Finding]:
    """Beams and shells whose sections have no mass."""
    if not inspection.moves:
        return
    for body in inspection.bodies:
        if body.masses.mass == 0.0 and not isinstance(body.body, PointMass):
            yield Finding(
                "massless", owner_of(body.body), "it has no mass, and a motion needs inertia",
                "give its material a density",
            )  # fmt: skip
