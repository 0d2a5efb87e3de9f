# SPDX-License-Identifier: LGPL-3.0-or-later
"""Write ``flexfem/system/loops.txt``: loops that are compiled beside a first run.

Run from the source tree, after cases were run for the first time::

    python -m tests.list_loops slider_crank deployable_truss ...

First come loops which at least half of the cases call that load their module, then the others,
both by the size of their code: the largest take longest.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from flexfem.system.compile_beside import LIST

#: Runs a case and prints its modules, and module, name, size and argument types of its loops.
_RUN = """
import json, sys
from numba.core.dispatcher import Dispatcher
from flexfem.cli.command import command

assert command() == 0
modules = sorted(name for name in sys.modules if name.startswith("flexfem."))
loops = set()
for name in modules:
    for value in list(vars(sys.modules[name]).values()):
        if isinstance(value, Dispatcher) and value.__module__ == name and value.overloads:
            for result in value.overloads.values():
                code = getattr(result.library, "_bitcode", None)  # only of loops that Python calls
                kinds = tuple(map(str, result.signature.args))
                if code is not None:
                    loops.add((name, value.__name__, len(code), kinds))
print(json.dumps([modules, sorted(loops)]))
"""


def _loops(case: str) -> tuple[set[str], dict[tuple[str, ...], int]]:
    """Modules of a case, and sizes of its loops."""
    with tempfile.TemporaryDirectory() as folder:
        line = ["run", case, "--smoke", "--quiet", "--output", str(Path(folder) / "results")]
        for _ in range(2):  # what was compiled by the first run is loaded by the second
            ended = subprocess.run(
                [sys.executable, "-c", _RUN, *line], capture_output=True, text=True, check=True
            )
    modules, loops = json.loads(ended.stdout.splitlines()[-1])
    return set(modules), {(module, name, *kinds): size for module, name, size, kinds in loops}


def main(cases: list[str]) -> None:
    """Run the cases, and write the list."""
    loaded, called, sizes = Counter[str](), Counter[tuple[str, ...]](), dict[tuple[str, ...], int]()
    for case in cases:
        modules, loops = _loops(case)
        print(f"{case}: {len(loops)} loops", flush=True)
        loaded.update(modules)
        called.update(loops.keys())
        sizes |= loops
    often = {loop for loop in called if 2 * called[loop] >= loaded[loop[0]]}
    listed = sorted(called, key=lambda loop: (loop not in often, -sizes[loop], loop))
    LIST.write_text("".join("\t".join(loop) + "\n" for loop in listed), encoding="ascii")
    print(f"{len(listed)} loops are listed, {len(often)} of them first")


if __name__ == "__main__":
    main(sys.argv[1:])
