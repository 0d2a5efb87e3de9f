# SPDX-License-Identifier: LGPL-3.0-or-later
"""The documentation names all that there is, and its examples run."""

import re

import pytest

from flexfem.docs.extensions.topics import (
    GALLERY,
    PLACES,
    SOURCES,
    arguments_of,
    cases_of,
    examples,
    names_of,
    sentences,
)
from flexfem.docs.pictures import PICTURES
from flexfem.resources import shipped_files
from tests.cases.examples import assert_printed, complete_examples, run_in_turn

pytestmark = pytest.mark.serial

PAGES = sorted(SOURCES.rglob("*.md"))
EXAMPLES = {
    f"{page.relative_to(SOURCES)}-{number}": text
    for page in PAGES
    for number, text in enumerate(complete_examples(page.read_text()))
}


def test_every_public_name_is_on_one_page() -> None:
    listed = [
        name for modules in arguments_of("public-names") for name in names_of(modules.split())
    ]
    assert sorted(listed) == sorted(PLACES)


def test_every_case_is_on_the_page_of_cases() -> None:
    listed = [name for analysis in arguments_of("cases") for name in cases_of(analysis)]
    assert sorted(listed) == sorted(shipped_files("cases"))


def test_every_tutorial_has_its_page() -> None:
    """A page is about the case of its name, or about a case or example named after its number."""
    pages = {page.stem for page in (SOURCES / "tutorials").glob("tutorial_*.md")}
    cases = set(shipped_files("cases"))
    assert {name for name in cases if name.startswith("tutorial_")} <= pages
    known = cases | set(examples())
    assert {page for page in pages if not {page, page.split("_", 2)[2]} & known} == set()
    index = (SOURCES / "tutorials" / "index.md").read_text()
    assert set(re.findall(r"^tutorial_\w+$", index, re.MULTILINE)) == pages


def test_every_case_and_example_is_in_the_gallery() -> None:
    """With a sentence and a picture; all pictures of the pages together are small."""
    listed = {
        name
        for kind in arguments_of("gallery")
        for name in (examples() if kind == "examples" else cases_of(kind))
    }
    assert {path.stem for path in GALLERY.glob("*.png")} == listed == set(sentences())
    assert all(said.endswith(".") and len(said) > 20 for said in sentences().values())
    assert sum(path.stat().st_size for path in SOURCES.rglob("*.png")) < 2.0e6


def test_every_picture_is_shown_and_can_be_made() -> None:
    """No page shows a picture that nobody makes, and none is left over."""
    shown = {name for page in PAGES for name in re.findall(r"figures/(\w+)\.png", page.read_text())}
    there = {path.stem for path in (SOURCES / "figures").glob("*.png")}
    assert shown == there == set(PICTURES)


def test_quoted_parts_of_cases_exist() -> None:
    """Start and end of each quotation are found in the file, as the documentation needs them."""
    for page in (SOURCES / "tutorials").glob("tutorial_*.md"):
        quoted = re.findall(r"\{literalinclude\} (\S+)\n((?::.*\n)+)", page.read_text())
        assert quoted, page
        for file, options in quoted:
            text = (page.parent / file).read_text()
            for mark in re.findall(r"^:(?:start-at|end-before): (.+)$", options, re.MULTILINE):
                quote = '"' if mark.startswith('"') else ""
                assert mark.removeprefix(quote).removesuffix(quote) in text, (page.name, mark)


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, str]]:
    """What the examples print, and their warnings."""
    texts = run_in_turn(list(EXAMPLES.values()), tmp_path_factory.mktemp("examples"))
    return dict(zip(EXAMPLES, texts, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name: str, printed: dict[str, tuple[str, str]]) -> None:
    assert_printed(EXAMPLES[name], *printed[name])
