# SPDX-License-Identifier: LGPL-3.0-or-later
"""The runs of a study: their options, checked, and the names of their folders."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import flexfem
from flexfem.analyses.analysis import Analysis
from flexfem.case import case_file, load_case
from flexfem.options import numbers_of, value_text, vector_of, with_components
from flexfem.studies.variations import combinations

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
        self._options = with_components(self.case.all_options())
        path = case_file(name)
        shown = str(name) if path.stem == str(name) else str(path)
        own = [] if self.case is case else ["--analysis", self.case.analysis.name]
        self._start = [shown, *own, *(["--smoke"] if smoke else [])]
        _check_single(varied, options)
        self._checked(options, smoke)
        self.identity = {
            "case": shown, "analysis": self.case.analysis.name, "smoke": smoke,
            "options": _as_json(self._plain(options)), "varied": sorted(varied),
        }  # fmt: skip
        self._versions = {
            "flexfem": flexfem.__version__,
            "case_file": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        self.runs: list[PlannedRun] = []
        for values in combinations(_hashable(varied), together):
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
        name = re.sub(r"\[(\d+)\]=", r".\1=", name)  # shells take brackets for patterns
        plain = re.sub(r"[^\w.,=+-]", "-", name)
        if plain != name or len(plain) > _LONG:  # two may have become the same
            plain = f"{plain[:_LONG]}_{hashlib.sha256(name.encode()).hexdigest()[:8]}"
        chosen = {**options, **values}
        arguments = [_argument(key, value) for key, value in chosen.items()]
        record = {**self.identity, "options": _as_json(chosen), **self._versions}
        return PlannedRun(plain, values, record, [*self._start, *arguments])


def _check_single(varied: Iterable[str], options: Iterable[str]) -> None:
    """Refuse names with two sources of a value, also where one is of a component of the other.

    Raises:
        ValueError: There is one.
    """
    names = list(varied)
    for name in names:
        rest = [other for other in names if other != name]
        if name in options or vector_of(name) in rest or name in map(vector_of, options):
            raise ValueError(f"{name} is varied, and has a value of its own")


def _argument(name: str, value: Any) -> str:
    """An option with its value on the command line."""
    flag = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{flag}" if value else f"--no-{flag}"
    return f"--{flag}={value_text(value)}"


def _hashable(varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Values by option, with arrays and lists as tuples."""
    return {
        name: [value if numbers_of(value) is None else numbers_of(value) for value in values]
        for name, values in varied.items()
    }


def _as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as they are read from JSON again, where vectors are lists."""
    return {n: list(value) if isinstance(value, tuple) else value for n, value in values.items()}
