# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build the models of a study before any of them runs, in a process of its own.

Models may import what a study must not, MPI above all: ``python -m flexfem.studies.model_check``
reads the models to build from stdin and answers on stdout.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from flexfem.case import Case, load_case
from flexfem.launch import environment_of_runs
from flexfem.options import value_text

__all__ = ["check_models"]

#: Building ends after this time, s: what is wrong then shows in the runs.
_PATIENCE = 20.0
#: Analyses whose history has the columns of the probes alone.
_PLAIN = ("dynamics", "statics")


def check_models(
    identity: Mapping[str, Any], parameters: Sequence[Mapping[str, Any]], columns: Sequence[str]
) -> None:
    """Build and validate models, as many as 20 s allow.

    Args:
        identity: case, analysis, smoke and options, the same for all models.
        parameters: other options of each.
        columns: that the histories must have.

    Raises:
        ValueError: A model is wrong, or its history has no such column.
    """
    task = {"identity": identity, "parameters": parameters, "columns": columns}
    ended = subprocess.run(
        [sys.executable, "-P", "-m", __name__], input=json.dumps(task), env=environment_of_runs(),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if ended.returncode:
        told = ended.stderr.strip().splitlines() or [f"exit code {ended.returncode}"]
        raise ValueError(f"case '{identity['case']}': the model cannot be built: {told[-1]}")
    if message := json.loads(ended.stdout.splitlines()[-1]):
        raise ValueError(message)


def _first_mistake(task: Mapping[str, Any]) -> str:
    """Return the first mistake found in the models, empty if there is none."""
    identity, begin = task["identity"], time.monotonic()
    case = load_case(identity["case"])
    if identity["analysis"] != case.analysis.name:
        case = case.under(case.analyses[identity["analysis"]])
    for values in task["parameters"]:
        given = {**identity["options"], **values}
        try:
            _check(case, given, identity["smoke"], task["columns"])
        except (OSError, TypeError, ValueError) as error:
            told = " ".join(f"{name}={value_text(value)}" for name, value in values.items())
            return f"{told}: {error}"
        if time.monotonic() > begin + _PATIENCE:
            break
    return ""


def _check(case: Case, given: Mapping[str, Any], smoke: bool, columns: Sequence[str]) -> None:
    """Build one model.

    Raises:
        OSError, TypeError, ValueError: Something is wrong with it.
    """
    from flexfem.model.model import Model

    parameters, _ = case.prepare(given, smoke=smoke)
    model = case.model(**parameters)
    if isinstance(model, Model) and case.analysis.name in _PLAIN:
        known = ["t", *(column for probe in model.probes for column in probe.columns)]
        for column in columns:
            if column not in known:
                raise ValueError(f"no column '{column}', the history has {', '.join(known)}")


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):  # a case may print
        answer = _first_mistake(json.load(sys.stdin))
    print("\n" + json.dumps(answer))
