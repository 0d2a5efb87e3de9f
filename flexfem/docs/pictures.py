# SPDX-License-Identifier: LGPL-3.0-or-later
"""Make the pictures of the documentation from their results.

    python -m flexfem.docs.pictures [RESULTS_DIR]

runs the tutorials, and the script of the walk, from the source tree and puts small pictures into
``figures/``.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

FIGURES = Path(__file__).parent / "figures"
ROOT = Path(__file__).parents[2]
_SIZE = ("--size", "900x560", "--no-animation")

#: Pictures by their names: the case, the script that draws it, its options.
PICTURES = {
    "tutorial_1_motion": (
        "tutorial_1_pendulum",
        ("render", "--colour", "bending_moment", "--interval", "0.1", *_SIZE),
    ),
    "tutorial_1_history": (
        "tutorial_1_pendulum",
        ("plot_history", "--columns", "sag,energy_kinetic,energy_strain"),
    ),
    "tutorial_2_motion": ("tutorial_2_four_bar", ("render", *_SIZE)),
    "tutorial_2_history": (
        "tutorial_2_four_bar",
        ("plot_history", "--columns", "rocker_angle,torque_mz"),
    ),
    "tutorial_3_path": (
        "tutorial_3_column",
        ("plot_history", "--columns", "t", "--x", "aside"),
    ),
    "tutorial_4_campbell": ("tutorial_4_rotor", ("plot_campbell",)),
    "tutorial_5_motion": ("tutorial_5_sheet", ("render", *_SIZE)),
    "tutorial_5_history": (
        "tutorial_5_sheet",
        ("plot_history", "--columns", "corner_z,touch_fz"),
    ),
    "tutorial_6_motion": (
        "tutorial_6_solid_arm",
        ("render", "--colour", "von_mises", *_SIZE),
    ),
    "tutorial_6_history": (
        "tutorial_6_solid_arm",
        ("plot_history", "--columns", "lag,torque_mz"),
    ),
    "tutorial_7_motion": ("tutorial_7_bead", ("render", *_SIZE)),
    "tutorial_7_history": ("tutorial_7_bead", ("plot_history", "--columns", "way,speed")),
    "tutorial_8_motion": ("tutorial_8_crane", ("render", "--colour", "bending_moment", *_SIZE)),
    "tutorial_8_history": (
        "tutorial_8_crane",
        ("plot_history", "--columns", "pull_tension,pull_end_tension"),
    ),
    "walk_motion": ("scissor", ("render", *_SIZE)),
    "walk_history": (
        "scissor",
        ("plot_history", "--columns", "top_z,driving_fx,foot_force_fz,rail_force_fz"),
    ),
}
#: Cases that are no files: the page whose first complete script each is.
PAGES = {"scissor": "guide/walk.md"}
#: Default picture of each script.
_DRAWN = {"render": "motion.png", "plot_history": "history.png", "plot_campbell": "campbell.png"}


def main(results: Path) -> None:
    """Run cases without results, and draw all pictures."""
    for name, (case, (script, *options)) in PICTURES.items():
        folder = results / case
        if not (folder / "summary.json").exists():
            python(*_program(case), "--output", folder)
        shutil.copyfile(draw(script, folder, *options), FIGURES / f"{name}.png")


def draw(script: str, results: Path, *options: object) -> Path:
    """Draw a picture of results by a script in ``postprocess/``; returns its file."""
    python(ROOT / "postprocess" / f"{script}.py", results, *options)
    return results / _DRAWN[script]


def python(*arguments: object, folder: Path = ROOT) -> None:
    """Run Python in a folder."""
    found = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, *map(str, arguments)], check=True, cwd=folder, env=found)


def _program(case: str) -> tuple[object, ...]:
    """Return Python's arguments to run a case: its file, or the script on a page."""
    if case not in PAGES:
        return (ROOT / "cases" / f"{case}.py",)
    text = (Path(__file__).parent / PAGES[case]).read_text(encoding="utf-8")
    found = re.search(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert found is not None
    return "-c", found[1]


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute() if len(sys.argv) > 1 else ROOT / "results")
