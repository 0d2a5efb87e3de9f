# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ParaView series of a result folder, read for pictures."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import vtkLogger

# what is coloured by a field
FLEXIBLE = (
    "beam_surfaces", "beams", "shells", "solids", "floating_bodies", "floating_lines",
    "energy_lines", "energy_triangles", "energy_solids",
)  # fmt: skip
SERIES = (*FLEXIBLE, "rigid_bodies", "joints", "cables", "cable_nets", "contact_surfaces")
#: Obstacles, which may be much larger than what moves.
OBSTACLES = "contact_surfaces"
#: Points with vectors, which are drawn on request only.
ARROWS = "reactions"


class RenderError(ValueError):
    """A user's mistake, described in one line."""


@dataclass(frozen=True)
class Instant:
    """Files of all series at one time."""

    folder: Path
    time: float
    files: dict[str, Path]

    def meshes(self, deformation: float = 1.0) -> dict[str, Any]:
        """Read the grids, with displacements that many times as large."""
        found = {name: read_grid(file) for name, file in self.files.items()}
        if deformation != 1.0:
            for name, mesh in found.items():
                if "displacement" not in mesh.point_data:
                    raise RenderError(f"{self.files[name]}: has no displacement to scale")
                moved = np.asarray(mesh.point_data["displacement"], dtype=float)
                mesh.points = np.asarray(mesh.points) + (deformation - 1.0) * moved
        return found


def read_grid(file: Path) -> Any:
    """Read one grid; a series never names a file without points."""
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = pv.read(file)
    except Exception as exc:  # whatever the reader makes of a damaged file
        reason = str(exc).strip().splitlines()[-1].strip('\t "')
        raise RenderError(f"{file}: cannot be read ({reason})") from exc
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    if not mesh.n_points:
        raise RenderError(f"{file}: cannot be read")
    return mesh


def read_series(folder: Path, *, arrows: bool = False) -> list[Instant]:
    """Instants of a result folder, by time."""
    times: dict[float, dict[str, Path]] = {}
    for name in (*SERIES, ARROWS) if arrows else SERIES:
        pvd = folder / f"{name}.pvd"
        if not pvd.is_file():
            continue
        try:
            for entry in ET.parse(pvd).getroot().iter("DataSet"):
                files = times.setdefault(float(entry.attrib["timestep"]), {})
                files[name] = folder / entry.attrib["file"]
        except (ET.ParseError, KeyError, ValueError) as exc:
            raise RenderError(f"{pvd}: not a readable series ({exc})") from exc
    if not times:
        raise RenderError(f"{folder}: no series to draw ({', '.join(n + '.pvd' for n in SERIES)})")
    for files in times.values():
        for file in files.values():
            if not file.is_file():
                raise RenderError(f"{file}: named by the series but missing")
    return [Instant(folder, t, times[t]) for t in sorted(times)]


def between(instants: list[Instant], start: float | None, end: float | None) -> list[Instant]:
    """Those from one time to another."""
    first, last = instants[0].time, instants[-1].time
    slack = 1e-9 * max(abs(first), abs(last))
    low = first if start is None else start
    high = last if end is None else end
    found = [one for one in instants if low - slack <= one.time <= high + slack]
    if not found:
        raise RenderError(
            f"{instants[0].folder}: nothing from t = {low:g} to {high:g} s, "
            f"the series go from {first:g} to {last:g} s"
        )
    return found


def nearest(instants: list[Instant], time: float) -> Instant:
    """The one at a time, or next to it, at infinity the last; not one from outside the motion."""
    if time == math.inf:
        return instants[-1]
    between(instants, time, None), between(instants, None, time)
    return min(instants, key=lambda one: abs(one.time - time))


def title_of(folder: Path) -> tuple[str, str]:
    """Name of the case from the summary, or of the folder, and the format of its times."""
    name, clock = folder.resolve().name, "t = {:.4g} s"
    try:
        summary = json.loads((folder / "summary.json").read_text())
        if "renewals" in summary:  # a relaxation counts iterations
            clock = "iteration {:.0f}"
        elif "critical_points" in summary:  # statics
            clock = "load factor {:.4g}"
        return str(summary["case"]), clock
    except (OSError, ValueError, KeyError, TypeError):
        return name, clock
