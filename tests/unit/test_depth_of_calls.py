# SPDX-License-Identifier: LGPL-3.0-or-later
"""How deep a residual lies below the run loop, and how many files an iteration visits.

Both are what a reader has to hold in mind to follow a step from the run loop to the arithmetic.
"""

import sys
from pathlib import Path

import pytest

import flexfem as ff
from flexfem.simulation.dynamics import simulate

pytestmark = pytest.mark.serial

#: From the run loop to the kernel, both counted.
DEPTH = 10
#: Visited by Newton iterations of beams with joints and kept factors, the first of which go part by
#: part; rigid bodies add two.
FILES = 13
#: Make the sequences of compiled loops, and the elimination of the multipliers, once.
MAKING = {"_make_sequences", "_at_rows", "evaluation", "_eliminate"}


def _names(frame):
    """Functions of the package from the run loop down to a frame, and the frame's file."""
    names = []
    while frame is not None:
        if "flexfem" in frame.f_code.co_filename:
            names.append(frame.f_code.co_name)
        if names and names[-1] == "_to_the_last":
            return names[::-1]
        frame = frame.f_back
    return []


def test_a_residual_is_near_the_run_loop(tmp_path, monkeypatch):
    """A layer more, or a file more in every iteration, needs a reason and a new number here."""
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
    model = ff.Model("pendulum", mesh=mesh)
    steel = ff.Material(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", ff.Section.circle(0.01, steel)),
        ff.Spherical("hinge", ff.Ground(), ff.Marker("rod", "start")),
    )
    options = ff.RunOptions(dt=1e-3, t_end=3e-3, quiet=True, output=tmp_path)
    simulate(model, options)  # compile first
    deepest, files = [], set()

    def look(frame, event, _):
        nonlocal deepest
        if event != "call" or "flexfem" not in frame.f_code.co_filename:
            return
        names = _names(frame)
        if "iterate" in names and not MAKING.intersection(names):
            files.add(Path(frame.f_code.co_filename))
            # the call of the sequence of all residuals
            if names[-2:] == ["_evaluate_at_once", "__call__"] and len(names) > len(deepest):
                deepest = names

    sys.setprofile(look)
    try:
        simulate(model, options)
    finally:
        sys.setprofile(None)
    assert deepest
    # the kernel itself is compiled, and no frame of Python
    assert len(deepest) + 1 <= DEPTH, " > ".join(deepest)
    assert len(files) <= FILES, sorted(map(str, files))
