# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fingerprints (hashes) of a model, to compare it with a checkpoint and between ranks.

They depend on names, types and numbers of the whole model, with numbers to nine digits, so that the
last digits of another machine do not matter. The values of a function are not known. For a
checkpoint two models that differ only in plain functions (a drive, an amplitude that is not a
``Table`` or ``SmoothStep``) count as equal; between ranks of one run functions are compared by
their code, by enclosed values, and by the numbers of their module or object that they use.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from functools import cached_property, partial
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from flexfem.core.marker import Marker
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.controller import Controller
from flexfem.model.probes.base import AnyProbe

__all__ = ["checksum", "fingerprint", "fingerprints"]

#: Resolution of numbers, as a part of a power of two above the largest of their array.
_STEP = 2.0**-30
#: Mantissa at which the power of two of the largest number changes, not 1, where last digits would
#: matter.
_BORDER = 1.37
#: Numbers of an array up to which those of many objects are put into one.
_SMALL = 64


def fingerprint(serial: NumberedModel) -> dict[str, str]:
    """Checksum of every kind of object in a model, equal on all ranks."""
    model = serial.model
    parts: dict[str, Any] = {
        "beams": model.beams,
        "contacts": model.contacts,
        "controllers": [
            (c.name, c.inputs, c.outputs, c.sample_time, c.law) for c in model.controllers
        ],
        "other bodies": model.other_bodies,
        "events": (model.events, model.released),
        "floating bodies": [_floating(body) for body in model.floating_bodies],
        "gravity": model.gravity,
        "joints": model.joints,
        "loads": model.loads,
        "mesh": _layout(serial, "mesh"),
        "modal dampings": model.modal_dampings,
        "point masses": model.point_masses,
        "probes": [(probe.name, probe.columns) for probe in model.probes],
        "rigid bodies": model.rigid_bodies,
        "shells": model.shells,
        "surface": _layout(serial, "surface"),
    }
    return {name: _Digest(serial).of(part) for name, part in parts.items()}


def checksum(serial: NumberedModel) -> str:
    """One checksum of all of :func:`fingerprints`, without theirs: for many objects, by arrays.

    Models that differ have different ones. Equal models have equal ones if the same of their
    objects are one and the same.
    """
    return _Digest(serial, {}).of_many([thing for named in _named(serial) for thing in named])


def fingerprints(serial: NumberedModel) -> list[tuple[str, str]]:
    """All objects of a model with their checksums, functions included, in the model's order."""
    known: _Known = {}
    return [(words, _Digest(serial, known).of(thing)) for words, thing in _named(serial)]


def _named(serial: NumberedModel) -> Iterator[tuple[str, Any]]:
    """The objects in a model by class and name, and its meshes."""
    model = serial.model
    yield "Gravity", model.gravity
    lists: Iterable[Iterable[Any]] = (
        model.beams, model.shells, model.rigid_bodies, model.floating_bodies,
        model.other_bodies, model.point_masses,
        model.joints, model.loads, model.contacts, model.events, model.controllers, model.probes,
        model.modal_dampings,
    )  # fmt: skip
    for things in lists:
        for thing in things:
            yield f'{type(thing).__name__} "{thing.name}"', _numbers_of(thing)
    yield "the list of released joints", model.released
    yield "the mesh of its beams", _layout(serial, "mesh")
    yield "the mesh of its shells", _layout(serial, "surface")


def _numbers_of(thing: Any) -> Any:
    """Return the data that ranks must share; sampled laws are called on the first rank alone."""
    if isinstance(thing, FloatingBody):
        data = thing.reduced
        return (*_floating(thing), data.stiffness, data.products)
    if isinstance(thing, Controller):
        law = type(thing.law).__name__ if thing.sampled else thing.law
        return thing.inputs, thing.outputs, thing.sample_time, law
    if isinstance(thing, AnyProbe):
        return thing.columns
    return thing


def _floating(body: FloatingBody) -> tuple[Any, ...]:
    """Return the data of a floating-frame body that its motion depends on, without pictures."""
    data = body.reduced
    return (
        body.name, body.frame, body.stiffening, data.interfaces, data.mass, data.moments,
        np.abs(data.stiffness), body.position, body.rotation, body.velocity, body.angular_velocity,
    )  # fmt: skip


def _layout(serial: NumberedModel, what: str) -> tuple[Any, ...]:
    """Nodes and elements of the families that lay out a "mesh" of beams or a "surface"."""
    found = [family.fingerprint().get(what, ()) for family in serial.families.values()]
    return tuple(part for parts in found for part in parts)


#: Checksums of data by their identity: many beams have one section. Functions are included; each is
#: evaluated where it occurs first.
_Known = dict[int, tuple[Any, str]]


class _Digest:
    """Checksum of nested data; functions are included if known checksums are stored."""

    def __init__(self, serial: NumberedModel, known: _Known | None = None) -> None:
        self._serial, self._hash = serial, hashlib.blake2b(digest_size=8)
        self._known = known

    def of(self, value: Any) -> str:
        """Checksum of a value with all its contents."""
        self._add(value)
        return self._hash.hexdigest()

    def of_many(self, values: list[Any]) -> str:
        """Checksum of many values, those of each class field by field in arrays.

        Each object is included where it occurs first, and its number wherever it occurs.
        """
        self._add_many(values)
        return self._hash.hexdigest()

    def _add_many(self, values: list[Any]) -> None:
        kinds = list(dict.fromkeys(map(type, values)))
        if len(kinds) == 1:
            self._add_alike(kinds[0], values)
            return
        numbers = {kind: k for k, kind in enumerate(kinds)}
        self._text(repr([numbers[type(value)] for value in values]))
        for kind in kinds:
            self._add_alike(kind, [value for value in values if type(value) is kind])

    def _add_alike(self, kind: type, values: list[Any]) -> None:
        """Add values of one class."""
        self._text(f"{len(values)} of {kind.__name__}")
        if kind in (str, int, bool, type(None)):
            self._text(repr(values))
        elif kind in (float, np.float64):
            self._rows(np.array(values)[:, np.newaxis])
        elif kind is np.ndarray and len({(x.shape, x.dtype) for x in values}) == 1:
            self._text(f"array {values[0].shape}")
            self._rows(np.stack(values).reshape(len(values), -1))
        elif kind in (list, tuple) and len({len(x) for x in values}) == 1:
            self._text(f"sequence of {len(values[0])}")
            for column in zip(*values, strict=True):
                self._add_many(list(column))
        elif is_dataclass(kind):
            self._add_objects(kind, values)
        else:
            for value in values:
                self._add(value)

    def _add_objects(self, kind: type, values: list[Any]) -> None:
        """Add data of one class, each field of all new ones at once."""
        assert self._known is not None
        known, new = self._known, []
        for value in values:
            if id(value) not in known:
                known[id(value)] = value, f"number {len(known)}"
                new.append(value)
        self._text(repr([known[id(value)][1] for value in values]))
        names = {
            name for held in {tuple(vars(value)) for value in new} for name in held
            if not _is_derived(kind, name)
        }  # fmt: skip
        if not all(names <= vars(value).keys() for value in new):
            for value in new:
                self._data(value)
            return
        for name in sorted(names):
            self._text(name)
            self._add_many([vars(value)[name] for value in new])
        if issubclass(kind, Marker):
            self._add_many([self._place(value) for value in new])

    def _add(self, value: Any) -> None:
        if isinstance(value, np.ndarray | np.generic | float):
            self._array(np.asarray(value))
        elif value is None or isinstance(value, bool | int | str):
            self._text(f"{type(value).__name__} {value!r}")
        elif isinstance(value, list | tuple):
            self._text(f"sequence of {len(value)}")
            for entry in value:
                self._add(entry)
        elif isinstance(value, Mapping):
            self._add(sorted(value.items()))
        elif is_dataclass(value) and not isinstance(value, type):
            if self._known is None:
                self._data(value)
            else:
                self._text(self._checksum(value, self._known))
        elif self._known is not None:
            self._code(value)
        else:
            self._text("function" if callable(value) else type(value).__name__)

    def _data(self, value: Any) -> None:
        kind = type(value)
        self._text(kind.__name__)
        kept = {n: x for n, x in vars(value).items() if not _is_derived(kind, n)}
        self._add(kept)
        if isinstance(value, Marker):  # groups of the mesh may have been renamed or moved
            self._add(self._place(value))

    def _place(self, marker: Marker) -> Any:
        return self._serial.place(marker) or self._serial.key(marker)

    def _checksum(self, value: Any, known: _Known) -> str:
        """Checksum of data, computed once; the data are kept to keep their identity unique."""
        if id(value) not in known:
            known[id(value)] = value, ""  # an enclosed function may refer to it
            other = _Digest(self._serial, known)
            other._data(value)
            known[id(value)] = value, other._hash.hexdigest()
        return known[id(value)][1]

    def _code(self, value: Any) -> None:
        """Add the code and data of a function or a callable object."""
        self._text(type(value).__name__)
        assert self._known is not None
        if id(value) in self._known:
            return
        self._known[id(value)] = value, ""
        if isinstance(value, partial):
            self._add([value.func, value.args, value.keywords])
        elif isinstance(value, MethodType):
            self._add([value.__self__, value.__func__])
        elif isinstance(value, FunctionType):
            code, enclosed = value.__code__, _enclosed(value)
            self._text(" ".join(_instructions(code)))
            self._around(enclosed)
            for held in enclosed.values():
                if hasattr(held, "__dict__") and not isinstance(held, ModuleType | type):
                    self._code(held)
            self._around({name: value.__globals__.get(name) for name in code.co_names})
        elif isinstance(value, np.random.Generator):
            self._text(repr(value.bit_generator.state))
        else:
            self._around(getattr(value, "__dict__", {}))

    def _around(self, names: Mapping[str, Any]) -> None:
        """Add global values that functions use by name; other objects may differ between ranks."""
        for name, value in sorted(names.items()):
            if _counts(value):
                self._text(name)
                self._add(value)

    def _text(self, text: str) -> None:
        self._hash.update(text.encode() + b"\0")

    def _rows(self, values: np.ndarray[Any, Any]) -> None:
        """Add the rows of a matrix, each as an array of its own."""
        real = values.dtype.kind == "f"
        if not 0 < values.shape[1] <= _SMALL or (real and not np.isfinite(values).all()):
            for row in values:
                self._array(row)
            return
        if real:
            exponents = np.frexp(_BORDER * np.abs(values).max(axis=1, keepdims=True))[1]
            self._hash.update(exponents.tobytes())
            values = np.rint(np.ldexp(values, -exponents) / _STEP)
        self._hash.update(np.ascontiguousarray(values, dtype=np.int64).tobytes())

    def _array(self, values: np.ndarray[Any, Any]) -> None:
        self._text(f"array {values.shape}")
        if values.dtype.kind == "f" and not np.isfinite(values).all():  # infinite limits
            self._text(repr(values[~np.isfinite(values)].tolist()))
            values = np.where(np.isfinite(values), values, 0.0)
        if values.dtype.kind == "f" and values.size:
            exponent = int(np.frexp(_BORDER * np.abs(values).max())[1])
            self._text(str(exponent))
            values = np.rint(np.ldexp(values, -exponent) / _STEP)
        self._hash.update(np.ascontiguousarray(values, dtype=np.int64).tobytes())


def _is_derived(kind: type, name: str) -> bool:
    """Return True if an object has a value because it has been asked for, computed from others."""
    return isinstance(getattr(kind, name, None), cached_property)


def _counts(value: Any) -> bool:
    """Return True if a value used by a function is included: float, data or function.

    Lists are not: functions that are called on some ranks only may store records in them.
    """
    if isinstance(value, np.ndarray):
        return bool(value.dtype.kind == "f")
    if isinstance(value, tuple):
        return all(isinstance(entry, float) for entry in value)
    data = is_dataclass(value) and not isinstance(value, type)
    return data or isinstance(value, float | FunctionType | np.random.Generator)


def _enclosed(function: FunctionType) -> dict[str, Any]:
    """Variables that a function encloses, by name, and its defaults by their place."""
    found = dict[str, Any](function.__kwdefaults__ or {})
    for place, value in enumerate(function.__defaults__ or ()):
        found[f"default {place}"] = value
    names = function.__code__.co_freevars
    for name, cell in zip(names, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # the variable has no value yet
            found[name] = cell.cell_contents
    return found


def _instructions(code: CodeType) -> Iterator[str]:
    """Yield the instructions of a function's code, and of those within it."""
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _instructions(constant)
        elif isinstance(constant, frozenset):
            yield repr(sorted(map(repr, constant)))
        else:
            yield repr(constant)
