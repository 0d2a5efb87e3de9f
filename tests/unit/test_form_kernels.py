# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of the package's own forms are found without building the forms."""

import json
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.forms import beam
from flexfem.forms.beam import beam_forms
from flexfem.kernels import form_kernels
from flexfem.kernels.form_kernels import compile_forms

WANTED = {"residual": True, "inertia": False}
COMM = MPI.COMM_WORLD


@pytest.fixture
def folder(shared_tmp_path, monkeypatch):
    """An empty folder of indices, beside which there are the compiled modules."""
    here = form_kernels.kernel_folder()
    if COMM.rank == 0:
        for file in here.glob("libffcx_forms_*.so"):
            (shared_tmp_path / file.name).symlink_to(file)
    COMM.Barrier()
    monkeypatch.setattr(form_kernels, "kernel_folder", lambda: shared_tmp_path)
    return shared_tmp_path


@pytest.fixture
def built():
    """Arguments of all calls that build the forms of beams."""
    calls = []

    def beam_forms_noted(*arguments):
        calls.append(arguments)
        return beam_forms(*arguments)

    beam_forms_noted.__module__, beam_forms_noted.__qualname__ = beam.__name__, "beam_forms"
    return SimpleNamespace(function=beam_forms_noted, calls=calls)


def _same(one, two):
    assert one.names == two.names
    assert set(one.kernels) == set(two.kernels)
    for form, kernel in one.kernels.items():
        assert kernel.lanes == two[form].lanes
        # the offsets of another form would put data into the wrong places
        np.testing.assert_array_equal(kernel.offsets, two[form].offsets)


@pytest.mark.three_ranks
def test_forms_are_built_once_for_each_of_their_arguments(folder, built):
    first = compile_forms(COMM, built.function, (False,), WANTED)
    second = compile_forms(COMM, built.function, (False,), WANTED)
    assert built.calls == [(False,)]
    _same(first, second)
    assert [kernel.lanes for kernel in second.kernels.values()] == [8, 1]
    damped = compile_forms(COMM, built.function, (True,), WANTED)
    assert built.calls == [(False,), (True,)]
    # the damped residual takes one more number of each cell
    assert damped["residual"].offsets[-1] == first["residual"].offsets[-1] + 1


@pytest.mark.three_ranks
@pytest.mark.parametrize("fault", ["cut", "other", "gone", "no module"])
def test_forms_are_built_where_the_index_is_of_no_use(folder, built, fault):
    first = compile_forms(COMM, built.function, (False,), WANTED)
    if COMM.rank == 0:
        (file,) = folder.glob("*.json")
        names, entries = json.loads(file.read_text())
        if fault == "cut":
            file.write_text(file.read_text()[:-20])
        elif fault == "other":
            file.write_text(json.dumps([names, {**entries, "residual": ["/tmp/evil", [0]]}]))
        elif fault == "gone":
            file.unlink()
        else:
            for left in folder.glob(f"{entries['residual'][0]}.*"):
                left.unlink()
    COMM.Barrier()
    _same(first, compile_forms(COMM, built.function, (False,), WANTED))
    assert len(built.calls) == 2


@pytest.mark.serial
def test_forms_of_users_and_with_laws_are_not_indexed(folder, built):
    law = SimpleNamespace()
    assert form_kernels._index(built.function, (False, law), WANTED) is None
    assert form_kernels._index(compiled_by_a_user, (False,), WANTED) is None
    assert form_kernels._index(built.function, (False, None), WANTED) is not None


def compiled_by_a_user(damped):
    """A function of a module that is no part of the package."""
    return beam_forms(damped)
