# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknown names of options in Python."""

import inspect

import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

CLASSES = [
    ff.CampbellOptions,
    ff.LinearOptions,
    ff.ModeOptions,
    ff.RelaxationOptions,
    ff.RunOptions,
    ff.StaticOptions,
]


@pytest.mark.parametrize("kind", CLASSES)
def test_unknown_options_are_refused_with_the_nearest_name(kind: type) -> None:
    """One line names the class, the option and what may be meant, or all options."""
    with pytest.raises(TypeError) as near:
        kind(out="here")
    assert str(near.value) == f"{kind.__name__}: no option 'out', did you mean output"
    with pytest.raises(TypeError) as far:
        kind(zzz=1)
    assert str(far.value).startswith(f"{kind.__name__}: no option 'zzz', known are ")
    assert ", progress, quiet, " in str(far.value)
    assert_on_page(str(near.value))
    assert_on_page(str(far.value))


@pytest.mark.parametrize("kind", CLASSES)
def test_values_without_a_name_are_refused(kind: type) -> None:
    """Options have no order; the constructor still shows all of them."""
    with pytest.raises(TypeError) as raised:
        kind(1e-3)
    assert str(raised.value).startswith(f"{kind.__name__}: give options by name, as ")
    assert_on_page(str(raised.value))
    assert {"output", "quiet"} <= inspect.signature(kind).parameters.keys()
