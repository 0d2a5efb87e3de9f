# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes that are coupled because they are nodes of one patch, such as a cell."""

import numpy as np

from flexfem._types import IntArray

__all__ = ["coupled_nodes"]

#: Nodes whose neighbours are counted together, which bounds the memory of it.
_TOGETHER = 100_000


def coupled_nodes(patches: IntArray) -> int:
    """Number of pairs of nodes, in both orders and with themselves, of one of some patches (m, k).

    -1 stands for none.
    """
    from scipy.sparse import csr_array

    met = patches >= 0
    node = patches[met]
    shape = len(patches), int(node.max(initial=-1)) + 1
    ones = np.ones(len(node), dtype=np.float32)
    ends = np.cumsum(np.count_nonzero(met, axis=1))
    member = csr_array((ones, node, np.append(0, ends)), shape=shape)
    around = member.T.tocsr()
    rows = range(0, shape[1], _TOGETHER)
    return sum(int((around[first : first + _TOGETHER] @ member).nnz) for first in rows)
