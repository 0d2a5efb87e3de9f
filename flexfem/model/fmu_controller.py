# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers and subsystems that come as functional mock-up units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexfem import _checks
from flexfem.control.fmu import FmuLaw
from flexfem.model.controller import Controller

__all__ = ["FmuController"]


class FmuController(Controller):
    """Feedback through an FMU (FMI 2 or 3, co-simulation); needs the package fmpy.

    See :class:`Controller` for inputs and outputs, and ``flexfem.control.fmu`` for the data
    exchanged with the FMU.
    """

    def __init__(
        self,
        name: str,
        file: str | Path,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        sample_time: float | None = None,
        *,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        """Create a controller.

        Args:
            name: unique name in the model.
            file: the FMU.
            inputs: column of a probe by the FMU's input.
            outputs: name of the actuator or load by the FMU's output.
            sample_time: size of its communication steps, s; None for every time step.
            parameters: values of the FMU's parameters by name.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: the file is no such FMU, it has no such variables, or fmpy is missing.
        """
        owner = _checks.named(self, name)
        for what, names in (("inputs", inputs), ("outputs", outputs), ("parameters", parameters)):
            if names is not None:
                _checks.instance(owner, what, names, Mapping)
        _checks.instance(owner, "file", file, (str, Path))
        law = FmuLaw(owner, Path(file), tuple(inputs), tuple(outputs), dict(parameters or {}))
        super().__init__(name, tuple(inputs.values()), tuple(outputs.values()), law, sample_time)
