# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters: numbers on which a model depends, and what the equations depend on them.

A parameter acts on the start of a motion and on the equations of every step. Both are
differentiated by central differences between two models that differ in it alone: at a fixed state,
one step after the other, not between two motions. What is linear in a parameter is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.gradients.adjoint import Carried
from flexfem.gradients.node_maps import rotations
from flexfem.gradients.step_tangent import BlockVectors
from flexfem.gradients.trajectory import Motion, StoppedError
from flexfem.lie import se3, so3
from flexfem.model.model import Model
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.mechanics import END_POINT

__all__ = ["Influence", "build_of", "model_with", "values_at"]

#: Difference of a parameter, relative to it, or itself for one that is zero.
_STEP = 1e-5

#: A model of values by name.
Build = Callable[..., Model]


class Influence:
    """What one parameter changes: the start, and the equations at a fixed state.

    Attributes:
        start: derivatives of the start, for each block.
    """

    def __init__(
        self, motion: Motion, build: Build, values: Mapping[str, float], name: str,
        step: float | None = None,
    ) -> None:  # fmt: skip
        """Build both models (collective).

        Args:
            motion: the motion.
            build: a model of all values.
            values: of all parameters.
            name: of this one.
            step: difference; None for a part of the value.

        Raises:
            InputError: the model does not exist at one of the values, or has another layout there.
        """
        value = values[name]
        self._step = step or (_STEP * abs(value) if value else _STEP)
        self._motion, self._pair = motion, []
        for sign in (1.0, -1.0):
            model = build(**{**values, name: value + sign * self._step})
            one = Simulation(model, motion.options, motion.system.comm)
            if one.status is not Status.OK:
                raise StoppedError(f'gradient: the motion with another "{name}" did not start')
            self._check(one, name)
            self._pair.append(one)
        self.start = self._start()  # later the models are at other states

    def _check(self, one: Simulation, name: str) -> None:
        """Raise unless blocks and rows are those of the motion (collective)."""
        system, own = self._motion.system, one.system
        same = len(own.parts) == len(system.parts) and own.constraints.size == (
            system.constraints.size
        )
        same = same and all(
            np.array_equal(a.block.node_ids, b.block.node_ids) and a.block.width == b.block.width
            for a, b in zip(own.parts, system.parts, strict=True)
        )
        if not system.comm.allreduce(same, op=MPI.LAND):
            raise InputError(
                f'gradient: "{name}" changes the number of nodes or joints, and has no derivative'
            )

    def _start(self) -> list[Carried]:
        """Derivatives of the start, for each block."""
        found = []
        for k, part in enumerate(self._motion.system.parts):
            first = self._motion.state(0).rows[part.block.name]
            pair = [one.system.parts[k].block.state() for one in self._pair]
            own = np.s_[: part.block.owned, : part.block.width]
            moved = [
                _twists(first["frames"], state["frames"], inertial=part.block.inertial)
                for state in pair
            ]
            rates = [
                (pair[0][name] - pair[1][name])[own] / (2.0 * self._step)
                for name in ("velocity", "auxiliary", "acceleration")
            ]
            found.append(Carried((moved[0] - moved[1])[own] / (2.0 * self._step), *rates))
        return found

    def equations(self, step: int) -> tuple[BlockVectors, FloatArray]:
        """Derivatives of the equations of blocks and rows at the end of a step (collective).

        Args:
            step: number of the step, at whose trial state the system of the motion is.
        """
        values = [self._evaluated(one, step) for one in self._pair]
        blocks = [
            part.block.hold(a - b) / (2.0 * self._step)
            for part, a, b in zip(
                self._motion.system.parts, values[0][0], values[1][0], strict=True
            )
        ]
        return blocks, (values[0][1] - values[1][1]) / (2.0 * self._step)

    def _evaluated(self, one: Simulation, step: int) -> tuple[BlockVectors, FloatArray]:
        """Residuals of one of the models at the trial state of the motion."""
        motion, system = self._motion, one.system
        system.restore(motion.state(step - 1))
        system.set_time(motion.times[step])
        for part, other in zip(motion.system.parts, system.parts, strict=True):
            for name, values in part.block.trial().items():
                other.block.trial()[name][:] = values
        rows = system.constraints
        rows.multipliers[:] = motion.system.constraints.multipliers
        END_POINT.evaluate(system, motion.laws.shifts)
        return [part.block.owned_residual.copy() for part in system.parts], rows.values.copy()


def _twists(frames: FloatArray, moved: FloatArray, *, inertial: bool) -> FloatArray:
    """Local twists (n, 6) from frames to others (n, 12)."""
    if not inertial:
        return se3.log(se3.compose(se3.inverse(frames), moved))
    R = rotations(frames)
    turns = np.einsum("nji,njk->nik", R, rotations(moved))
    way = np.einsum("nji,nj->ni", R, moved[:, :3] - frames[:, :3])
    return np.concatenate([way, so3.log(turns)], axis=1)


def build_of(model: Model, names: list[str]) -> tuple[Build, dict[str, float]]:
    """Function that builds a model with other values of some of its numbers, and their values.

    Args:
        model: the model.
        names: paths into it, such as "body.mass", "spring.stiffness" or "rod.velocity[2]".

    Raises:
        ValueError: a path leads nowhere, or not to a number.
    """
    values = {name: _value(model, name) for name in names}
    return partial(model_with, model), values


def model_with(model: Model, **values: float) -> Model:
    """A model with other values at some paths, see :func:`build_of`."""
    changed: dict[str, Any] = {}
    gravity = model.gravity
    for path, value in values.items():
        first, steps = _parsed(path)
        if first == "gravity" and gravity is not None:
            gravity = _changed(gravity, _gravity(steps), value, path)
        else:
            changed[first] = _changed(changed.get(first, model[first]), steps, value, path)
    copy = Model(model.name, mesh=model.mesh, surface=model.surface)
    if gravity is not None:
        copy.add(gravity)
    for thing in model.things:
        copy.add(changed.get(thing.name, thing))
    copy.released = list(model.released)
    return copy


def values_at(values: Mapping[str, Any]) -> dict[str, float]:
    """Checked values of parameters.

    Raises:
        ValueError: there are none, or one is not finite.
    """
    if not values:
        raise ValueError("gradient: nothing to derive by, name parameters")
    return {name: _checks.number("gradient", name, value) for name, value in values.items()}


def _parsed(path: str) -> tuple[str, list[str | int]]:
    """Name of the object, and the way from it: attributes and indices."""
    steps: list[str | int] = []
    for part in path.split("."):
        name, *indices = part.replace("]", "").split("[")
        steps.append(name)
        for index in indices:
            if not index.isdecimal():
                raise ValueError(f'gradient: "{path}" must have whole numbers in brackets')
            steps.append(int(index))
    return str(steps[0]), steps[1:]


def _gravity(steps: list[str | int]) -> list[str | int]:
    """``gravity[2]`` for ``gravity.acceleration[2]``."""
    return steps if steps and isinstance(steps[0], str) else ["acceleration", *steps]


def _value(model: Model, path: str) -> float:
    """The number at a path."""
    first, steps = _parsed(path)
    if first == "gravity" and model.gravity is not None:
        found: Any = model.gravity
        steps = _gravity(steps)
    else:
        found = model[first]
    for step in steps:
        try:
            found = found[step] if isinstance(step, int) else getattr(found, step)
        except (AttributeError, IndexError, TypeError):
            raise ValueError(f'gradient: "{path}" leads nowhere at {_text(step)}') from None
    if isinstance(found, bool) or not isinstance(found, (int, float, np.floating)):
        raise ValueError(
            f'gradient: "{path}" is no real number, got {_checks.show(found)}; name a component '
            "of an array by [i]"
        )
    return float(found)


def _changed(thing: Any, steps: list[str | int], value: float, path: str) -> Any:
    """A copy of a thing, with all its checks, whose number at the end of a way is another."""
    if not steps:
        return value
    step, *rest = steps
    if isinstance(step, int):
        if isinstance(thing, np.ndarray) and thing.dtype.kind == "f":
            copy: FloatArray = thing.copy()
            copy[tuple(int(index) for index in steps)] = value
            return copy
        parts = list(thing)
        parts[step] = _changed(parts[step], rest, value, path)
        return tuple(parts)
    if (
        isinstance(thing, type)
        or not is_dataclass(thing)
        or step not in {one.name for one in fields(thing) if one.init}
    ):
        raise ValueError(f'gradient: "{path}": {type(thing).__name__} has no field {step}')
    try:
        return replace(thing, **{step: _changed(getattr(thing, step), rest, value, path)})
    except (TypeError, ValueError) as error:
        raise InputError(f'gradient: "{path}" cannot be changed: {error}') from error


def _text(step: str | int) -> str:
    return f"[{step}]" if isinstance(step, int) else step
