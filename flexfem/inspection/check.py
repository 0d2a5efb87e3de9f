# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run the checks of a model: findings of admissible input that looks like a mistake."""

import importlib
import pkgutil
from collections.abc import Container

from flexfem._packages import without_collection
from flexfem.inspection import checks
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.model import Model
from flexfem.options import Settings

__all__ = ["check", "findings", "findings_of_run"]

#: Checks that a run makes more exactly by itself: it refuses violated joints and redundant ones,
#: and watches drives from step to step.
_OWN = ("drives", "gaps", "redundant")


def check(model: Model, options: Settings | None = None) -> list[Finding]:
    """Find probable mistakes in a model; certain ones raise when it is built.

    Args:
        model: the model.
        options: those of the analysis that it is for; None leaves out checks that concern one
            analysis only.

    Returns:
        The findings, each with its subject, description and advice.

    Raises:
        InputError: a mistake in the model (a ValueError).
        TypeError: it is no model, or these are no options.
    """
    return findings(Inspection(model, options))


def findings(inspection: Inspection, without: Container[str] = ()) -> list[Finding]:
    """Findings of all checks, the files of ``flexfem.inspection.checks``, but for some."""
    found: list[Finding] = []
    for module in pkgutil.iter_modules(checks.__path__):
        if module.name in without:
            continue
        look = importlib.import_module(f"{checks.__name__}.{module.name}").find
        found += look(inspection)
    return found


def findings_of_run(serial: NumberedModel, options: Settings) -> list[Finding]:
    """Findings of the checks that an analysis does not make by itself.

    Args:
        serial: serial data of its validated model.
        options: those of the analysis.
    """
    with without_collection():
        return findings(Inspection.of(serial, options), _OWN)
