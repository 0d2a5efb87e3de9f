# SPDX-License-Identifier: LGPL-3.0-or-later
"""Redundant constraints."""

from collections.abc import Iterator

import numpy as np

from flexfem.inspection.finding import Finding, listed
from flexfem.inspection.inspection import Inspection
from flexfem.la.dependence import PART, groups, null_vectors


def find(inspection: Inspection) -> Iterator[Finding]:
    """One finding for each group of joints with dependent rows, unless the run chooses forces."""
    if getattr(inspection.options, "redundant_constraints", "") == "least_norm":
        return
    table = inspection.rows.rows
    rows = inspection.rows.on_nodes(table.rigid)
    joint = table.joint_of_row[table.rigid]
    for terms in groups(rows):
        group, null = null_vectors(rows, terms)
        if not null.shape[1]:
            continue
        guilty = np.unique(joint[group[np.abs(null).max(axis=1) > PART]])
        names = dict.fromkeys(inspection.rows.joints[i].owner for i in guilty)
        total = int(np.isin(joint[group], guilty).sum())
        yield Finding(
            "redundant", listed(list(names)),
            f"{null.shape[1]} of {total} constraints are redundant: joints constrain the same "
            "motion twice, or the configuration is singular",
            "use joints with fewer constraints, or --redundant-constraints least_norm",
        )  # fmt: skip
