# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files that a run of a case of motion leaves."""

from pathlib import Path
from xml.etree import ElementTree as ET

__all__ = ["SUMMARY_KEYS", "instants"]

SUMMARY_KEYS = {
    "case", "ranks", "unknowns", "multipliers", "steps", "rejected_steps", "newton_iterations",
    "factorizations", "residual_evaluations", "wall_seconds", "wall_seconds_setup", "status",
    "results",
}  # fmt: skip


def instants(pvd: Path) -> list[float]:
    """Times of a series all of whose files, pieces included, are there."""
    times = []
    for entry in ET.parse(pvd).getroot().iter("DataSet"):
        file = pvd.parent / entry.attrib["file"]
        assert file.is_file()
        if file.suffix == ".pvtu":
            pieces = [p.attrib["Source"] for p in ET.parse(file).getroot().iter("Piece")]
            assert pieces
            assert all((file.parent / piece).is_file() for piece in pieces)
        times.append(float(entry.attrib["timestep"]))
    return times
