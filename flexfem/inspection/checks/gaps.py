# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints whose constraints are violated at the start."""

from collections.abc import Iterator

from flexfem.core.row import START_GAP
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection


def find(inspection: Inspection) -> Iterator[Finding]:
    """Every joint that a run would refuse, not the first one only."""
    for joint in inspection.joints:
        owner, ends = f'{joint.kind} "{joint.name}"', " and ".join(joint.ends)
        drive = "; a drive may be elsewhere at t = 0" if joint.role == "drives" else ""
        if joint.gap > START_GAP:
            yield Finding(
                "gaps", owner, f"{ends} are {joint.gap:.4g} m from where it holds them",
                f"move markers or bodies, or let flexfem.assemble do it{drive}",
            )  # fmt: skip
        if joint.tilt > START_GAP:
            yield Finding(
                "gaps", owner,
                f"{ends} are {joint.tilt:.4g} rad from the directions in which it holds them",
                f"rotate bodies or axes, or let flexfem.assemble do it{drive}",
            )  # fmt: skip
