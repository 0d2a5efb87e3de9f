# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact in flexfem and in its peers: energy made, deepest penetration, and time.

Run from the source tree, on a quiet machine::

    python tests/benchmarks/contact_peers.py                               # all, steps 0.1, 1, 5 ms
    python tests/benchmarks/contact_peers.py --scenes billiards --steps 1e-3 --programs mujoco,drake
    python tests/benchmarks/contact_peers.py --peers-python VENV/bin/python   # where the peers are

Scenes are a sheet that lands flat, a break shot of balls and boxes, and a rope over a cylinder
(``contact_scenes.py``). The peers are optional, ``pip install mujoco exudyn drake`` or the extra
``peers``; those that are missing are named. Each run is a process of its own with one thread. What
a program cannot do is left out: Drake has no shells, and its rope of rigid links failed; ``ipctk``
is a library of distances and barriers, without bodies and steps in time. At the end stands the
fastest run of each program whose error is not larger than some: the ratio of forces of the rope,
and of the sheet and the balls the energy made or lost, where none is, or the depth over their size
if it is more.
"""

import argparse
import importlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from chain_against_exudyn import spawn
from contact_scenes import Break, Capstan, Sheet

SCENES = {"sheet_landing": Sheet(), "billiards": Break(), "capstan": Capstan()}
#: Module that each program needs.
PROGRAMS = {"flexfem": "flexfem", "mujoco": "mujoco", "exudyn": "exudyn", "drake": "pydrake"}
#: Settings in which they run the scenes, explained in ``contact_*.py``.
SETTINGS = {
    "flexfem": dict.fromkeys(SCENES, ("shipped",)),
    "mujoco": {
        "sheet_landing": ("default", "elastic"),
        "billiards": ("default", "elastic"),
        "capstan": ("default", "stiff"),
    },
    "exudyn": {
        "sheet_landing": ("elastic", "soft"),
        "billiards": ("elastic", "soft"),
        "capstan": ("stiff", "soft"),
    },
    "drake": {"billiards": ("lagged", "sap")},
}
#: Relative errors at which times are compared.
ERRORS = (0.3, 0.1, 0.03, 0.01)
COLUMNS = ("made", "lost", "momentum", "depth", "force", "seconds")
HEAD = (
    "| scene | program | step ms | energy made | lost | momentum | depth mm | ratio | s a second |"
)


def missing(python: str, program: str) -> bool:
    """True if a program cannot be imported."""
    code = f"import sys, importlib.util as u; sys.exit(u.find_spec('{PROGRAMS[program]}') is None)"
    return subprocess.run([python, "-c", code], check=False).returncode != 0


def run_here(scene: str, program: str, setting: str, step: str) -> None:
    """Run one scene in this process, and print its figures."""
    run: Callable[..., object] = getattr(importlib.import_module(f"contact_{program}"), scene)
    figures = run(SCENES[scene], float(step), setting)
    print(json.dumps(figures.summary(SCENES[scene].t_end)))


def measured(python: str, limit: float, *run: str) -> dict[str, float] | str:
    """Figures of a run in a process of its own, or why there are none."""
    command = [python, "-W", "ignore", str(Path(__file__).resolve()), "--run", *run]
    try:
        out, _ = spawn(["timeout", f"{limit:g}", *command])
    except RuntimeError as error:
        reason = str(error).rpartition(" ended with ")[2]
        return f"longer than {limit:g} s" if reason.startswith("124") else reason[:60]
    found: dict[str, float] = json.loads(out.strip().splitlines()[-1])
    return found


def line(scene: str, name: str, step: float, found: dict[str, float] | str) -> str:
    """Row of the table."""
    begin = f"| {scene} | {name} | {1e3 * step:g} |"
    if isinstance(found, str):
        return f"{begin} {found} | | | | | |"
    factors = {"depth": 1e3}
    cells = (
        f"{found[name] * factors.get(name, 1.0):.3g}" if name in found else "" for name in COLUMNS
    )
    return f"{begin} {' | '.join(cells)} |"


def error(scene: str, found: dict[str, float]) -> float:
    """Relative error of a run."""
    if scene == "capstan":
        return abs(found["force"] / Capstan().exact - 1.0)
    size = Sheet().thickness if scene == "sheet_landing" else 2.0 * Break().radius
    return max(found["made"], abs(found["lost"]), found["depth"] / size)


def fastest(runs: list[tuple[str, str, dict[str, float]]]) -> str:
    """Table of seconds of the fastest run of each scene and program, by the largest error."""
    head = " | ".join(f"error {largest:g}" for largest in ERRORS)
    lines = [f"| scene | program | {head} |", "|---" * (2 + len(ERRORS)) + "|"]
    for scene, program in dict.fromkeys((scene, program) for scene, program, _ in runs):
        own = [found for *which, found in runs if which == [scene, program]]
        cells = []
        for largest in ERRORS:
            seconds = [found["seconds"] for found in own if error(scene, found) <= largest]
            cells.append(f"{min(seconds):.2g}" if seconds else "")
        lines.append(f"| {scene} | {program} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--programs", default=",".join(PROGRAMS))
    parser.add_argument("--steps", default="1e-4,1e-3,5e-3", help="in s")
    parser.add_argument("--limit", type=float, default=600.0, help="of a run, in s")
    parser.add_argument("--peers-python", default=sys.executable, help="interpreter with the peers")
    parser.add_argument("--run", nargs=4, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        run_here(*args.run)
        return
    python = dict.fromkeys(PROGRAMS, args.peers_python) | {"flexfem": sys.executable}
    there = [name for name in args.programs.split(",") if not missing(python[name], name)]
    for name in set(args.programs.split(",")) - set(there):
        print(f"missing: {name}")
    print(f"ratio of the capstan: exactly {Capstan().exact:.4f}\n{HEAD}\n{'|---' * 9}|", flush=True)
    runs = []
    for scene in args.scenes.split(","):
        for program in there:
            for setting in SETTINGS[program].get(scene, ()):
                for step in args.steps.split(","):
                    run = (scene, program, setting, step)
                    found = measured(python[program], args.limit, *run)
                    print(line(scene, f"{program} {setting}", float(step), found), flush=True)
                    if not isinstance(found, str):
                        runs.append((scene, program, found))
    print(f"\nSeconds of a processor for a simulated one:\n{fastest(runs)}")


if __name__ == "__main__":
    main()
