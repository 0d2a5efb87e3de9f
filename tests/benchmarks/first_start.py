# SPDX-License-Identifier: LGPL-3.0-or-later
"""Seconds of processors that a short run takes with nothing compiled, and once more with all of it.

Run from the source tree; prints a line of JSON::

    python -m tests.benchmarks.first_start --case slider_crank

Loops and forms are kept in a folder of its own, which is removed. ``loops`` and ``signatures``
count what is kept; ``functions`` what was compiled, with numba's own ones, which each process
compiles again.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

#: Runs the command line and writes how many functions numba has compiled to a file.
_COUNTED = """
import atexit, sys
from pathlib import Path
from numba.core.dispatcher import _FunctionCompiler

compile_core, count = _FunctionCompiler._compile_core, []

def counted(self, args, return_type):
    count.append(self)
    return compile_core(self, args, return_type)

_FunctionCompiler._compile_core = counted
file = Path(sys.argv.pop(1))
atexit.register(lambda: file.write_text(str(len(count))))
from flexfem.cli.command import command
sys.exit(command())
"""


def _run(case: str, folder: Path) -> dict[str, float | int]:
    """A short run with what the folder keeps."""
    kept = {"NUMBA_CACHE_DIR": str(folder / "loops"), "XDG_CACHE_HOME": str(folder / "forms")}
    line = ["run", case, "--smoke", "--quiet", "--output", str(folder / "results")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-P", "-c", _COUNTED, str(folder / "count"), *line],
        env={**os.environ, **kept}, check=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 2),
        "functions": int((folder / "count").read_text()),
        "loops": len(list((folder / "loops").rglob("*.nbi"))),
        "signatures": len(list((folder / "loops").rglob("*.nbc"))),
    }


def main() -> None:
    """Measure a case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", default="slider_crank", help="name of a case, or its file")
    case = parser.parse_args().case
    with tempfile.TemporaryDirectory(prefix="flexfem-start-") as folder:
        cold, warm = _run(case, Path(folder)), _run(case, Path(folder))
    print(json.dumps({"case": case, "cold": cold, "warm": warm}))


if __name__ == "__main__":
    main()
