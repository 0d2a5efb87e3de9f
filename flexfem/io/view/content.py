# SPDX-License-Identifier: LGPL-3.0-or-later
"""The content of a page: layers, times and histories of a result folder, and what is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexfem.io.summary import read_summary
from flexfem.io.view.histories import store_history
from flexfem.io.view.packing import Pack
from flexfem.io.view.reading import Choice, read_motion

__all__ = ["Content", "gather"]


@dataclass(frozen=True)
class Content:
    """The content of a page.

    Attributes:
        title: name of the case.
        scene: description of everything for the page, ready for JSON.
        data: the arrays that it refers to.
        notes: what is left out, and how to choose.
    """

    title: str
    scene: Mapping[str, Any]
    data: bytes
    notes: Sequence[str]


def gather(folder: Path, choice: Choice) -> Content:
    """Read a result folder.

    Raises:
        InputError: it has nothing to show, or a file is damaged.
    """
    motion, pack = read_motion(folder, choice), Pack()
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        described = [one for layer in motion.layers for one in layer.store(pack)]
    history, more = store_history(pack, folder)
    title, clock, status = _summary(folder)
    notes = [*motion.notes, *more]
    scene = {
        "title": title, "clock": clock, "status": status, "layers": described, "history": history,
        "times": pack.store(motion.times), "notes": notes, "instants": motion.instants,
    }  # fmt: skip
    return Content(title, scene, pack.data, notes)


def _summary(folder: Path) -> tuple[str, str, str]:
    """Name of the case, what its times are, and how the run ended; all of it may be missing."""
    name, clock = folder.resolve().name, "time"
    try:
        summary = read_summary(folder / "summary.json")
    except (OSError, ValueError):
        return name, clock, ""
    if "renewals" in summary:  # a relaxation counts iterations
        clock = "iteration"
    elif "critical_points" in summary:  # statics
        clock = "load factor"
    return str(summary.get("case", name)), clock, str(summary.get("status", ""))
