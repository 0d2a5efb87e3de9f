# SPDX-License-Identifier: LGPL-3.0-or-later
"""B-spline curves of STEP files (ISO 10303-21), read as data.

Taken are the entities B_SPLINE_CURVE_WITH_KNOTS, rational or not, whose points lie in space, and
the unit of length.
"""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from flexfem._types import FloatArray
from flexfem.mesh.imported.curve_parts import CurveParts
from flexfem.mesh.imported.limits import real, whole

__all__ = ["read"]

_BEGIN = "ISO-10303-21;"
_SPECIAL = re.compile(r"[;']|/\*")
_NUMBERED = re.compile(r"\s*#([0-9]{1,15})\s*=\s*")
_TOKEN = re.compile(r"'(?:[^']|'')*'|[^\s(),']+|[(),]")
#: Lists in lists: no entity that is taken has more.
_DEPTH = 6
#: Metres in the units of the file.
_PREFIXES = {
    "$": 1.0,
    ".MILLI.": 1e-3,
    ".CENTI.": 1e-2,
    ".DECI.": 1e-1,
    ".KILO.": 1e3,
    ".MICRO.": 1e-6,
}
_CURVE, _RATIONAL = "B_SPLINE_CURVE_WITH_KNOTS", "RATIONAL_B_SPLINE_CURVE"

#: Arguments of an entity by its keywords.
type Entity = dict[str, list[Any]]


def read(path: Path, text: str, scale: float | None) -> list[CurveParts]:
    """Read all curves.

    Args:
        path: For messages.
        text: Of the file.
        scale: Metres in its unit, None for the unit that it states.

    Raises:
        ValueError: It is not such a file, or something in it cannot be read.
    """
    if not text.lstrip().startswith(_BEGIN):
        raise ValueError(f'curve file "{path}": it does not begin with {_BEGIN} like STEP files')
    entities = _entities(path, text)
    factor = _unit(path, entities) if scale is None else scale
    curves = []
    for number, entity in entities.items():
        if _CURVE in entity:
            try:
                found = _curve(number, entity, entities, factor)
            except (IndexError, KeyError, TypeError, ValueError):
                _fail(path, f"curve #{number}: it lacks points, knots or weights, or has others")
            if found is not None:
                curves.append(found)
    return curves


def _fail(path: Path, reason: str) -> NoReturn:
    raise ValueError(f'curve file "{path}": {reason}')


def _statements(path: Path, text: str) -> Iterator[str]:
    """Yield the statements between semicolons, without comments."""
    parts: list[str] = []
    start = at = 0
    while found := _SPECIAL.search(text, at):
        if found[0] == ";":
            yield "".join([*parts, text[start : found.start()]])
            parts, start, at = [], found.end(), found.end()
            continue
        end = text.find("'" if found[0] == "'" else "*/", found.end())
        if end < 0:
            _fail(path, "a text or a comment in it does not end")
        at = end + len(found[0])
        if found[0] != "'":
            parts.append(text[start : found.start()])
            start = at


def _entities(path: Path, text: str) -> dict[int, Entity]:
    """Return the entities that curves and units are made of by their numbers."""
    found: dict[int, Entity] = {}
    for statement in _statements(path, text):
        begin = _NUMBERED.match(statement)
        if begin and ("B_SPLINE_CURVE" in statement or "POINT" in statement or "UNIT" in statement):
            number = int(begin[1])
            if number in found:
                _fail(path, f"#{number} is in it twice")
            items = _parsed(path, number, statement[begin.end() :])
            if len(items) == 1 and isinstance(items[0], list):
                items = items[0]
            found[number] = {
                key: value
                for key, value in pairwise(items)
                if isinstance(key, str) and isinstance(value, list)
            }
    return found


def _parsed(path: Path, number: int, text: str) -> list[Any]:
    """Return texts and lists of them, as brackets say."""
    lists: list[list[Any]] = [[]]
    for token in _TOKEN.findall(text):
        if token == "(":
            inner: list[Any] = []
            lists[-1].append(inner)
            lists.append(inner)
        elif token == ")":
            lists.pop()
        elif token != ",":
            lists[-1].append(token)
        if not 1 <= len(lists) <= _DEPTH:
            _fail(path, f"#{number}: brackets that do not match")
    if len(lists) != 1:
        _fail(path, f"#{number}: brackets that do not match")
    return lists[0]


def _unit(path: Path, entities: dict[int, Entity]) -> float:
    """Return the metres in the unit of length."""
    found = set()
    for entity in entities.values():
        if "LENGTH_UNIT" in entity:
            unit = entity.get("SI_UNIT", [])
            known = len(unit) == 2 and unit[1] == ".METRE." and unit[0] in _PREFIXES
            found.add(_PREFIXES[unit[0]] if known else None)
    if len(found) != 1 or None in found:
        _fail(path, "it does not say one unit of length in metres, give scale")
    return float(found.pop())  # type: ignore[arg-type]


def _numbers(values: list[Any]) -> FloatArray:
    found = [real(value) for value in values]
    if None in found:
        raise ValueError
    return np.array(found, dtype=np.float64)


def _whole(value: str) -> int:
    found = whole(value)
    if found is None:
        raise ValueError
    return found


def _curve(
    number: int, entity: Entity, entities: dict[int, Entity], factor: float
) -> CurveParts | None:
    """Return a curve, None for one in the plane of a surface's parameters."""
    knots, weights = entity[_CURVE], None
    if "B_SPLINE_CURVE" in entity:
        degree, places = entity["B_SPLINE_CURVE"][:2]
        name = entity.get("REPRESENTATION_ITEM", ["''"])[0]
        weights = _numbers(entity[_RATIONAL][0]) if _RATIONAL in entity else None
    else:
        name, degree, places = knots[:3]
        knots = knots[6:]
    points = [entities[_whole(place[1:])]["CARTESIAN_POINT"][1] for place in places]
    if all(len(point) == 2 for point in points):
        return None
    times = [_whole(k) for k in knots[0]]
    # counts in the file are compared with its contents before anything is repeated
    if min(times) < 1 or sum(times) != len(points) + _whole(degree) + 1:
        raise ValueError
    return CurveParts(
        number=f"#{number}",
        name=name[1:-1].strip(),
        degree=_whole(degree),
        knots=np.repeat(_numbers(knots[1]), times),
        points=factor * np.array([_numbers(point) for point in points]).reshape(-1, 3),
        weights=np.ones(len(points)) if weights is None else weights,
    )
