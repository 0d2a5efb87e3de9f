# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS curves from files of CAD programs."""

from collections import Counter
from pathlib import Path

from flexfem import _checks
from flexfem._files import read_bytes
from flexfem.mesh.imported import iges, step
from flexfem.mesh.imported.curve_parts import finished
from flexfem.mesh.imported.limits import decoded
from flexfem.mesh.nurbs.curve import NurbsCurve

__all__ = ["read_curves"]

#: Bytes of a file of curves.
_LARGEST = 100_000_000
_READERS = {".step": step.read, ".stp": step.read, ".igs": iges.read, ".iges": iges.read}


def read_curves(path: str | Path, *, scale: float | None = None) -> dict[str, NurbsCurve]:
    """Read the B-spline curves of a STEP or IGES file exactly, with degree, knots and weights.

    Taken are the B-spline curves in space, rational or not: in STEP the entities
    B_SPLINE_CURVE_WITH_KNOTS, in IGES 126 with transformations. Lines, circles and other kinds of
    curves are left out: let the CAD program write them as B-splines, or use `NurbsCurve.line` and
    `NurbsCurve.arc`. A curve of STEP is whole, also where an edge takes a part of it. Knots that
    are not clamped, as those of periodic curves, become so; the curve stays the same.

    The file is read as data, and nothing in it is run.

    Args:
        path: The file; its suffix (.step, .stp, .iges, .igs) gives the format.
        scale: Metres in a unit of length of the file; the unit of the file if left out.

    Returns:
        The curves by their names in the file; by number ("#12" in STEP, "D5" in IGES) where they
        have none, or share it.

    Raises:
        TypeError: The scale is no number.
        ValueError: The file cannot be read, has no such curve, states no unit of length, or has a
            curve that no beam can follow.
    """
    place = Path(path)
    owner = f'curve file "{place}"'
    factor = None if scale is None else _checks.number(owner, "scale", scale, positive=True)
    reader = _READERS.get(place.suffix.lower())
    if reader is None:
        raise ValueError(f"{owner}: its name must end in {', '.join(_READERS)}")
    raw = read_bytes(owner, place, _LARGEST)
    text = "\n".join(decoded(line) for line in raw.splitlines())
    parts = reader(place, text, factor)
    if not parts:
        raise ValueError(
            f"{owner}: it has no B-spline curve in space; let the program that wrote it turn "
            "lines and arcs into B-splines"
        )
    count = Counter(part.name for part in parts)
    return {
        part.name if part.name and count[part.name] == 1 else part.number: finished(place, part)
        for part in parts
    }
