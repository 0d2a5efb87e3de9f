# SPDX-License-Identifier: LGPL-3.0-or-later
"""The script that makes small wrong changes: what it changes, and which tests it would run."""

import random

import pytest

from tests import mutations

pytestmark = pytest.mark.serial


def test_changes_are_small_and_the_same_with_the_same_seed() -> None:
    path = mutations.ROOT / "flexfem/joints/bushing.py"
    every = [change for change in mutations.changes(path) if change.valid()]
    kinds = {change.kind for change in every}
    assert {"operator", "comparison", "constant", "sign", "condition"} <= kinds
    before = path.read_bytes()
    for change in every:
        # all but the changed place is as before, and the file itself is left alone
        assert change.text.startswith(before[: change.begin])
        assert change.text.endswith(before[change.end :])
    assert path.read_bytes() == before
    one, other = (mutations.chosen(["joints", "readers"], 2, random.Random(4)) for _ in range(2))
    assert one == other
    assert [area for area, _ in one] == ["joints", "readers"]


@pytest.mark.parametrize(
    ("module", "test"),
    [
        ("io/tables/section_table.py", "tests/unit/test_section_table.py"),
        ("integrators/energy_momentum/scheme.py", "tests/verification/test_energy_momentum.py"),
        ("research/moving_base/comparison/floating.py", "tests/unit/test_moving_base_floating.py"),
    ],
)
def test_tests_of_a_module_are_found(module: str, test: str) -> None:
    assert test in mutations.mapped(mutations.ROOT / "flexfem" / module)
