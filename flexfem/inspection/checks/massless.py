# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies without mass in a motion."""

from collections.abc import Iterator

import numpy as np

from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.materials.shell_section import ShellSection
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell


def find(inspection: Inspection) -> Iterator[Finding]:
    """Beams and shells whose sections have no mass."""
    if not inspection.moves:
        return
    bodies: list[Beam | Shell] = [*inspection.model.beams, *inspection.model.shells]
    for body in bodies:
        if _mass(body) == 0.0:
            yield Finding(
                "massless", owner_of(body), "it has no mass, and a motion needs inertia",
                "give its material a density",
            )  # fmt: skip


def _mass(body: Beam | Shell) -> float:
    """Mass per length or area, the largest along a table; NaN of functions."""
    section = body.section
    if isinstance(section, SectionTable):
        return float(section.inertia[:, 0, 0].max())
    if isinstance(section, Section):
        return section.mass_per_length
    return section.mass if isinstance(section, ShellSection) else np.nan
