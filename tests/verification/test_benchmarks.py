# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of mechanisms, and shells, against closed forms and independent computations."""

import pytest

from tests.verification.table import load, modules

pytestmark = pytest.mark.serial

#: Those of statics and modes of beams have tests of their own.
NAMES = [
    name for name in modules() if name.startswith(("rigid_", "flexible_", "shell_", "plastic_"))
]
#: Those that compile most, or take longest.
SLOW = (
    "plastic_solids",
    "flexible_solids",
    "shell_blanket",
    "shell_strips",
    "shell_damping",
    "flexible_formalisms",
    "flexible_gradients",
    "rigid_unit_scenes",
)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in NAMES]
)
def test_within_tolerance(name):
    """Coarse meshes, long steps or short spans."""
    # what each tolerance tells apart is said where it is set
    for result in load(name).results(full=False):
        assert result.error <= result.tolerance, result


@pytest.mark.slow
@pytest.mark.benchmark
@pytest.mark.parametrize("name", NAMES)
def test_table(name):
    """The meshes, steps and spans of the table."""
    for result in load(name).results():
        assert result.error <= result.tolerance, result
