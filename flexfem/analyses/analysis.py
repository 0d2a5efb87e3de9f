# SPDX-License-Identifier: LGPL-3.0-or-later
"""An analysis: its options, and the driver that carries it out."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from flexfem._checks import InputError
from flexfem.options import Option, Settings

__all__ = ["KERNELS", "SPLIT_ABOVE", "Analysis"]

#: What every analysis has among its options.
KERNELS = Option(
    "kernels",
    str,
    "fast",
    "assemble shells by hand-written loops (fast) or from their UFL forms (ufl); everything else "
    "that has a strain comes from UFL forms in any case",
    choices=("fast", "ufl"),
)
SPLIT_ABOVE = Option(
    "split_above",
    int,
    4000,
    "a beam with more elements than this and than a rank's share is split over ranks",
    minimum=1,
)


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis.

    Attributes:
        name: what it is called.
        settings: class of its options.
        driver: "module:function", imported when a run starts; called with the model, the settings
            and the keywords ``case`` and ``results``, it returns an Outcome. What a case builds may
            be no multibody model but have equations of its own: then its attribute ``drivers``
            gives another driver by the name of the analysis.
    """

    name: str
    settings: type[Settings]
    driver: str

    def run(self, model: Any, settings: Settings, **keywords: Any) -> Any:
        """Carry it out (collective).

        Raises:
            InputError: the model has no such analysis.
        """
        drivers = getattr(model, "drivers", {self.name: self.driver})
        if self.name not in drivers:
            raise InputError(f"{model!r}: there is no analysis '{self.name}' of it")
        module, function = drivers[self.name].split(":")
        return getattr(import_module(module), function)(model, settings, **keywords)
