# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies without mass in a motion."""

from collections.abc import Iterator

from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell


def find(inspection: Inspection) -> Iterator[Finding]:
    """Beams and shells whose sections have no mass."""
    if not inspection.moves:
        return
    bodies: list[Beam | Shell] = [*inspection.model.beams, *inspection.model.shells]
    for body in bodies:
        mass = body.section.mass if isinstance(body, Shell) else body.section.mass_per_length
        if mass == 0.0:
            yield Finding(
                "massless", owner_of(body), "it has no mass, and a motion needs inertia",
                "give its material a density",
            )  # fmt: skip
