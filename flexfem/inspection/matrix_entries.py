# SPDX-License-Identifier: LGPL-3.0-or-later
"""Entries of the matrix of a step."""

import numpy as np

from flexfem.constraints.batch import Constraints
from flexfem.layout.numbered_model import NumberedModel

__all__ = ["matrix_entries"]


def matrix_entries(serial: NumberedModel, rows: Constraints) -> int:
    """Entries that the matrix of a step has room for, joints included, contact left out."""
    families = serial.families.values()
    count = sum(family.held.shape[1] ** 2 * family.coupled() for family in families)
    # a row has an entry in G and in G^T for each unknown of its nodes
    row = np.repeat(rows.row_of_term, 2)
    nodes = rows.term_nodes.ravel()
    met = np.unique(np.stack([row, nodes])[:, nodes >= 0], axis=1)
    width_of = rows.interface.width
    return int(count + 2 * width_of[met[1]].sum())
