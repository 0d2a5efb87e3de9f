# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of a motion: numbers, or arrays of numbers, of which its model is made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.model.model import Model
from flexfem.options import meant

__all__ = [
    "Build", "Values", "build_of", "build_with_options", "checked_values", "flat",
    "model_with", "named", "parameters", "plain", "refusing",
]  # fmt: skip

#: A model of values by name.
Build = Callable[..., Model]
#: Values of parameters by name: of arrays without axes, or with one.
Values = dict[str, FloatArray]


def parameters(
    model: Model | Build, wrt: Sequence[str] | Mapping[str, npt.ArrayLike]
) -> tuple[Build, Values]:
    """Function that builds the model, and the values of the parameters.

    Raises:
        TypeError: the model is none, and no function either, or a function has no values.
        ValueError: a name or a value is wrong.
    """
    if isinstance(model, Model):
        return build_of(model, list(wrt))
    if not callable(model):
        raise TypeError(
            f"gradient: give a Model or a function that builds one, got {_checks.show(model)}"
        )
    if not isinstance(wrt, Mapping):
        raise TypeError("gradient: with a function, wrt must be values by name")
    return model, checked_values(wrt)


def checked_values(values: Mapping[str, npt.ArrayLike]) -> Values:
    """Checked values of parameters.

    Raises:
        ValueError: there are none, or one is not finite, or has more than one axis.
    """
    if not values:
        raise ValueError("gradient: nothing to derive by, name parameters")
    found = {}
    for name, value in values.items():
        axes = np.ndim(value)
        if axes > 1:
            raise ValueError(f"gradient: {name} must be a number or have one axis, got {axes}")
        shape = (-1,) if axes else ()
        found[name] = _checks.array("gradient", name, value, shape)
    return found


def plain(values: Values) -> dict[str, float | FloatArray]:
    """Numbers for arrays without axes."""
    return {name: value if value.ndim else float(value) for name, value in values.items()}


@contextmanager
def refusing(name: str) -> Iterator[None]:
    """Say which parameter has changed where a model is refused.

    Raises:
        InputError: naming it.
    """
    try:
        yield
    except ValueError as error:
        raise InputError(
            f'gradient: the model with a slightly different "{name}" is refused: {error}'
        ) from error


def named(like: Values, flat: FloatArray) -> Values:
    """Values by name of all numbers (n,), of the shapes and in the order of others."""
    ends = np.cumsum([value.size for value in like.values()])
    parts = np.split(flat, ends[:-1])
    return {
        name: part.reshape(value.shape)
        for (name, value), part in zip(like.items(), parts, strict=True)
    }


def flat(like: Values, given: Mapping[str, npt.ArrayLike]) -> FloatArray:
    """All numbers (n,) of values by name, in the order of others; the inverse of :func:`named`."""
    return np.concatenate(
        [np.broadcast_to(given[name], value.shape).ravel() for name, value in like.items()]
    )


def build_of(model: Model, names: list[str]) -> tuple[Build, Values]:
    """Function that builds a model with other values of some of its numbers, and their values.

    Args:
        model: the model.
        names: paths into it, such as "body.mass", "spring.stiffness" or "rod.velocity[2]".

    Raises:
        ValueError: a path leads nowhere, or not to a number.
    """
    return partial(model_with, model), checked_values({name: _value(model, name) for name in names})


def build_with_options(
    build: Build, given: Mapping[str, Any], names: Sequence[str]
) -> tuple[Build, Values]:
    """The same for the function that builds a case's model from its options.

    Args:
        build: the function.
        given: values of all options.
        names: options that are real numbers, components of vectors ("gravity[2]"), or paths into
            the model.

    Raises:
        ValueError: a name is none of them.
    """
    own = [name for name in names if _parsed(name)[0] in given]
    inside = [name for name in names if name not in own]
    for name in inside:
        if "." not in name and _parsed(name)[0] != "gravity":
            hint = meant(name, given) or f"options are {_checks.show(', '.join(given), 200)}"
            raise ValueError(
                f'gradient: "{name}" is no option, and no path into the model either, {hint}'
            )
    values = {name: _number(name, _at(given, name)) for name in own}
    if inside:
        model = build(**given)
        values |= {name: _value(model, name) for name in inside}

    def made(**changed: npt.ArrayLike) -> Model:
        options = dict(given)
        for name in own:
            first, steps = _parsed(name)
            options[first] = _changed(options[first], steps, float(np.asarray(changed[name])), name)
        model = build(**options)
        if not inside:
            return model
        return model_with(model, **{name: changed[name] for name in inside})

    return made, checked_values({name: values[name] for name in names})


def model_with(model: Model, **values: npt.ArrayLike) -> Model:
    """A model with other values at some paths, see :func:`build_of`."""
    changed: dict[str, Any] = {}
    gravity = model.gravity
    for path, value in values.items():
        first, steps = _parsed(path)
        number = float(np.asarray(value))
        if first == "gravity" and gravity is not None:
            gravity = _changed(gravity, _gravity(steps), number, path)
        else:
            changed[first] = _changed(changed.get(first, model[first]), steps, number, path)
    copy = Model(model.name, mesh=model.mesh, surface=model.surface)
    if gravity is not None:
        copy.add(gravity)
    for thing in model.things:
        copy.add(changed.get(thing.name, thing))
    copy.released = list(model.released)
    return copy


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
    return _number(path, _followed(found, steps, path))


def _at(given: Mapping[str, Any], path: str) -> Any:
    """The option at a path."""
    first, steps = _parsed(path)
    return _followed(given[first], steps, path)


def _followed(found: Any, steps: list[str | int], path: str) -> Any:
    """What is at the end of a way from a thing."""
    for step in steps:
        try:
            found = found[step] if isinstance(step, int) else getattr(found, step)
        except (AttributeError, IndexError, TypeError):
            where = f"[{step}]" if isinstance(step, int) else step
            raise ValueError(f'gradient: "{path}" leads nowhere at {where}') from None
    return found


def _number(path: str, found: Any) -> float:
    """A real number at a path; whole ones are discrete."""
    if not isinstance(found, (float, np.floating)):
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
    if not is_dataclass(thing) or step not in {one.name for one in fields(thing) if one.init}:
        raise ValueError(f'gradient: "{path}": {type(thing).__name__} has no field {step}')
    part: Any = thing
    try:
        return replace(part, **{step: _changed(getattr(thing, step), rest, value, path)})
    except (TypeError, ValueError) as error:
        raise InputError(f'gradient: "{path}" cannot be changed: {error}') from error
