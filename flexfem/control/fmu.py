# SPDX-License-Identifier: LGPL-3.0-or-later
"""A functional mock-up unit (FMI 2 or 3, co-simulation) as a law."""

import hashlib
import shutil
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from os import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import numpy as np

from flexfem import _checks
from flexfem._files import open_file
from flexfem._memory import shown
from flexfem._types import FloatArray

__all__ = ["FmuLaw"]

#: Files in an archive, and bytes of all of them and of the description alone, once unpacked.
_MEMBERS, _UNPACKED, _DESCRIPTION = 100_000, 4e9, 64e6
#: Names of types of numbers in FMI 2 and 3.
_REAL = ("Real", "Float64")
_SETTABLE = ("parameter", "structuralParameter", "input")


@dataclass(eq=False)
class FmuLaw:
    """Law computed by an FMU, called once per sample.

    At the first sample the FMU is initialised there. At every other one it takes the measurements,
    steps from the last sample to this one with them, and its outputs are read: a controller thus
    responds to the measurements of this instant, and a subsystem with states has constant inputs
    between samples.

    The standard leaves it to the FMU whether its state can be saved, so that a checkpoint holds all
    measurements so far; a restart replays them.

    Attributes:
        owner: prefix of messages.
        file: the FMU.
        inputs, outputs: names of its variables, of type Real or Float64.
        parameters: start values of its parameters by name.
        checksum: of the file.
    """

    owner: str
    file: Path
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, Any]
    checksum: str = field(init=False)

    def __post_init__(self) -> None:
        """Check the file and its variables.

        Raises:
            ValueError: fmpy is not installed, the file cannot be read, is no FMU for co-simulation
                of FMI 2 or 3, or has no such variables.
            TypeError: a parameter is a number, its value is none.
        """
        description = self._read()
        known = {variable.name: variable for variable in description.modelVariables}
        wanted: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
            ("input", self.inputs, ("input",)),
            ("output", self.outputs, ("output", "local")),
            ("parameter", tuple(self.parameters), _SETTABLE),
        ]
        for what, names, causalities in wanted:
            for name in names:
                if name not in known:
                    have = [v.name for v in known.values() if v.causality in causalities]
                    raise ValueError(
                        f'{self.owner}: the FMU has no variable "{name}", its {what}s are '
                        f"{_checks.show(', '.join(have), 200)}"
                    )
                variable = known[name]
                if variable.causality not in causalities:
                    raise ValueError(
                        f'{self.owner}: variable "{name}" of the FMU is no {what} but '
                        f"{variable.causality}"
                    )
                array = variable.dimensions or variable.dimensionValueReferences
                if what != "parameter" and (variable.type not in _REAL or array):
                    raise ValueError(
                        f'{self.owner}: variable "{name}" of the FMU must be one number, got '
                        f"{variable.type}{' array' if array else ''}"
                    )
                if what == "parameter" and variable.type in _REAL and not array:
                    _checks.number(self.owner, f'parameter "{name}"', self.parameters[name])
        with open_file(f"{self.owner}: file '{self.file}' cannot be read", self.file) as archive:
            digest = partial(hashlib.blake2b, digest_size=8)
            self.checksum = hashlib.file_digest(archive, digest).hexdigest()
        self._fmu: Any = None
        self._references: tuple[list[int], list[int]] = ([], [])
        self._second = description.fmiVersion == "2.0"
        self._samples: list[FloatArray] = []

    def _read(self) -> Any:
        """The model description."""
        try:
            from fmpy import read_model_description
        except ImportError as error:
            raise ValueError(
                f"{self.owner}: FMUs need the package fmpy (pip install 'flexfem[fmi]'): {error}"
            ) from error
        with open_file(f"{self.owner}: file '{self.file}' cannot be read", self.file) as archive:
            _check_archive(f"{self.owner}: file '{self.file}'", archive)
        try:
            description = read_model_description(self.file, validate=False)
        except Exception as error:  # fmpy raises many kinds of errors
            text = " ".join(str(error).split())
            raise ValueError(f"{self.owner}: file '{self.file}' is no FMU: {text}") from error
        version = description.fmiVersion
        if not version.startswith(("2.", "3.")) or description.coSimulation is None:
            raise ValueError(
                f"{self.owner}: file '{self.file}' must be an FMU of FMI 2 or 3 for co-simulation, "
                f"got FMI {version}" + ("" if description.coSimulation else " without it")
            )
        return description

    @property
    def state(self) -> FloatArray:
        """(samples, 1 + inputs) times and measurements so far."""
        return np.array(self._samples).reshape(-1, 1 + len(self.inputs))

    @state.setter
    def state(self, samples: FloatArray) -> None:
        self._fmu, self._samples = None, []
        for row in samples:
            self.update(float(row[0]), row[1:])

    def update(self, t: float, y: FloatArray) -> FloatArray:
        """Take the measurements (inputs,) at a sample ``t`` (s); returns the outputs.

        Raises:
            RuntimeError: the FMU does not start, fails, or ends before the run does.
        """
        try:
            return self._updated(t, y)
        except (RuntimeError, ValueError):
            raise
        except Exception as error:  # fmpy raises many kinds
            text = " ".join(str(error).split())
            raise RuntimeError(f"the FMU fails at t = {t:.6g} s: {text}") from error

    def _updated(self, t: float, y: FloatArray) -> FloatArray:
        if self._fmu is None:
            self._start(t, y)
        else:
            last = float(self._samples[-1][0])
            self._set(y)
            self._step(last, t - last)
        self._samples.append(np.concatenate([[t], y]))
        get = self._fmu.getReal if self._second else self._fmu.getFloat64
        return np.array(get(self._references[1]), dtype=np.float64)

    def _set(self, y: FloatArray) -> None:
        if self.inputs:
            put = self._fmu.setReal if self._second else self._fmu.setFloat64
            put(self._references[0], y.tolist())

    def _step(self, start: float, size: float) -> None:
        ended = self._fmu.doStep(currentCommunicationPoint=start, communicationStepSize=size)
        if ended is not None and (ended[1] or ended[2]):  # FMI 3 says so, FMI 2 fails
            raise RuntimeError(f"the FMU ends within the step from t = {start:.6g} s")

    def _start(self, t: float, y: FloatArray) -> None:
        """Unpack, instantiate and initialise."""
        from fmpy import extract
        from fmpy.simulation import (
            apply_start_values,
            instantiate_fmu,
            settable_in_initialization_mode,
            settable_in_instantiated,
        )

        description = self._read()
        known = {v.name: v.valueReference for v in description.modelVariables}
        self._references = [known[n] for n in self.inputs], [known[n] for n in self.outputs]
        folder = extract(self.file)
        try:
            fmu = self._fmu = instantiate_fmu(
                folder, description, "CoSimulation", require_functions=False
            )
        except Exception:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        weakref.finalize(self, _free, fmu, folder)
        values = dict(self.parameters)
        if self._second:
            fmu.setupExperiment(startTime=t)
        values = apply_start_values(fmu, description, values, settable_in_instantiated)
        fmu.enterInitializationMode(**({} if self._second else {"startTime": t}))
        values = apply_start_values(fmu, description, values, settable_in_initialization_mode)
        if values:
            raise ValueError(f"parameter {next(iter(values))} of the FMU cannot be set")
        self._set(y)
        fmu.exitInitializationMode()


def _check_archive(owner: str, archive: BinaryIO) -> None:
    """Check the list of contents of an archive before it is unpacked.

    Raises:
        ValueError: it is none, or its contents are too large, overlap, or belong elsewhere.
    """
    size = archive.seek(0, SEEK_END)
    try:
        members = ZipFile(archive).infolist()
    except Exception as error:  # any error in it
        raise ValueError(f"{owner} is no FMU: {' '.join(str(error).split())}") from error
    unpacked = sum(member.file_size for member in members)
    if len(members) > _MEMBERS or unpacked > _UNPACKED:
        raise ValueError(
            f"{owner} is no FMU: it unpacks to {len(members)} files of {shown(unpacked)}, at most "
            f"{_MEMBERS} of {shown(_UNPACKED)} are unpacked"
        )
    if sum(member.compress_size for member in members) > size:
        raise ValueError(f"{owner} is no FMU: its files overlap")
    for member in members:
        if member.filename.startswith("/") or ".." in member.filename.split("/"):
            name = _checks.show(member.filename)
            raise ValueError(f"{owner} is no FMU: it would put {name} outside of its folder")
        if member.filename == "modelDescription.xml" and member.file_size > _DESCRIPTION:
            raise ValueError(
                f"{owner} is no FMU: its description has {shown(member.file_size)}, at most "
                f"{shown(_DESCRIPTION)} are read"
            )


def _free(fmu: Any, folder: Any) -> None:
    """End an instance and remove what was unpacked."""
    try:
        fmu.terminate()
        fmu.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
