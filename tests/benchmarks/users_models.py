# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models as users write them: set-up, time of a step, and size of the results, on 1 and 2 ranks.

The crane of the README, the scripts in ``examples/``, whose parts are in the order of their users,
the case ``turbine``, and a shell of a hundred thousand unknowns. Each run is a fresh process with
one thread a rank; fields are written as often as by default. Run from the source tree::

    python tests/benchmarks/users_models.py
    python tests/benchmarks/users_models.py --models frame,quadruped --ranks 1
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def load(path: Path) -> ModuleType:
    """A script as a module."""
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def crane():  # type: ignore[no-untyped-def]
    """The script of the README."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    script = next(block for block in blocks if 'name="crane"' in block)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "crane.py"
        path.write_text(script)
        case = next(x for x in vars(load(path)).values() if type(x).__name__ == "Case")
    return case.model(**case.prepare({})[0])


def turbine():  # type: ignore[no-untyped-def]
    """The case."""
    case = load(ROOT / "cases" / "turbine.py").CASE
    return case.model(**case.prepare({})[0])


def shell():  # type: ignore[no-untyped-def]
    """A clamped plate with directors that its weight sets in motion."""
    import flexfem as ff

    surface = ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (65, 65))
    steel = ff.ShellSection.isotropic(0.005, ff.Material(2.1e11, 0.3, 7850.0))
    model = ff.Model("shell", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("plate", steel, element="director", edges={"plate_left": "clamped"}),
        ff.PositionProbe("corner", ff.Marker("plate", "plate_bottom_right")),
    )
    return model


def example(name: str, **given: object) -> Callable[[], object]:
    """Builder of a script in ``examples/``."""
    return lambda: load(ROOT / "examples" / f"{name}.py").build(**given)


#: Builder, step (s) and number of steps.
MODELS: dict[str, tuple[Callable[[], object], float, int]] = {
    "crane": (crane, 1e-3, 500),
    "frame": (example("frame"), 2e-3, 50),
    "frame, by kind": (example("frame", by_kind=True), 2e-3, 50),
    "excavator": (example("hydraulic_excavator"), 4e-3, 250),
    "robot arm": (example("robot_arm"), 2e-3, 250),
    "quadruped": (example("quadruped"), 2e-3, 250),
    "belt drive": (example("belt_drive"), 5e-4, 500),
    "turbine": (turbine, 0.05, 200),
    "shell": (shell, 1e-3, 5),
}


def measure(name: str) -> None:
    """Run a model in this process, and print what was measured on the first rank."""
    begin = time.perf_counter()
    import flexfem as ff

    build, dt, steps = MODELS[name]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(os.environ.get("FLEXFEM_BENCHMARK", folder)) / "results"
        model = build()
        built = time.perf_counter() - begin
        options = ff.RunOptions(dt=dt, t_end=steps * dt, quiet=True, output=place)
        outcome = ff.simulate(model, options)  # type: ignore[arg-type]
        if outcome.history is None or not len(outcome.history):
            return
        size = sum(f.stat().st_size for f in place.rglob("*") if f.is_file())
    summary = outcome.summary
    print(json.dumps({
        "status": outcome.status, "declared": built, "unknowns": summary["unknowns"],
        "set_up": summary["wall_seconds_setup"],
        "step": 1e3 * summary["wall_seconds_steps"] / summary["steps"],
        "whole": 1e3 * (summary["wall_seconds"] - summary["wall_seconds_setup"]) / summary["steps"],
        "iterations": summary["newton_iterations"] / summary["steps"],
        "factorizations": summary["factorizations"], "megabytes": size / 1e6,
    }))  # fmt: skip


def run(name: str, ranks: int) -> dict[str, float]:
    """Measure a model in fresh processes."""
    start = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {
            "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT), "FLEXFEM_BENCHMARK": folder,
        }  # fmt: skip
        done = subprocess.run(
            [*start, sys.executable, __file__, "--one", name], env=environment, text=True,
            capture_output=True, check=True, cwd=folder,
        )  # fmt: skip
    found: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", default=",".join(n for n in MODELS if "," not in n))
    parser.add_argument("--ranks", default="1,2")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        measure(given.one)
        return
    print("| model | unknowns | ranks | declared s | set-up s | ms a step | with output | "
          "iterations | factorisations | MB |")  # fmt: skip
    print("|---" * 10 + "|")
    for name in MODELS if given.models == "all" else given.models.split(","):
        for ranks in map(int, given.ranks.split(",")):
            x = run(name, ranks)
            print(f"| {name} | {x['unknowns']} | {ranks} | {x['declared']:.2f} | "
                  f"{x['set_up']:.2f} | "
                  f"{x['step']:.2f} | {x['whole']:.2f} | {x['iterations']:.1f} | "
                  f"{x['factorizations']} | {x['megabytes']:.1f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
