# SPDX-License-Identifier: LGPL-3.0-or-later
"""Commands on the page of the papers are those that the program takes; nothing is run."""

import re
import shlex

import pytest

from flexfem.cli.case_line import parse, read_options
from flexfem.cli.case_run import load_case
from flexfem.cli.commands import plot, render, sweep
from flexfem.docs.extensions.topics import SOURCES
from flexfem.resources import shipped_files
from flexfem.studies.variations import parse_variation

pytestmark = pytest.mark.serial

PAGE = (SOURCES / "guide" / "papers.md").read_text(encoding="utf-8")
COMMANDS = sorted(set(re.findall(r"^\$ (.*)$", PAGE, re.MULTILINE)))
CASES = ("slider_crank", "sliding_beam", "deployable_truss", "spin_up", "manipulator_deployment",
         "formalisms", "circular_strips", "cylindrical_pendulum", "draping", "solar_array",
         "parallel_manipulator")  # fmt: skip


def test_every_case_of_the_papers_is_there() -> None:
    used = {shlex.split(text)[2] for text in COMMANDS if text.split()[1] in {"run", "sweep"}}
    assert used == set(CASES)
    assert used <= set(shipped_files("cases"))


@pytest.mark.parametrize("text", COMMANDS)
def test_command_parses(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program, command, *argv = shlex.split(text)
    assert program == "flexfem"
    if command == "run":
        parse(load_case(argv[0]), argv[1:], writes=False)
    elif command == "sweep":
        own, rest = sweep._parser("flexfem sweep").parse_known_args(argv[1:])
        case, _ = read_options(load_case(argv[0]), rest)
        options = {option.name: option for option in case.all_options()}
        for varied in own.vary:
            parse_variation(varied, options)
    elif command == "plot":
        plot._parser("flexfem plot").parse_args(argv)
    else:
        assert command == "render"
        parsed = []
        monkeypatch.setattr(render, "print_files", lambda make: parsed.append(make) or 0)
        pytest.importorskip("pyvista")
        assert render.execute(argv, "flexfem render") == 0
        assert parsed
