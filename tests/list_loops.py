# SPDX-License-Identifier: LGPL-3.0-or-later
"""Write ``flexfem/system/loops.txt``: loops that are compiled beside a first run.

Run from the source tree, after cases were run for the first time::

    python -m tests.list_loops slider_crank deployable_truss ...

First come loops that three quarters of all cases call: they are compiled before it is known which
modules a run loads. Then come those which at least half of the cases call that load their module,
then the others. Within each, the largest third comes first, since the largest take longest; the
others are in the reverse order of use. The run goes through them in the order of use and compiles
what it finds missing, so that it meets the other process once, in the middle.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from flexfem._beside import LIST

#: Runs a case and prints its modules, and module, name, size and argument types of its loops in the
#: order of use.
_RUN = """
import json, sys
from numba.core.dispatcher import Dispatcher

compile_loop, called = Dispatcher.compile, {}

def noted(self, signature):
    called.setdefault((self, tuple(signature)))
    return compile_loop(self, signature)

Dispatcher.compile = noted
from flexfem.cli.command import command
from flexfem.system.compile_beside import text_of

assert command() == 0
modules = sorted(name for name in sys.modules if name.startswith("flexfem."))
loops = []
for loop, signature in called:
    module, name = loop.py_func.__module__, loop.py_func.__qualname__
    result = loop.overloads.get(signature)
    library = getattr(result, "library", None)
    # only of loops that Python calls, by a name of their module
    if not getattr(library, "called", False):
        continue
    named = sys.modules[module]
    for part in name.split("."):
        named = getattr(named, part, None)
    if named is not loop:
        continue
    kept = library.kept()
    size = len(kept.machine_code) + sum(len(unit.machine_code) for unit in kept.units)
    try:
        loops.append([module, name, size, [text_of(kind) for kind in signature]])
    except ValueError as error:
        print(f"{module}.{name}: {error}", file=sys.stderr)
print(json.dumps([modules, loops]))
"""

#: Module, name and argument types of a loop, as JSON.
_Loop = tuple[str, str, str]


def _loops(case: str) -> tuple[set[str], dict[_Loop, int]]:
    """Modules of a case, and sizes of its loops in the order of use."""
    with tempfile.TemporaryDirectory() as folder:
        line = ["run", case, "--smoke", "--quiet", "--output", str(Path(folder) / "results")]
        for _ in range(2):  # what was compiled by the first run is loaded by the second
            ended = subprocess.run(
                [sys.executable, "-c", _RUN, *line], capture_output=True, text=True, check=True
            )
    sys.stderr.write(ended.stderr)
    modules, loops = json.loads(ended.stdout.splitlines()[-1])
    return set(modules), {
        (module, name, json.dumps(kinds)): size
        for module, name, size, kinds in loops
        if module.startswith("flexfem.")
    }


def _in_order(loops: list[_Loop], sizes: dict[_Loop, int], use: dict[_Loop, float]) -> list[_Loop]:
    """The largest third, then the others from the last that is used to the first."""
    by_size = sorted(loops, key=lambda loop: (-sizes[loop], loop))
    third = len(loops) // 3
    return by_size[:third] + sorted(by_size[third:], key=lambda loop: (-use[loop], loop))


def main(cases: list[str]) -> None:
    """Run the cases, and write the list."""
    loaded, called = Counter[str](), Counter[_Loop]()
    sizes, use = dict[_Loop, int](), dict[_Loop, float]()
    for case in cases:
        modules, loops = _loops(case)
        print(f"{case}: {len(loops)} loops", flush=True)
        loaded.update(modules)
        called.update(loops.keys())
        sizes |= loops
        for place, loop in enumerate(loops):  # the earliest place in any case
            use[loop] = min(use.get(loop, 1.0), place / len(loops))
    groups: list[list[_Loop]] = [[], [], []]
    for loop in called:
        usual = 4 * called[loop] >= 3 * len(cases)
        groups[0 if usual else 1 if 2 * called[loop] >= loaded[loop[0]] else 2].append(loop)
    lines = [
        json.dumps([module, name, group is groups[0], json.loads(kinds)])
        for group in groups
        for module, name, kinds in _in_order(group, sizes, use)
    ]
    LIST.write_text("\n".join(lines) + "\n", encoding="ascii")
    print(f"{len(lines)} loops are listed, {len(groups[0])} of them for nearly all models")


if __name__ == "__main__":
    main(sys.argv[1:])
