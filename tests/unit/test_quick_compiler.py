# SPDX-License-Identifier: LGPL-3.0-or-later
"""FFCx with less to look for makes the same code; its folder after runs that were killed."""

import gc
import os
import subprocess
import sys
import time
from importlib import metadata

import pytest
from ffcx.ir.analysis import graph

from flexfem.kernels.ffcx_options import quick_compiler, remove_abandoned

pytestmark = pytest.mark.serial

CODE = """
import sys
from contextlib import nullcontext
from ffcx.compiler import compile_ufl_objects
from ffcx.options import get_options
from flexfem.forms.beam import beam_forms
from flexfem.kernels.ffcx_options import quick_compiler

forms = beam_forms(True)
with quick_compiler() if sys.argv[1] == "quick" else nullcontext():
    code, _ = compile_ufl_objects([forms.residual], get_options(), namespace="beam")
sys.stdout.write(code[1])
"""


@pytest.mark.slow
def test_code_is_that_of_ffcx():
    """FFCx numbers tables in the order of a set: with one seed of hashes it is always the same."""
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    usual, quick = (
        subprocess.run(
            [sys.executable, "-c", CODE, how], env=environment, capture_output=True, check=True
        ).stdout
        for how in ("usual", "quick")
    )
    assert len(usual) > 10_000
    assert quick == usual


def test_ffcx_is_left_as_it_was():
    usual, searched = graph.ValueNumberer, metadata.entry_points

    def fail():
        with quick_compiler():
            assert graph.ValueNumberer is not usual
            assert metadata.entry_points is not searched
            assert not gc.isenabled()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert graph.ValueNumberer is usual
    assert metadata.entry_points is searched
    assert gc.isenabled()


def test_entry_points_are_those_of_the_installed_packages(monkeypatch):
    """Setuptools would lack commands of other packages; read again, 0.04 s a form."""
    wanted = {"group": "console_scripts", "name": "flexfem"}
    usual = metadata.entry_points(**wanted)
    with quick_compiler():
        metadata.entry_points()
        monkeypatch.setattr(metadata, "distributions", None)
        assert metadata.entry_points(**wanted) == usual
    assert usual


def test_other_versions_of_ffcx_are_let_alone(monkeypatch):
    monkeypatch.setattr(graph, "ValueNumberer", object)
    with quick_compiler():
        assert graph.ValueNumberer is object
    monkeypatch.delattr(graph, "ValueNumberer")
    with quick_compiler():
        assert not hasattr(graph, "ValueNumberer")


def test_sources_of_runs_that_were_killed(tmp_path):
    """Every later run would wait two minutes for one, and fail."""
    old = time.time() - 1000.0
    for name in ("libffcx_forms_killed.c", "libffcx_forms_done.c", "libffcx_forms_begun.c", "x.c"):
        (tmp_path / name).write_text("")
        if "begun" not in name:
            os.utime(tmp_path / name, (old, old))
    (tmp_path / "libffcx_forms_done.c.cached").touch()
    remove_abandoned(tmp_path)
    left = {file.name for file in tmp_path.glob("*.c")}
    assert left == {"libffcx_forms_done.c", "libffcx_forms_begun.c", "x.c"}
