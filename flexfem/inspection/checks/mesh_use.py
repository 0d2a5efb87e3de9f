# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes that no body uses."""

from collections.abc import Iterator

from flexfem.inspection.finding import Finding, listed
from flexfem.inspection.inspection import Inspection


def find(inspection: Inspection) -> Iterator[Finding]:
    """A mesh of lines without a beam; cells that no beam takes are refused where there is one."""
    model = inspection.model
    if model.mesh is None or any(beam.group is not None for beam in model.beams):
        return
    groups = listed([f'"{name}"' for name in model.mesh.line_groups])
    yield Finding(
        "mesh_use", repr(model), f"no beam uses its mesh, whose lines are {groups}",
        "add the beams, or leave the mesh out",
    )  # fmt: skip
