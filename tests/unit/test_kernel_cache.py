# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops are out of date when what they are made of changes."""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from flexfem._files import open_lock
from flexfem._trust import private_folder
from flexfem.kernels import caching
from flexfem.kernels.caching import source_stamp
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.lie import so3

FILES = {
    "low.py": "A = 1\n",
    "middle.py": "from flexfem.low import A\n",
    "deep/high.py": "import numpy\nfrom flexfem.middle import (\n    A,\n)\n",
    "other.py": "B = 2\n",
    "deep/__init__.py": "",
    "deep/part.py": "C = 3\n",
    "highest.py": "from flexfem.deep import (\n    part,\n)\n",
}


def test_stamps_follow_all_that_is_imported(tmp_path):
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    high = tmp_path / "deep/high.py"
    first = source_stamp(high, tmp_path)
    (tmp_path / "other.py").write_text("B = 3\n")
    assert source_stamp(high, tmp_path) == first
    # numba's own stamp, that of high.py alone, would not change
    (tmp_path / "low.py").write_text("A = 2\n")
    assert source_stamp(high, tmp_path) != first
    # a module that is imported from its package
    highest = tmp_path / "highest.py"
    first = source_stamp(highest, tmp_path)
    (tmp_path / "deep/part.py").write_text("C = 4\n")
    assert source_stamp(highest, tmp_path) != first


def test_loops_of_the_package_have_such_stamps():
    locator = so3.exp_into._cache._impl.locator
    assert isinstance(locator, caching._Kept)
    assert locator.get_source_stamp() == source_stamp(Path(so3.__file__))


def test_sources_that_changed_after_the_start_have_a_stamp_of_the_process_alone(monkeypatch):
    """The code of this process is the former one: others must not take it for the new one."""
    path = Path(so3.__file__)
    read = caching._read.__wrapped__
    assert read(path) == path.read_bytes()
    monkeypatch.setattr(caching, "_BEGIN", path.stat().st_ctime)
    assert read(path) != path.read_bytes()


OPEN = """
import flexfem.lie.so3 as so3
print(so3.exp_into._cache._impl.locator.get_cache_path(), flush=True)
"""


@pytest.mark.serial
def test_loops_are_not_taken_from_folders_of_others(tmp_path):
    """Whatever is unpickled there would be run: a folder that all can write is left alone."""
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "open")}
    command = [sys.executable, "-c", OPEN]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert not ended.stdout.startswith(str(tmp_path))
    assert ended.stderr.count("\n") == 1
    assert f'all users may write into "{tmp_path}/open"' in ended.stderr
    assert "NUMBA_CACHE_DIR names a folder of your own" in ended.stderr
    assert not any((tmp_path / "open").iterdir())


def test_loops_without_any_folder_are_kept_for_the_process(monkeypatch):
    """Numba would refuse to load the module."""
    own = private_folder()
    monkeypatch.setattr(caching, "trusted", lambda folder, *_: Path(folder).is_relative_to(own))
    locators = map(caching.__dict__.get, ("InTreeLocator", "UserWideLocator", "ProcessLocator"))
    found = [locator.from_function(so3.exp_into.py_func, so3.__file__) for locator in locators]
    assert found[:2] == [None, None]
    assert Path(found[2].get_cache_path()).parent == own


TOGETHER = """
import sys, time
import numpy as np
from flexfem.lie import so3
time.sleep(max(0.0, float(sys.argv[1]) - time.time()))
so3.exp(np.zeros(3))
print(sum(so3._exp_loop.stats.cache_misses.values()))
"""


@pytest.mark.slow
@pytest.mark.serial
def test_one_of_two_processes_compiles_a_loop(tmp_path):
    """Both need it at the same moment; without a lock both would compile it."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", TOGETHER, str(time.time() + 5.0)]
    both = [
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    assert sorted(int(process.communicate()[0]) for process in both) == [0, 1]


@pytest.mark.slow
@pytest.mark.serial
def test_loops_are_compiled_where_no_lock_can_be_had(tmp_path):
    """As in an image whose folders cannot be written, and on file systems without locks."""
    assert open_lock(tmp_path / "missing" / "compiling.lock") is None
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    script = "import fcntl\n\ndef lockf(*_):\n    raise OSError(38, 'not implemented')\n\n"
    command = [sys.executable, "-c", f"{script}fcntl.lockf = lockf\n{TOGETHER}", "0"]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert int(ended.stdout) == 1


@inlined
def _entry(values, at):
    return values[at]


@kernel
def _ends(values):
    return _entry(values, 0) + 10.0 * _entry(values, 2)


@kernel
def _first(values):
    return values[0]


@kernel
def _second(values):
    return values[1]


@kernel
def _third(values):
    return values[2]


DAMAGED = """
import numpy as np
from tests.unit import test_kernel_cache as loops
for loop in (loops._ends, loops._first, loops._second, loops._third):
    loop(np.array([1.0, 2.0, 3.0]))
    print(sum(loop.stats.cache_misses.values()))
"""


@pytest.mark.slow
@pytest.mark.serial
def test_files_that_cannot_be_read_are_written_anew(tmp_path):
    """Numba's own reader ends the program where an older version had classes that are gone."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def misses():
        command = [sys.executable, "-c", DAMAGED]
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return [int(line) for line in ended.stdout.split()]

    def file_of(loop, suffix):
        (kept,) = tmp_path.rglob(f"test_kernel_cache.{loop}-*.{suffix}")
        return kept

    assert misses() == [1, 1, 1, 1]
    for loop, suffix in (("_ends", "nbi"), ("_first", "nbc")):
        kept = file_of(loop, suffix)
        kept.write_bytes(kept.read_bytes()[: kept.stat().st_size // 2])
    gone = b"cflexfem.lie.so3\nGone\n."
    file_of("_second", "nbi").write_bytes(pickle.dumps(numba.__version__) + gone)
    file_of("_third", "nbc").write_bytes(gone)
    assert misses() == [1, 1, 1, 1]  # compiled
    assert misses() == [0, 0, 0, 0]  # and kept again


@pytest.mark.serial
def test_constants_do_not_compile_a_loop_anew():
    assert _ends(np.array([1.0, 2.0, 3.0])) == 31.0
    _ends.recompile()  # it may have come from the cache
    # numba's own decorator compiles it for 0 and once more for 2
    assert len(_entry.signatures) == 1


@subroutine
def _scaled(values, factor):
    """Calls another one, and one of NumPy."""
    out = np.zeros(values.size)
    for i in range(values.size):
        out[i] = factor * _entry(values, i)
    return out


@kernel
def _total(values, factor):
    return _scaled(values, factor).sum() + _scaled(values, 1.0)[0]


CALLED = """
import numpy as np
from tests.unit.test_kernel_cache import _scaled, _total
print(_total(np.array([1.0, 2.0]), 2.0), sum(_scaled.stats.cache_hits.values()))
"""


@pytest.mark.slow
@pytest.mark.serial
def test_subroutines_are_kept_without_machine_code(tmp_path):
    """Nor are they called from Python: what numba would make of them for that takes long."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def run():
        command = [sys.executable, "-c", CALLED]
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return ended.stdout.split()

    assert run() == ["7.0", "0"]
    for file in tmp_path.rglob("*_total*"):
        file.unlink()
    assert run() == ["7.0", "1"]  # the loop was compiled again from what was kept
    with pytest.raises(TypeError, match="_scaled is a part of compiled loops"):
        _scaled(np.zeros(2), 1.0)
