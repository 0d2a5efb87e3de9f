# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinds of analysis a case can ask for: their options, and the driver that carries them out."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from flexfem.options import CampbellOptions, ModeOptions, RunOptions, Settings
from flexfem.static_options import StaticOptions

__all__ = ["CAMPBELL", "DYNAMICS", "MODES", "STATICS", "Analysis"]


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis.

    Attributes:
        name: what it is called.
        settings: class of its options.
        driver: "module:function", imported when a run starts; called with the model, the settings
            and the keywords ``case`` and ``results``, it returns an Outcome.
    """

    name: str
    settings: type[Settings]
    driver: str

    def run(self, model: Any, settings: Settings, **keywords: Any) -> Any:
        """Carry it out (collective)."""
        module, function = self.driver.split(":")
        return getattr(import_module(module), function)(model, settings, **keywords)


DYNAMICS = Analysis("dynamics", RunOptions, "flexfem.simulation.dynamics:simulate")
MODES = Analysis("modes", ModeOptions, "flexfem.simulation.modes:find_modes")
CAMPBELL = Analysis("campbell", CampbellOptions, "flexfem.simulation.campbell:sweep_spin")
STATICS = Analysis("statics", StaticOptions, "flexfem.simulation.statics:solve_static")
