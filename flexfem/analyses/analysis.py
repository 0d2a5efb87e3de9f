# SPDX-License-Identifier: LGPL-3.0-or-later
"""An analysis: its options, and the driver that carries it out."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from flexfem._checks import InputError
from flexfem._packages import without_collection
from flexfem.options import FieldsOption, Settings, option, setting

__all__ = [
    "Analysis",
    "fields",
    "fields_precision",
    "history_format",
    "kernels",
    "linear_solver",
    "linear_tolerance",
    "restart",
    "split_above",
]


def kernels() -> Any:
    """Declare the option of all analyses for the assembly of shells."""
    return option(
        "assemble shells by hand-written kernels (fast) or from their UFL forms (ufl); everything "
        "else that has a strain comes from UFL forms in any case",
        default="fast",
        choices=("fast", "ufl"),
        note="The results are the same.",
    )


def fields() -> Any:
    """Declare the option of all analyses with a history for what series for ParaView hold."""
    return option(
        "fields in the ParaView files: all, none, or names A,B",
        default="all",
        kind=FieldsOption,
        note="Positions are always there, and what pages of ``flexfem view`` need to draw bodies. "
        "The swept surfaces of beams, the largest part of most results, are written for ``all``, "
        "for ``beam_surfaces`` and for a stress on them; pages sweep the sections themselves, and "
        "have these stresses from ``resultant``.",
    )


def fields_precision() -> Any:
    """Declare the option of all analyses with a history for numbers in series for ParaView."""
    return option(
        "numbers in the ParaView files: positions double and fields single (mixed), or all alike",
        default="mixed",
        choices=("mixed", "single", "double"),
        note="Single precision rounds to 6e-8 of a value.",
    )


def history_format() -> Any:
    """Declare the option of all analyses with a history for its file."""
    return option(
        "history.csv (csv), or history.h5, compressed, for thousands of columns (hdf5)",
        default="csv",
        choices=("csv", "hdf5"),
        note="A run that writes the latter holds some rows in memory, and not all.",
    )


def split_above() -> Any:
    """Declare the option of all analyses for the division of large bodies."""
    return option(
        "a beam, shell or solid with more elements than this, and more work than a rank's "
        "share, is split over ranks",
        default=4000,
        minimum=1,
    )


def linear_solver() -> Any:
    """Declare the option of analyses for the linear equations of large bodies."""
    return option(
        "solve solids by factors (direct), or by Krylov methods with multigrid (iterative): auto "
        "does so from 300,000 unknowns of a body; all other bodies have factors in any case",
        default="auto",
        choices=("auto", "direct", "iterative"),
        note="Conjugate gradients or GMRES with smoothed aggregation, whose hierarchy is kept over "
        "steps as factors are. Masses of solids from 20,000 unknowns are solved by conjugate "
        "gradients in any case.",
    )


def linear_tolerance() -> Any:
    """Declare the option for the accuracy of iterative solves."""
    return option(
        "relative accuracy of iterative linear solves",
        default=1e-8,
        above=0,
        maximum=1e-4,
        note="It is that of each correction of a step, and not of the step: corrections follow "
        "until they are below ``tolerance``.",
    )


def restart(more: str = "; --t-end may be later") -> Any:
    """Declare the checkpoint that runs resume from."""
    return setting(f"checkpoint to go on from, on any number of ranks{more}", default=None)


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis.

    Attributes:
        name: its name.
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
        return self.loaded(model)(model, settings, **keywords)

    def loaded(self, model: Any) -> Callable[..., Any]:
        """The driver for a model, with all that it imports.

        Raises:
            InputError: the model has no such analysis.
        """
        drivers = getattr(model, "drivers", {self.name: self.driver})
        if self.name not in drivers:
            raise InputError(f"{model!r}: there is no analysis '{self.name}' of it")
        module, function = drivers[self.name].split(":")
        with without_collection():
            found: Callable[..., Any] = getattr(import_module(module), function)
        return found
