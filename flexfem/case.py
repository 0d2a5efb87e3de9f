# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declaration of a case: a named model with options, time span and headline results."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flexfem.options import RUN_DEFAULTS, RUN_NAMES, RUN_OPTIONS, Option

if TYPE_CHECKING:
    from flexfem.model.model import Model

History = Mapping[str, npt.NDArray[np.float64]]

_RESERVED = RUN_NAMES | {"smoke", "help", "restart", "checkpoint_every"}


@dataclass(frozen=True)
class Case:
    """A runnable case.

    Args:
        name: Short name, also of the default output folder ``results/<name>``.
        summary: One line for ``flexfem list``.
        build: Called with one keyword argument per option, returns the model.
        options: The case's own options.
        dt: Default time step, s.
        t_end: Default end of the simulated time, s.
        rho_inf: Default spectral radius of the integrator at infinite frequency.
        iteration_matrix: Default of ``--iteration-matrix``.
        tolerance: Default relative tolerance of the Newton iteration.
        every: Default number of steps between two field outputs.
        smoke: Values ``--smoke`` sets: names of own options or of dt, t_end, every, ….
        results: Headline results from the history (column name -> values over all steps).
        description: Longer text for ``--help``, usually the case file's ``__doc__``.

    Raises:
        ValueError: If a name is unusable or used twice, or a value is not admissible.
    """

    name: str
    summary: str
    build: Callable[..., "Model"]
    options: tuple[Option, ...] = ()
    dt: float = 1e-3
    t_end: float = 1.0
    rho_inf: float = RUN_DEFAULTS["rho_inf"]
    iteration_matrix: str = RUN_DEFAULTS["iteration_matrix"]
    tolerance: float = RUN_DEFAULTS["tolerance"]
    every: int = RUN_DEFAULTS["every"]
    split_above: int = RUN_DEFAULTS["split_above"]
    smoke: Mapping[str, Any] = field(default_factory=dict)
    results: Callable[[History], Mapping[str, float]] | None = None
    description: str = ""

    def __post_init__(self) -> None:
        """Check names and defaults where the case is declared, not when it is run."""
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.name):
            raise ValueError(
                f"Case '{self.name}': use lower-case letters, digits and _ in the name"
            )
        names = [option.name for option in self.options]
        for name in names:
            if name in _RESERVED or names.count(name) > 1:
                raise ValueError(f"Case '{self.name}': option name '{name}' is already in use")
        known = {option.name: option for option in self.all_options()}
        for name, value in self.smoke.items():
            if name not in known:
                raise ValueError(f"Case '{self.name}': smoke names an unknown option '{name}'")
            try:
                known[name].check(value)
            except (TypeError, ValueError) as error:
                raise ValueError(f"Case '{self.name}': smoke value {name} {error}") from None

    def all_options(self) -> tuple[Option, ...]:
        """The case's own options followed by the common ones with this case's defaults."""
        common = (replace(option, default=getattr(self, option.name)) for option in RUN_OPTIONS)
        return (*self.options, *common)

    def values(self, given: Mapping[str, Any], *, smoke: bool = False) -> dict[str, Any]:
        """Defaults, replaced by the smoke values when asked, replaced by what was given."""
        defaults = {option.name: option.default for option in self.all_options()}
        return {**defaults, **(self.smoke if smoke else {}), **given}
