# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of arrays that compiled loops take as one argument."""

import os
import subprocess
import sys

import numpy as np
import pytest

from flexfem._types import FloatArray
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Bool1D, Float1D, Index2D, Memory, Record, unpack

pytestmark = pytest.mark.serial


class Bars(Record):
    """Some fields of every kind."""

    nodes: Index2D
    stiffness: Float1D
    chosen: Bool1D
    reversed: bool
    factor: float
    first: int


@subroutine
def _one(bars: Bars, c: int) -> float:
    side = 1 if bars.reversed else 0
    value: float = bars.factor * bars.stiffness[bars.nodes[c, side]]
    return value


@kernel
def _sum(memory: Memory, out: FloatArray) -> float:
    bars, total = unpack(Bars, memory), 0.0
    for c in range(bars.first, bars.nodes.shape[0]):
        if bars.chosen[c]:
            out[c] = _one(bars, c)
            total += out[c]
    return total


def _bars() -> Bars:
    return Bars(
        nodes=np.array([[0, 1], [1, 2], [2, 3]], dtype=np.int32),
        stiffness=np.array([1.0, 10.0, 100.0, 1000.0]),
        chosen=np.array([True, True, False]), reversed=True, factor=2.0, first=0,
    )  # fmt: skip


def test_loops_read_arrays_and_numbers() -> None:
    out = np.zeros(3)
    assert _sum(_bars().memory, out) == 220.0
    # a field read from a neighbour's words, or a mask read as something else, changes these
    assert out.tolist() == [20.0, 200.0, 0.0]


def test_loops_see_changed_entries_and_other_arrays() -> None:
    bars, out = _bars(), np.zeros(3)
    bars.stiffness[1] = 7.0
    assert _sum(bars.memory, out) == 214.0
    bars.stiffness = np.array([0.0, 5.0, 6.0])
    bars.first, bars.factor, bars.reversed = 1, 1.0, False
    assert _sum(bars.memory, out) == 5.0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros(3, dtype=np.float32), r"Bars\.stiffness takes an array float64, 1d"),
        (np.zeros((2, 2)), r"Bars\.stiffness takes an array float64, 1d"),
        (np.zeros(6)[::2], r"Bars\.stiffness: the array is not contiguous"),
        ([0.0], r"Bars\.stiffness takes an array float64, 1d"),
    ],
)
def test_arrays_of_another_layout_are_refused(value: object, text: str) -> None:
    with pytest.raises(TypeError, match=text):
        _bars().stiffness = value  # type: ignore[assignment]


def test_missing_and_unknown_fields_are_refused() -> None:
    with pytest.raises(TypeError, match="Bars: missing or unknown fields: chosen, odd"):
        Bars(
            nodes=np.zeros((0, 2), dtype=np.int32), stiffness=np.zeros(0), reversed=True,
            factor=1.0, first=0, odd=1,
        )  # type: ignore[call-arg]  # fmt: skip
    with pytest.raises(TypeError, match="Bars has no field odd"):
        _bars().odd = 1  # type: ignore[attr-defined]


def test_loops_run_as_plain_python() -> None:
    code = (
        "import numpy as np; from tests.unit import test_records as t; "
        "print(t._sum(t._bars().memory, np.zeros(3)))"
    )
    # a record that plain Python cannot find by its memory ends here
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    assert done.stdout.strip() == "220.0"
