# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of a motion: numbers, or arrays of numbers, of which its model is made."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.families.solid.body import Solid
from flexfem.families.solid.meshes.mesh import SolidMesh
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.model import Model
from flexfem.options import meant

__all__ = [
    "Build", "NodePath", "Values", "along", "build_of", "build_with_options", "check_names",
    "check_once", "checked_values", "flat", "flattened", "limits_of", "model_with", "named",
    "parameters", "plain", "refusing", "scales", "sides_of",
]  # fmt: skip

#: A model of values by name.
Build = Callable[..., Model]
#: Values of parameters by name: of arrays without axes, with one, or with two.
Values = dict[str, FloatArray]
#: A path to the nodes of a group.
_NODES = re.compile(r"(?:(?P<body>.+)\.)?(?P<mesh>mesh|surface)\.nodes\[(?P<group>.+)\]")


@dataclass(frozen=True)
class NodePath:
    """Nodes of a group of a mesh, such as ``mesh.nodes[tip]`` or ``bracket.mesh.nodes[notch]``.

    Attributes:
        path: as it was given.
        body: name of the solid whose mesh it is, None for the model's.
        surface: True for the mesh of shells of the model, False for that of lines.
        group: name of the group.
    """

    path: str
    body: str | None
    surface: bool
    group: str

    @classmethod
    def of(cls, path: str) -> NodePath | None:
        """What a path names, None if it is a path to a number."""
        found = _NODES.fullmatch(path)
        if found is None:
            return None
        return cls(path, found["body"], found["mesh"] == "surface", found["group"])

    def mesh(self, model: Model) -> SolidMesh | SurfaceMesh | LineMesh:
        """Its mesh in a model.

        Raises:
            ValueError: There is none.
        """
        if self.body is None:
            mesh = model.surface if self.surface else model.mesh
            if mesh is not None:
                return mesh
            what = "shells" if self.surface else "lines"
            raise ValueError(f'gradient: "{self.path}": {model!r} has no mesh of {what}')
        body = model[self.body]
        if self.surface or not isinstance(body, Solid):
            raise ValueError(
                f'gradient: "{self.path}": {type(body).__name__} "{self.body}" has no mesh of its '
                "own; paths to nodes are SOLID.mesh.nodes[…], mesh.nodes[…] and surface.nodes[…]"
            )
        return body.mesh  # type: ignore[no-any-return]

    def nodes(self, model: Model) -> IntArray:
        """Numbers (n,) of the nodes in the mesh, ascending.

        Raises:
            ValueError: There is no such group.
        """
        return self.mesh(model).named_nodes(f'gradient: "{self.path}"', self.group)

    def places(self, model: Model) -> FloatArray:
        """Where the nodes are in a model, (n, 3), m."""
        found: FloatArray = self.mesh(model).points[self.nodes(model)]
        return found

    def with_places(self, model: Model, places: FloatArray) -> Model:
        """A model with these nodes at other places (n, 3), m.

        Raises:
            ValueError: cells are inside out there, or the body is not possible with them.
        """
        mesh, body = self.mesh(model), self.body
        points = mesh.points.copy()
        points[self.nodes(model)] = places
        moved: Any = mesh.moved(points)
        changed = {} if body is None else {body: replace(model[body], mesh=moved)}
        meshes = model.mesh, model.surface
        if body is None:
            meshes = (model.mesh, moved) if self.surface else (moved, model.surface)
        return _copy(model, changed, model.gravity, meshes)


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
        ValueError: there are none, or one is not finite, or has more than two axes.
    """
    if not values:
        raise ValueError("gradient: nothing to derive by, name parameters")
    found = {}
    for name, value in values.items():
        axes = np.ndim(value)
        if axes > 2:
            raise ValueError(f"gradient: {name} must have two axes at most, got {axes}")
        shape = (-1, *np.shape(value)[1:]) if axes else ()
        found[name] = _checks.array("gradient", name, value, shape)
    return found


def check_build(owner: str, build: object, values: Values) -> None:
    """Check the function that builds the model of the values.

    Raises:
        TypeError: it is none.
        ValueError: it takes other names; one whose arguments are unknown is let through.
    """
    from inspect import signature  # costs time where no function is checked

    check_function(owner, "build", build)
    assert callable(build)
    try:
        taken = signature(build)
    except (TypeError, ValueError):  # written in C
        return
    try:
        taken.bind(**values)
    except TypeError:
        names = list(taken.parameters) or ["nothing"]
        raise ValueError(
            f"{owner}: start names {', '.join(values)}, but build takes {', '.join(names)}"
        ) from None


def check_function(owner: str, what: str, value: object) -> None:
    """Check that something can be called.

    Raises:
        TypeError: it cannot.
    """
    if not callable(value):
        raise TypeError(f"{owner}: {what} must be a function, got {_checks.show(value)}")


def flattened(build: Build, values: Values) -> tuple[Build, Values]:
    """The same function and values, whose arrays have one axis at most."""
    shapes = {name: value.shape for name, value in values.items() if value.ndim > 1}
    if not shapes:
        return build, values

    def made(**given: npt.ArrayLike) -> Model:
        shaped = {name: np.reshape(given[name], shape) for name, shape in shapes.items()}
        return build(**{**given, **shaped})

    return made, {
        name: value.reshape(-1) if value.ndim else value for name, value in values.items()
    }


def along(
    build: Build, values: Values, name: str, change: FloatArray
) -> tuple[Build, Values, float]:
    """The same function and values with one number for an array with two axes, as places of nodes.

    Args:
        build: the function.
        values: of all parameters.
        name: of the array.
        change: of the array, not zero.

    Returns:
        The function, its values, and the change of the number by which the array has this one.
    """
    given, size = values[name], float(np.abs(change).max())
    span = float(np.ptp(given, axis=0).max()) or 1.0

    def made(**numbers: npt.ArrayLike) -> Model:
        by = (float(np.asarray(numbers[name])) - 1.0) * span / size
        return build(**{**numbers, name: given + by * change})

    return made, {**values, name: np.array(1.0)}, size / span


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


def check_names(analysis: str, what: str, values: Values, given: Iterable[str]) -> None:
    """Raise ValueError unless all names given are those of parameters."""
    for name in given:
        if name not in values:
            raise ValueError(f'{analysis}: {what} names "{name}", which is no parameter')


def check_once(names: Sequence[str]) -> None:
    """Raise ValueError where a name of a number or of a parameter is there again."""
    for k, name in enumerate(names):
        if name in names[:k]:
            raise ValueError(f'gradient: "{name}" is given twice')


def _check_apart(model: Model, paths: Iterable[str]) -> None:
    """Refuse paths to the same numbers: values of one would undo changes of the other.

    Raises:
        ValueError: a path leads to what another one leads to.
    """
    seen: dict[Hashable, str] = {}
    for path in paths:
        for one in _targets(model, path):
            if (other := seen.setdefault(one, path)) != path:
                raise ValueError(
                    f'gradient: "{other}" and "{path}" name the same; leave one of them out'
                )


def _targets(model: Model, path: str) -> list[Hashable]:
    """What a path leads to: a number, or nodes."""
    if nodes := NodePath.of(path):
        return [(nodes.body, nodes.surface, int(node)) for node in nodes.nodes(model)]
    first, steps = _parsed(path)
    return [(first, *(_gravity(steps) if first == "gravity" else steps))]


def scales(analysis: str, values: Values, given: Mapping[str, npt.ArrayLike]) -> Values:
    """Changes of parameters that are alike, of their shapes: their sizes by default, 1 of zeros.

    Raises:
        ValueError: a name is no parameter, or a scale is not positive.
    """
    check_names(analysis, "scale", values, given)
    found = {}
    for name, value in values.items():
        own = np.asarray(given.get(name, np.where(value == 0.0, 1.0, np.abs(value))), dtype=float)
        if not (own > 0.0).all() or not np.isfinite(own).all():
            raise ValueError(
                f"{analysis}: scale of {name} must be positive, got {_checks.show(own)}"
            )
        found[name] = np.broadcast_to(own, value.shape).copy()
    return found


def sides_of(what: str, given: tuple[float | None, float | None]) -> tuple[float, float]:
    """Least and largest value, infinite for None.

    Raises:
        ValueError: they are no two numbers, or nothing lies between.
    """
    with suppress(TypeError, ValueError):
        low, high = (
            none if side is None else float(side)
            for side, none in zip(given, (-np.inf, np.inf), strict=True)
        )
        if low <= high:
            return low, high
    raise ValueError(
        f"{what} must be a least and a largest number, None for none, got {_checks.show(given)}"
    )


def limits_of(
    analysis: str, values: Values, given: Mapping[str, tuple[float | None, float | None]]
) -> Values:
    """Least and largest value (2,) of each parameter.

    Raises:
        ValueError: a name is no parameter, bounds are none, or a value is outside at the start.
    """
    check_names(analysis, "bounds", values, given)
    found = {}
    for name, value in values.items():
        low, high = sides_of(f"{analysis}: bounds of {name}", given.get(name, (None, None)))
        if not ((low <= value) & (value <= high)).all():
            raise ValueError(
                f"{analysis}: {name} must lie within its bounds at the start, got "
                f"{_checks.show(value)}"
            )
        found[name] = np.array([low, high])
    return found


def build_of(model: Model, names: list[str]) -> tuple[Build, Values]:
    """Function that builds a model with other values of some of its numbers, and their values.

    Args:
        model: the model.
        names: paths into it, such as "body.mass", "spring.stiffness" or "rod.velocity[2]", or to
            nodes, see :class:`NodePath`, whose values are their places (n, 3), m.

    Raises:
        ValueError: a path leads nowhere, or not to a number.
    """
    check_once(names)
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
    check_once(names)
    own = [name for name in names if not NodePath.of(name) and _parsed(name)[0] in given]
    inside = [name for name in names if name not in own]
    for name in inside:
        if "." not in name and _parsed(name)[0] != "gravity":
            hint = meant(name, given) or f"options are {_checks.show(', '.join(given), 200)}"
            raise ValueError(
                f'gradient: "{name}" is no option, and no path into the model either, {hint}'
            )
    values: dict[str, npt.ArrayLike] = {name: _number(name, _at(given, name)) for name in own}
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
    """A model with other values at some paths, see :func:`build_of`.

    Raises:
        ValueError: two of them lead to the same.
    """
    _check_apart(model, values)
    numbers = dict(values)
    for path in values:
        if nodes := NodePath.of(path):
            model = nodes.with_places(model, np.asarray(numbers.pop(path), dtype=np.float64))
    changed: dict[str, Any] = {}
    gravity = model.gravity
    for path, value in numbers.items():
        first, steps = _parsed(path)
        number = float(np.asarray(value))
        if first == "gravity" and gravity is not None:
            gravity = _changed(gravity, _gravity(steps), number, path)
        else:
            changed[first] = _changed(changed.get(first, model[first]), steps, number, path)
    return _copy(model, changed, gravity, (model.mesh, model.surface))


def _copy(
    model: Model, changed: Mapping[str, Any], gravity: Any,
    meshes: tuple[LineMesh | None, SurfaceMesh | None],
) -> Model:  # fmt: skip
    """A model with other things of some names, gravity and meshes."""
    copy = Model(model.name, mesh=meshes[0], surface=meshes[1])
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


def _value(model: Model, path: str) -> float | FloatArray:
    """The number at a path, or places (n, 3) of nodes."""
    if nodes := NodePath.of(path):
        return nodes.places(model)
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
