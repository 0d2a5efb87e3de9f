# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the README shows is what there is."""

import re
from pathlib import Path

import pytest

import flexfem as ff
from tests.cases.examples import assert_runs, complete_examples, python

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLES = complete_examples(README)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_examples_run(number: int, tmp_path: Path) -> None:
    assert_runs(EXAMPLES[number], tmp_path)


def test_help_text() -> None:
    text = python(ROOT / "cases" / "slider_crank.py", "--help", COLUMNS="80")
    assert text[text.index("this case:") : text.index("Writes history")].strip() in README


def test_all_cases_are_listed() -> None:
    listed = README[README.index("| case | analysis |") : README.index("The options of")]
    names = {path.stem for path in (ROOT / "cases").glob("*.py")}
    assert set(re.findall(r"^\| `(\w+)` \|", listed, re.MULTILINE)) == names


def test_public_names_exist_and_are_listed() -> None:
    listed = README[README.index("## What there is") : README.index("## Restart and")]
    names = set(re.findall(r"\bff\.(\w+)", README))
    names |= set(re.findall(r"`([A-Z]\w+)(?=[`.(])", listed))
    for name in names:
        assert hasattr(ff, name), name
    told = set(re.findall(r"\w+", README))
    # what examples and the help of others say
    unsaid = {"Pose", "MarkerState", "Outcome", "LinearModel", "__version__"}
    assert set(ff.__all__) - told <= unsaid


def test_number_of_verified_values() -> None:
    table = (ROOT / "tests" / "verification" / "TABLE.md").read_text()
    count = table.rstrip().splitlines()[-1].split(" values")[0]
    assert f"The table has {count} values" in README
