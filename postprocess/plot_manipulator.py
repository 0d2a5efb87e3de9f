#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compare runs of the parallel manipulator: manipulator.png in the first folder.

    python postprocess/plot_manipulator.py results/mode_1 results/mode_2 results/mode_3

One panel each for the path of P and its error, the torques of the drives, axial and transverse end
deflections and end rotations of the driven links 1, 3, 5, and the angular accelerations of link 1
(differences of its rate). Runs are told apart by their folders' names.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # before pyplot, which would look for a display

import matplotlib.pyplot as plt
import numpy as np

#: Rows of panels with three columns each: what is shown, its name, unit and factor.
QUANTITIES = (
    ("tau", (1, 2, 3), "torque of drive", "N m", 1.0),
    ("transverse", (1, 3, 5), "transverse end deflection of link", "mm", 1e3),
    ("axial", (1, 3, 5), "axial end deflection of link", "um", 1e6),
    ("rotation", (1, 3, 5), "end rotation of link", "mrad", 1e3),
)


class PlotError(Exception):
    """A user's mistake, told in one line."""


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of the table of a run of the manipulator."""
    if not path.is_file():
        raise PlotError(f"{path}: no history table")
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    names = lines[0].split(",")
    missing = {"P_x", "error_x", "tau_1", "axial_1", "rate_1"} - set(names)
    if missing or len(lines) < 3:
        raise PlotError(f"{path}: not a history of the parallel manipulator")
    table = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
    return dict(zip(names, table.T, strict=True))


def draw(runs: dict[str, dict[str, np.ndarray]]) -> plt.Figure:
    """Figure with all panels; a colour for each run."""
    figure, panels = plt.subplots(
        len(QUANTITIES) + 1, 3, figsize=(15.0, 3.0 * (len(QUANTITIES) + 1)), layout="constrained"
    )
    path, error, acceleration = panels[0]
    for i, (name, run) in enumerate(runs.items()):
        look = {"color": f"C{i}", "linestyle": "-" if i % 2 == 0 else "--", "label": name}
        path.plot(1e3 * run["P_x"], 1e3 * run["P_y"], linewidth=1.2, **look)
        size = 1e6 * np.hypot(run["error_x"], run["error_y"])
        error.plot(run["t"], size, linewidth=1.2, **look)
        rates = np.gradient(run["rate_1"], run["t"])
        acceleration.plot(run["t"], rates, linewidth=1.0, **look)
        for row, (quantity, numbers, _, _, factor) in zip(panels[1:], QUANTITIES, strict=True):
            for panel, number in zip(row, numbers, strict=True):
                values = factor * run[f"{quantity}_{number}"]
                panel.plot(run["t"], values, linewidth=1.1, **look)
    path.set_aspect("equal", adjustable="datalim")
    path.set_xlabel("x of P [mm]")
    path.set_ylabel("y of P [mm]")
    path.legend(frameon=False, fontsize=8)
    error.set_ylabel("error of P [um]")
    acceleration.set_ylabel("angular acceleration of link 1 [rad/s^2]", fontsize=8)
    for row, (_, numbers, title, unit, _) in zip(panels[1:], QUANTITIES, strict=True):
        for panel, number in zip(row, numbers, strict=True):
            panel.set_ylabel(f"{title} {number} [{unit}]", fontsize=8)
    for panel in panels.ravel():
        panel.grid(color="#d9dee4", linewidth=0.7)
        panel.spines[["top", "right"]].set_visible(False)
        if panel is not path:
            panel.set_xlabel("t [s]")
    return figure


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument("--output", type=Path, help="picture (default: in the first folder)")
    options = parser.parse_args(argv)
    output = options.output or options.folders[0] / "manipulator.png"
    try:
        runs = {str(f): read_table(f / "history.csv") for f in options.folders}
        if len(runs) > len(plt.rcParams["axes.prop_cycle"]):
            raise PlotError(f"too many runs: {len(runs)}")
        common = Path(*_common([f.parts for f in options.folders]))
        named = {str(Path(f).relative_to(common)) or f: run for f, run in runs.items()}
        draw(named).savefig(output, dpi=110)
    except (PlotError, OSError, ValueError) as exc:
        print(f"plot_manipulator.py: {exc}", file=sys.stderr)
        return 2
    print(output)
    return 0


def _common(paths: list[tuple[str, ...]]) -> tuple[str, ...]:
    """Leading folders that all paths have, less than the whole of any."""
    count = 0
    for parts in zip(*(p[:-1] for p in paths), strict=False):
        if len(set(parts)) > 1:
            break
        count += 1
    return paths[0][:count]


if __name__ == "__main__":
    sys.exit(main())
