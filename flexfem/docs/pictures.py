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
import tempfile
from collections.abc import Sequence
from pathlib import Path

FIGURES = Path(__file__).parent / "figures"
ROOT = Path(__file__).parents[2]
#: Number of colours of pictures.
_COLOURS = 128
_SIZE = ("--size", "900x560", "--no-animation")

#: Pictures by their names: the case or example, folders of its results behind a colon, the script
#: that draws it, its options.
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
    "tutorial_10_motion": ("identified_beam", ("render", "--interval", "0.1", *_SIZE)),
    "tutorial_10_fit": (
        "identified_beam:film,fit",
        ("compare_runs", "--columns", "tip_x,tip_z,left_x,left_z", "--across", "2"),
    ),
    "tutorial_11_motion": ("lightest_jib", ("render", "--interval", "2", *_SIZE)),
    "tutorial_11_history": ("lightest_jib", ("plot_history", "--columns", "stress")),
    "walk_motion": ("scissor", ("render", *_SIZE)),
    "walk_history": (
        "scissor",
        ("plot_history", "--columns", "top_z,driving_fx,foot_force_fz,rail_force_fz"),
    ),
}
#: Cases that are no files: the page whose first complete script each is.
PAGES = {"scissor": "guide/walk.md"}
#: Default picture of each script.
_DRAWN = {
    "render": "motion.png", "plot_history": "history.png", "plot_campbell": "campbell.png",
    "compare_runs": "comparison.png",
}  # fmt: skip


def main(results: Path) -> None:
    """Run cases without results, and draw all pictures."""
    for name, (case, (script, *options)) in PICTURES.items():
        own, _, inside = case.partition(":")
        if not (results / own / "summary.json").exists():
            run(own, results / own)
        first, *others = [results / own / one for one in inside.split(",")]
        keep(draw(script, first, *others, *options), FIGURES / f"{name}.png")


def run(name: str, folder: Path, options: Sequence[str] = ()) -> None:
    """Run a case or an example; the latter leaves its results where it is run."""
    example = ROOT / "examples" / f"{name}.py"
    if not example.exists():
        python(*_program(name), *options, "--output", folder)
        return
    with tempfile.TemporaryDirectory() as place:
        python(example, folder=Path(place))
        shutil.move(Path(place) / "results" / name, folder)


def keep(drawn: Path, target: Path, size: str = "1400x1000") -> None:
    """Keep a picture in few colours, and not larger than a size."""
    from imageio.v3 import imread
    from PIL import Image

    small = Image.fromarray(imread(drawn)[..., :3])
    width, _, height = size.partition("x")
    small.thumbnail((int(width), int(height)))
    small.quantize(_COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)


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
