# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether a step begins with refined corrections, by the errors of those of the last one."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexfem.solvers.frozen.policy import _Attempt
from flexfem.solvers.frozen.refine import Refined


@pytest.mark.serial
def test_errors_of_corrections_below_the_tolerance_are_rounding() -> None:
    """Contacts ask for them; a step that begins by rounding differs from rank to rank."""
    frozen = SimpleNamespace(
        begin_step=lambda: None, sprung=True, keepable=False, exact=True,
        secants=SimpleNamespace(forget=lambda: None),
    )  # fmt: skip
    attempt = _Attempt(cast("Any", frozen), 0.5, 0.1, 1e-6, refine=True, defect=0.5)
    found = []
    for k, (size, defect) in enumerate(((1e-3, 0.3), (1e-7, 0.004), (1e-9, 0.02), (1e-13, 0.9))):
        attempt._refined = Refined(defect, exact=True, missed=np.zeros(0))
        attempt.observe(k + 1, size, size, 0.01, 1.0, [])
        found.append(attempt.defect)
    # those of the first correction below the tolerance, with which other iterations end
    assert found == [0.3, 0.004, 0.004, 0.004]
