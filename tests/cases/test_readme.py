# SPDX-License-Identifier: LGPL-3.0-or-later
"""The README agrees with the package."""

import re
from pathlib import Path

import pytest

import flexfem as ff
from flexfem import research
from tests.cases.examples import assert_printed, complete_examples, python, run_in_turn

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "flexfem" / "docs" / "guide"
README = (ROOT / "README.md").read_text()
EXAMPLES = complete_examples(README)


def test_examples_run(tmp_path: Path) -> None:
    assert EXAMPLES
    for text, left in zip(EXAMPLES, run_in_turn(EXAMPLES, tmp_path), strict=True):
        assert_printed(text, *left)


def test_all_cases_are_listed() -> None:
    listed = README[README.index("| case | analysis |") : README.index("Common options")]
    names = {path.stem for path in (ROOT / "cases").glob("*.py")}
    assert set(re.findall(r"^\| `(\w+)` \|", listed, re.MULTILINE)) == names


def test_public_names_exist() -> None:
    overview = (GUIDE / "overview.md").read_text()
    names = set(re.findall(r"\bff\.(\w+)", README + overview))
    names |= set(re.findall(r"`([A-Z]\w+)(?=[`.(])", overview))
    for name in names - set(research.__all__):
        assert hasattr(ff, name), name


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(links) > 10
    for link in links:
        assert (ROOT / link).exists(), link


def test_common_options_exist() -> None:
    shown = README[README.index("Common options") : README.index("Exit codes")]
    text = python(ROOT / "cases" / "slider_crank.py", "--help", COLUMNS="80")
    for option in re.findall(r"`(--[a-z-]+)`", shown):
        assert f"  {option} " in text, option


def test_number_of_verified_values() -> None:
    table = (ROOT / "tests" / "verification" / "TABLE.md").read_text()
    count = table.partition(" values, ")[0].split()[-1]
    assert f"[{count} values]" in README
    assert f"The table has {count} values" in (GUIDE / "performance.md").read_text()
