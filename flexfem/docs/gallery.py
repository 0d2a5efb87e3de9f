# SPDX-License-Identifier: LGPL-3.0-or-later
"""Make the pictures of the gallery: one of every case and example.

    python -m flexfem.docs.gallery [RESULTS_DIR] [NAME ...]

runs those without results, as the gallery says, and puts small pictures into ``figures/gallery/``.
All of them take three quarters of an hour.
"""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexfem.docs.extensions.topics import GALLERY, SHORTER, sentences
from flexfem.docs.pictures import ROOT, draw, keep, run

#: Largest size of pictures.
_SIZE = "480x320"


@dataclass(frozen=True)
class Drawing:
    """How a picture is drawn, where the usual way does not show what matters.

    Attributes:
        options: of the script.
        script: in ``postprocess/``.
        folder: part of the results, as a mode.
    """

    options: str = ""
    script: str = "render"
    folder: str = "."


DRAWINGS = {
    "bar_impact": Drawing("--columns force", script="plot_history"),
    "billiards": Drawing("--view z"),
    "capstan": Drawing("--view z"),
    "sheet_landing": Drawing("--view=0.3,-1,0.25 --interval 0.02"),
    "blade": Drawing(folder="mode_02"),
    "campbell": Drawing(script="plot_campbell"),
    "optimal_column": Drawing(folder="modes"),
    "uniform_stress_blade": Drawing("--view z --colour N"),
    "identification_twin": Drawing("--colour N"),
    "truss_design": Drawing("--columns stress,stress_post", script="plot_history"),
    "design_of_a_flexure": Drawing("--view z --colour von_mises --from 0.9"),
    "optimal_manipulator": Drawing("--columns error_x,error_y", script="plot_history"),
    "spin_up": Drawing("--columns u2,theta1", script="plot_history"),
    "tuned_damper": Drawing("--columns deflection", script="plot_history"),
    "tutorial_4_rotor": Drawing(script="plot_campbell"),
    "formalisms": Drawing("--columns lagrange_x,hamilton_x", script="plot_history"),
    "manipulator_deployment": Drawing("--columns u2,theta1", script="plot_history"),
    "steady_turn": Drawing("--from 19 --interval 0.6"),
    "flying_spaghetti": Drawing("--to 8"),
    "gripper": Drawing("--from 0.1 --interval 0.35"),
    "tyre": Drawing("--view=0.3,-1,0.25 --from 0.05 --interval 1"),
    "gear_pair": Drawing("--from 0.395 --interval 1"),
    "lightest_jib": Drawing("--interval 2"),
    "knot": Drawing("--from 0.4 --to 2 --interval 1.6 --view=0.1,-0.5,1"),
    "plectoneme": Drawing("--from 3.7 --to 7 --interval 3.3 --view=-0.3,-0.5,1"),
    "turek_hron": Drawing("--view z --to 0.5 --interval 0.15"),
    "twisting_column": Drawing("--interval 1"),
    "tape_spring": Drawing("--view=0.35,-1,0.2 --from 0.5 --interval 0.02"),
    "mesh_reflector": Drawing("--view=0.3,-1,0.45 --interval 22"),
    "rope_heap": Drawing("--from 1.49 --interval 1"),
}


def main(results: Path, names: Sequence[str]) -> None:
    """Run those without results, and draw them."""
    for name in names or sentences():
        folder = results / name
        if not (folder / "summary.json").exists():
            run(name, folder, shlex.split(SHORTER.get(name, "")))
        drawn = _draw(folder, DRAWINGS.get(name, Drawing()))
        GALLERY.mkdir(exist_ok=True)
        keep(drawn, GALLERY / f"{name}.png", _SIZE)


def _draw(folder: Path, drawing: Drawing) -> Path:
    """Draw a picture; returns its file."""
    size = ("--size", _SIZE, "--no-animation") if drawing.script == "render" else ()
    options = shlex.split(drawing.options)
    return draw(drawing.script, folder / drawing.folder, *options, *size)


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute() if len(sys.argv) > 1 else ROOT / "results", sys.argv[2:])
