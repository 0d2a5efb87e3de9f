# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of redundant constraints, before they make a matrix singular.

With a regular mass matrix the multipliers are determined exactly if the gradients of all rigid rows
are linearly independent.
"""

import numpy as np

from flexfem._checks import InputError
from flexfem._types import IntArray
from flexfem.la.dependence import PART, NodeRows, groups, null_vectors
from flexfem.system.system import System

__all__ = ["check_independence"]

_NAMES = 4


def check_independence(system: System) -> None:
    """Raise for joints that constrain the same motion twice (collective).

    The first rank receives twelve numbers a row.

    Raises:
        InputError: rigid rows are linearly dependent; names the joints.
    """
    rows, comm = system.constraints, system.comm
    mine = np.flatnonzero((rows.owned * rows.rigid)[rows.row_of_term] > 0.0)
    row = rows.row_of_term[mine]
    face = system.interface
    kinds = 1 + max(part.kind for part in system.parts)
    keys = np.append(kinds * face.number + face.kind, -1)  # -1: ground
    joints = np.array([joint.index for joint in rows.joints], dtype=np.int64)
    parts = comm.gather(
        (
            joints[rows.joint_of_row[row]],
            rows.numbers[row],
            keys[rows.term_nodes[mine]],
            rows.force_jacobian[mine],
        )
    )
    found = None
    if parts is not None:
        joint, number, nodes, gradient = (np.concatenate(p) for p in zip(*parts, strict=True))
        _, first, number = np.unique(number, return_index=True, return_inverse=True)
        rows_of_all = NodeRows(number.reshape(-1), nodes, gradient)
        found = _dependence(rows_of_all, joint[first])
    found = comm.bcast(found)
    if found is None:
        return
    excess, total, guilty = found
    own = {j.index: j.joint.owner for j in rows.joints if j.owned and j.index in guilty}
    every = sorted(kv for part in comm.allgather(own) for kv in part.items())
    # joints of lines are several under one name
    names = list(dict.fromkeys(name for _, name in every))
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    raise InputError(
        f"{', '.join(names[:_NAMES])}{more}: {excess} of {total} constraints are redundant "
        "(joints constrain the same motion twice, or the configuration is singular); remove the "
        "duplicates, or use redundant_constraints least_norm in a motion"
    )


def _dependence(rows: NodeRows, joint: IntArray) -> tuple[int, int, list[int]] | None:
    """Excess and number of rows, and the joints of the first group with dependent rows.

    ``joint`` (r,) is that of each row.
    """
    for terms in groups(rows):
        group, null = null_vectors(rows, terms)
        if null.shape[1]:
            part = np.abs(null).max(axis=1) > PART
            guilty = np.unique(joint[group[part]]).tolist()
            return null.shape[1], int(np.isin(joint[group], guilty).sum()), guilty
    return None
