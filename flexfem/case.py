# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declaration of a case: a named model with options, an analysis and headline results."""

import inspect
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks, launch
from flexfem._faults import FAILURES, mistake
from flexfem.analyses.analysis import Analysis
from flexfem.analyses.dynamics import DYNAMICS
from flexfem.analyses.modes import MODES
from flexfem.analyses.relaxation import RELAXATION
from flexfem.analyses.statics import STATICS
from flexfem.options import Option, Settings, meant, with_changed_components, with_components
from flexfem.resources import imported_elsewhere, load_module, shipped_files

if TYPE_CHECKING:
    from flexfem.model.model import Model
    from flexfem.simulation.run.outcome import Outcome

__all__ = ["Case", "case_file", "load_case"]

History = Mapping[str, npt.NDArray[np.float64]]
Results = Callable[..., Mapping[str, float]]

#: Arguments of the command line that are no numerical options.
_RESERVED = {
    "output", "quiet", "progress", "smoke", "help", "analysis", "restart", "state", "traceback",
    "checkpoint_every",
}  # fmt: skip

#: Arguments of a run besides its options: display, and the files to begin with.
_UNTOLD = ("progress", "restart", "state", "smoke")


class Case:
    """A runnable case.

    Attributes:
        name: Short name, also of the default output folder ``results/<name>``.
        summary: One line for ``flexfem list``.
        build: Called with one keyword argument per option, returns the model.
        options: The case's own options.
        analysis: Analysis of the model.
        settings: The case's defaults of the options of its analysis.
        smoke: Values ``--smoke`` sets: names of own options or of those of the analysis.
        presets: Other defaults that a value of an own option brings along:
            ``{option: {value: {name of an option: default}}}``.
        results: Headline results from the history (column name -> values over all rows); arguments
            that are keywords only are own options by name.
        description: Longer text for ``--help``, usually the case file's ``__doc__``.
        others: Other analyses that ``--analysis`` may name besides those of every model, with the
            case's defaults of their options and of its own.
        folder: Name of the results' folder: other analyses than the case's own have their own.
    """

    def __init__(
        self,
        name: str,
        summary: str,
        build: Callable[..., "Model"],
        options: Sequence[Option] = (),
        *,
        analysis: Analysis = DYNAMICS,
        smoke: Mapping[str, Any] | None = None,
        presets: Mapping[str, Mapping[Any, Mapping[str, Any]]] | None = None,
        results: Results | None = None,
        description: str = "",
        others: Mapping[Analysis, Mapping[str, Any]] | None = None,
        **settings: Any,
    ) -> None:
        """Declare a case; ``settings`` are its defaults, such as ``dt`` and ``t_end`` (s).

        Raises:
            TypeError: If a setting has the wrong type, or the analysis has none of that name.
            ValueError: If a name is unusable or used twice, or a value is not admissible.
        """
        self.name, self.summary, self.build = name, summary, build
        self.folder = name
        self.options, self.analysis, self.settings = tuple(options), analysis, settings
        self.smoke, self.results, self.description = dict(smoke or {}), results, description
        self.presets = {name: dict(choices) for name, choices in (presets or {}).items()}
        self.others = dict(others or {})
        if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
            raise ValueError(f"Case '{name}': use lower-case letters, digits and _ in the name")
        self._told = [] if results is None else _keywords(results)
        self._check_names()
        self._check_values("smoke", self.smoke)
        for key, choices in self.presets.items():
            for choice, values in choices.items():
                self._check_values("presets", {key: choice} | dict(values))

    def __repr__(self) -> str:
        """Name, analysis and own options, for interactive work."""
        names = ", ".join(option.name for option in self.options) or "no options of its own"
        return f"Case({self.name!r}, {self.analysis.name}: {names})"

    def _check_names(self) -> None:
        common = {option.name for option in self.analysis.settings.OPTIONS}
        for key in self.settings:
            if key not in common:
                raise TypeError(f"Case '{self.name}': {self.analysis.name} has no option '{key}'")
        for option in self.all_options():
            if option in self.analysis.settings.OPTIONS and option.default is None:
                raise ValueError(f"Case '{self.name}': give {option.name}")
        names = [option.name for option in self.options]
        for key in names:
            if key in _RESERVED | common or names.count(key) > 1:
                raise ValueError(f"Case '{self.name}': option name '{key}' is already in use")
        for key in self._told:
            if key not in names:
                raise ValueError(f"Case '{self.name}': results take an unknown option '{key}'")

    def _check_values(self, what: str, values: Mapping[str, Any]) -> None:
        known = {option.name: option for option in self.all_options()}
        for key, value in values.items():
            if key not in known:
                raise ValueError(f"Case '{self.name}': {what} names an unknown option '{key}'")
            try:
                known[key].check(value)
            except (TypeError, ValueError) as error:
                raise ValueError(f"Case '{self.name}': {what} value {key} {error}") from None

    @property
    def analyses(self) -> dict[str, Analysis]:
        """Analyses that the model may undergo: its own first."""
        every = (self.analysis, STATICS, MODES, RELAXATION, *self.others)
        return {one.name: one for one in every}

    def under(self, analysis: Analysis) -> "Case":
        """The same model under another analysis, all of whose options have defaults.

        Raises:
            ValueError: If an own option has the name of one of the analysis.
        """
        own = {option.name for option in self.options}
        presets = {
            name: {choice: _only(own, values) for choice, values in choices.items()}
            for name, choices in self.presets.items()
        }
        given = self.others.get(analysis, {})
        options = [
            replace(one, default=given[one.name]) if one.name in given else one
            for one in self.options
        ]
        case = Case(
            self.name, self.summary, self.build, options, analysis=analysis,
            smoke=_only(own, self.smoke), presets=presets, description=self.description,
            **{name: value for name, value in given.items() if name not in own},
        )  # fmt: skip
        case.folder = f"{self.name}_{analysis.name}"
        return case

    def all_options(self) -> tuple[Option, ...]:
        """The case's own options followed by those of its analysis with this case's defaults."""
        common = (
            replace(option, default=self.settings.get(option.name, option.default))
            for option in self.analysis.settings.OPTIONS
        )
        return (*self.options, *common)

    def values(self, given: Mapping[str, Any], *, smoke: bool = False) -> dict[str, Any]:
        """Defaults, with presets, with the smoke values on request, with the given values."""
        values = {option.name: option.default for option in self.all_options()}
        chosen = {**values, **(self.smoke if smoke else {}), **given}
        for key, choices in self.presets.items():
            values |= choices.get(chosen[key], {})
        return with_changed_components({**values, **(self.smoke if smoke else {}), **given})

    def prepare(
        self, given: Mapping[str, Any], *, smoke: bool = False, **more: Any
    ) -> tuple[dict[str, Any], Settings]:
        """Keyword arguments of ``build``, and the options of the analysis.

        Args:
            given: values of own options and of those of the analysis by name, also of components
                of vectors (``gravity[2]``); others have their defaults.
            smoke: with the values for a quick look.
            more: other fields of the settings, such as ``output``.

        Raises:
            TypeError: A value has the wrong type.
            ValueError: There is no such option, or a value is not admissible.
        """
        options = with_components(self.all_options())
        checked = {}
        for name, value in given.items():
            if name not in options:
                hint = meant(name, options) or f"known are {', '.join(options)}"
                raise ValueError(f"case '{self.name}': no option '{name}', {hint}")
            try:
                checked[name] = options[name].check(value)
            except (TypeError, ValueError) as error:
                raise type(error)(f"case '{self.name}': {name} {error}") from None
        values = self.values(checked, smoke=smoke)
        settings = self.analysis.settings
        numbers = {option.name: values[option.name] for option in settings.OPTIONS}
        parameters = {option.name: values[option.name] for option in self.options}
        return parameters, settings(**numbers, case_options=parameters, **more)

    def model(self, **given: Any) -> "Model":
        """Build the model and validate it; ranks do not agree on errors yet.

        Args:
            given: values of own options by name; others have their defaults.

        Raises:
            OSError: A file is not readable.
            TypeError, ValueError: A value or the model is not admissible.
        """
        from flexfem.model.model import Model

        parameters, _ = self.prepare(given)
        model = self.build(**parameters)
        if not isinstance(model, Model) and not hasattr(model, "drivers"):
            raise TypeError(f"case '{self.name}': build returned {model!r}, not a Model")
        model.validate()
        return model

    def run(
        self, *, output: Path | str | None = None, quiet: bool = True, **given: Any
    ) -> "Outcome":
        """Build the model and carry the analysis out (collective).

        Args:
            output: folder of the results; None writes nothing.
            quiet: show no progress; else as ``progress`` says, a bar on terminals by default.
            given: values of own options and of those of the analysis by name; also ``progress``,
                ``smoke`` and, where the analysis has them, ``restart`` and ``state``.

        Raises:
            TypeError: A value has the wrong type.
            ValueError: There is no such option, a value is not admissible, or the model is wrong.
        """
        _checks.instance(f"case '{self.name}'", "quiet", quiet, bool)
        more = {name: given.pop(name) for name in _UNTOLD if name in given}
        parameters, settings = self.prepare(given, output=output, quiet=quiet, **more)
        model = self.build(**parameters)
        results = self.results_with(parameters)
        outcome: Outcome = self.analysis.run(model, settings, case=self.name, results=results)
        return outcome

    def results_with(self, parameters: Mapping[str, Any]) -> Results | None:
        """Headline results from the history alone, with values of own options."""
        if self.results is None or not self._told:
            return self.results
        return partial(self.results, **{name: parameters[name] for name in self._told})

    def other_defaults(self, name: str) -> str:
        """Defaults of an option that come with values of others, for ``--help``."""
        return "".join(
            f"; {values[name]} with --{key.replace('_', '-')} {choice}"
            for key, choices in self.presets.items()
            for choice, values in choices.items()
            if name in values
        )


def _keywords(function: Callable[..., Any]) -> list[str]:
    """Names of the arguments of a function that are keywords only."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # of some functions in C it is not known
        return []
    return [one.name for one in parameters if one.kind is inspect.Parameter.KEYWORD_ONLY]


def _only(names: set[str], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of these names."""
    return {name: value for name, value in values.items() if name in names}


def load_case(name: str | Path) -> Case:
    """Load a shipped case by its name, or an own one by the path of its file.

    The file may import others of its folder, which are looked for behind Python's own modules and
    those that are installed.

    Raises:
        ValueError: There is no such case, or the file does not define one.
    """
    path = case_file(name)
    if _is_path(name) and str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # behind all else: no file there replaces a library
    try:
        case = getattr(load_module(path, "flexfem_case"), "CASE", None)
    except FAILURES as error:
        raise ValueError(f"case '{name}': {mistake(error)}") from error
    finally:
        if _is_path(name):
            _tell_of_namesakes(path)
    if not isinstance(case, Case):
        raise ValueError(f"case '{name}': the file does not define CASE = flexfem.Case(...)")
    return case


def _tell_of_namesakes(path: Path) -> None:
    """Say which files beside a case were not imported, though they have the names of imports."""
    for name, origin in imported_elsewhere(path):
        launch.say(
            f"warning: '{path}' imports {name} of {origin}, not the file beside it, which needs "
            "another name",
            error=True,
        )


def case_file(name: str | Path) -> Path:
    """The file of a case that is shipped, or named by its path.

    Raises:
        ValueError: No case of this name is shipped.
    """
    if _is_path(name):
        return Path(name).resolve()
    try:
        cases = shipped_files("cases")
    except FileNotFoundError as error:
        raise ValueError(str(error)) from error
    if name not in cases:
        hint = meant(str(name), cases) or f"known are {', '.join(cases)}"
        if Path(f"{name}.py").is_file():
            hint = f"did you mean the file {name}.py"
        raise ValueError(f"unknown case '{name}': {hint}")
    return cases[str(name)]


def _is_path(name: str | Path) -> bool:
    return Path(name).suffix == ".py" or os.sep in str(name)
