# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tolerances of Newton's method that round-off of positions does not let it reach."""

from collections.abc import Iterator

import numpy as np

from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection

#: Round-off of a position that is the sum of some terms, over the largest coordinate.
_ROUND_OFF = 8.0 * float(np.finfo(float).eps)


def find(inspection: Inspection) -> Iterator[Finding]:
    """One finding if the tolerance is below the round-off of the largest coordinate."""
    options = inspection.options
    if not isinstance(options, RunOptions | StaticOptions) or not len(inspection.points):
        return
    # statics compare displacements with the size of the model, motions in metres
    scale = inspection.scale if isinstance(options, StaticOptions) else 1.0
    unit = "of the model's size" if isinstance(options, StaticOptions) else "m"
    lowest = _ROUND_OFF * float(np.abs(inspection.points).max()) / scale
    if options.tolerance < lowest:
        yield Finding(
            "tolerance", repr(inspection.model),
            f"the tolerance of {options.tolerance:.3g} {unit} is below the round-off of its "
            f"positions, {lowest:.2g}: steps end where rounding leaves them, or fail",
            f"take a tolerance of {100.0 * lowest:.0e} or more",
        )  # fmt: skip
