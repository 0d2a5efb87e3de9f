# SPDX-License-Identifier: LGPL-3.0-or-later
"""The runs of a study: their options, checked, and the names of their folders."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import flexfem
from flexfem.analyses.analysis import Analysis
from flexfem.case import case_file, load_case
from flexfem.options import Option
from flexfem.studies.variations import combinations, value_text

__all__ = ["Plan", "PlannedRun"]

#: Length of a folder's name from which on it is cut.
_LONG = 120


@dataclass(frozen=True)
class PlannedRun:
    """One run of a study.

    Attributes:
        name: of its folder.
        parameters: values of the options that are varied.
        record: data that identify the run, as written into its folder.
        arguments: of the command ``run``, without those that concern the output.
    """

    name: str
    parameters: Mapping[str, Any]
    record: Mapping[str, Any]
    arguments: Sequence[str]


class Plan:
    """All runs of a study of one case.

    Attributes:
        case: under the selected analysis.
        runs: in the order of their parameters.
        identity: data that runs of one study have in common.
    """

    def __init__(
        self,
        name: str | Path,
        varied: Mapping[str, Sequence[Any]],
        options: Mapping[str, Any],
        *,
        together: bool,
        smoke: bool,
        analysis: Analysis | None,
    ) -> None:
        """Load the case and check the options of all runs.

        Args:
            name: of a shipped case, or the path of a case file.
            varied: values by option.
            options: values that are the same in all runs.
            together: see :func:`combinations`.
            smoke: a few steps on tiny meshes.
            analysis: other than that of the case.

        Raises:
            TypeError: A value has the wrong type.
            ValueError: There is no such case or option, or a value is not admissible.
        """
        case = load_case(name)
        self.case = case if analysis in (None, case.analysis) else case.under(analysis)
        self._options = {option.name: option for option in self.case.all_options()}
        path = case_file(name)
        shown = str(name) if path.stem == str(name) else str(path)
        own = [] if self.case is case else ["--analysis", self.case.analysis.name]
        self._start = [shown, *own, *(["--smoke"] if smoke else [])]
        both = [key for key in varied if key in options]
        if both:
            raise ValueError(f"{both[0]} is varied, and has a value of its own")
        self._checked(options, smoke)
        self.identity = {
            "case": shown, "analysis": self.case.analysis.name, "smoke": smoke,
            "options": self._plain(options), "varied": sorted(varied),
        }  # fmt: skip
        self._versions = {
            "flexfem": flexfem.__version__,
            "case_file": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        self.runs: list[PlannedRun] = []
        for values in combinations(varied, together):
            self._checked({**options, **values}, smoke)
            self.runs.append(self._run(self._plain(values), self._plain(options)))

    def _checked(self, values: Mapping[str, Any], smoke: bool) -> None:
        """Check the options of a run, also against each other."""
        try:
            self.case.prepare(values, smoke=smoke)
        except (TypeError, ValueError) as error:
            told = " ".join(f"{name}={value_text(value)}" for name, value in values.items())
            raise type(error)(f"{told}: {error}" if told else str(error)) from None

    def _plain(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values as the options' own types."""
        return {name: self._options[name].check(value) for name, value in values.items()}

    def _run(self, values: dict[str, Any], options: dict[str, Any]) -> PlannedRun:
        name = "_".join(f"{key}={value_text(value)}" for key, value in values.items())
        plain = re.sub(r"[^\w.=+-]", "-", name)
        if plain != name or len(plain) > _LONG:  # two may have become the same
            plain = f"{plain[:_LONG]}_{hashlib.sha256(name.encode()).hexdigest()[:8]}"
        chosen = {**options, **values}
        arguments = [_argument(self._options[key], value) for key, value in chosen.items()]
        record = {**self.identity, "options": chosen, **self._versions}
        return PlannedRun(plain, values, record, [*self._start, *arguments])


def _argument(option: Option, value: Any) -> str:
    """An option with its value on the command line."""
    if option.kind is bool:
        return option.flag if value else "--no-" + option.flag.removeprefix("--")
    return f"{option.flag}={value_text(value)}"
