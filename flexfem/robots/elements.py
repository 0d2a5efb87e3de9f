# SPDX-License-Identifier: LGPL-3.0-or-later
"""XML elements with file and line, for messages on wrong values."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._files import number_in, read_bytes
from flexfem._types import FloatArray

__all__ = ["Element", "read_elements"]

#: Bytes of a file, elements, their nesting, and characters of a name or value, beyond which it is
#: no description of a robot.
_LARGEST, _MOST, _DEEPEST, _LONGEST = 16_000_000, 100_000, 64, 10_000
#: Characters of a message.
_MESSAGE = 500


@dataclass(eq=False)
class Element:
    """One element of a file.

    Attributes:
        tag: its name.
        attributes: texts by name.
        file: of the file, for messages.
        line: number of its line, from 1.
        inside: the named elements around it, such as 'joint "elbow"', for messages.
        children: elements in it.
    """

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    inside: str = ""
    children: list["Element"] = field(default_factory=list)

    def refuse(self, message: str) -> NoReturn:
        """Raise in one line that names file, line and element.

        Raises:
            ValueError: always.
        """
        place = f"{self.inside}: " if self.inside else ""
        raise ValueError(_cut(f'"{self.file}", line {self.line}: {place}<{self.tag}> {message}'))

    def only(self, attributes: Collection[str], children: Collection[str] = ()) -> "Element":
        """The element itself, after checking that it holds nothing unknown.

        Extensions with a prefix, as in ``<drake:joint>``, are ignored.

        Raises:
            ValueError: another attribute or child.
        """
        for name in self.attributes:
            if name not in attributes and ":" not in name:
                known = ", ".join(attributes) or "none"
                self.refuse(f'has the attribute {name}="{self.attributes[name]}"; known: {known}')
        for child in self.children:
            if child.tag not in children and ":" not in child.tag:
                known = ", ".join(children) or "no elements"
                child.refuse(f"is not known in <{self.tag}>, which holds {known}")
        return self

    def all(self, tag: str) -> Iterator["Element"]:
        """Children of a name."""
        return (child for child in self.children if child.tag == tag)

    def child(self, tag: str) -> "Element | None":
        """The only child of a name, None if there is none.

        Raises:
            ValueError: there are several.
        """
        found = list(self.all(tag))
        if len(found) > 1:
            found[1].refuse(f"is there a second time, the first is in line {found[0].line}")
        return found[0] if found else None

    def required(self, tag: str) -> "Element":
        """The only child of a name.

        Raises:
            ValueError: there is none, or several.
        """
        child = self.child(tag)
        if child is None:
            self.refuse(f"has no <{tag}>")
        return child

    def text(self, name: str) -> str:
        """An attribute.

        Raises:
            ValueError: it is missing, empty or not printable.
        """
        value = self.attributes.get(name)
        if value is None:
            self.refuse(f"has no {name}")
        if not value.strip() or not value.isprintable() or '"' in value:
            self.refuse(f"must have a printable {name}, got {_checks.show(value)}")
        return value.strip()

    def number(
        self, name: str, default: float | None = None, *, positive: bool = False,
        nonnegative: bool = False,
    ) -> float:  # fmt: skip
        """An attribute as a number.

        Raises:
            ValueError: it is missing without default, no finite number, or has the wrong sign.
        """
        if name not in self.attributes and default is not None:
            return default
        (value,) = self.numbers(name, 1).tolist()
        if (positive and value <= 0.0) or (nonnegative and value < 0.0):
            sign = "must be positive" if positive else "must not be negative"
            self.refuse(f'{name} {sign}, got "{self.attributes[name]}"')
        return float(value)

    def numbers(self, name: str, count: int, default: tuple[float, ...] = ()) -> FloatArray:
        """An attribute as numbers, shape (count,).

        Raises:
            ValueError: it is missing without default, or does not hold that many finite numbers.
        """
        if name not in self.attributes and default:
            return np.array(default)
        text = self.text(name)
        words = text.split()
        try:
            values = np.array([number_in(word) for word in words[: count + 1]])
        except ValueError as error:
            hint = "; expand xacro first" if "${" in text else ""
            wanted = str(error).partition(", got")[0]
            if wanted == "must be a number":
                wanted = f"must hold {_counted(count)}"
            self.refuse(f'{name} {wanted}, got "{text}"{hint}')
        if len(words) != count:
            self.refuse(f'{name} must hold {_counted(count)}, got "{text}"')
        return values


def _counted(count: int) -> str:
    return "one number" if count == 1 else f"{count} numbers"


def _cut(message: str) -> str:
    """A message whose values are not longer than a screen."""
    return message if len(message) <= _MESSAGE else f"{message[: _MESSAGE - 3]}..."


def read_elements(path: Path) -> Element:
    """The root element of an XML file.

    Raises:
        ValueError: the file is missing, no well-formed XML, too large, or declares entities.
    """
    content = read_bytes(f'"{path}"', path, _LARGEST)
    reader = _Reader(path)
    try:
        reader.parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise ValueError(f'"{path}", line {error.lineno}: no well-formed XML, {reason}') from None
    except InputError:
        raise
    except (LookupError, ValueError) as error:  # an encoding unknown to Python
        raise ValueError(f'"{path}": no well-formed XML, {_cut(str(error))}') from None
    return reader.root[0]


class _Reader:
    """Makes elements from the events of the parser."""

    def __init__(self, path: Path) -> None:
        self._path, self._count = path, 0
        self.root: list[Element] = []
        self._open: list[Element] = []
        self.parser = parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = lambda tag: self._open.pop()
        parser.StartDoctypeDeclHandler = self._doctype
        parser.EntityDeclHandler = lambda *_: self._refuse("entities are not read")

    def _refuse(self, reason: str) -> NoReturn:
        raise InputError(f'"{self._path}", line {self.parser.CurrentLineNumber}: {reason}')

    def _doctype(self, name: str, system: str | None, public: str | None, inside: bool) -> None:
        if inside:  # entities that grow, and attributes that no element shows
            self._refuse("declarations of entities are not read")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > _MOST or len(self._open) >= _DEEPEST:
            self._refuse(f"more than {_MOST} elements, or {_DEEPEST} within one another")
        if max(map(len, (tag, *attributes, *attributes.values()))) > _LONGEST:
            self._refuse(f"a name or value has more than {_LONGEST} characters")
        around = self._open[-1].inside if self._open else ""
        line = self.parser.CurrentLineNumber
        element = Element(tag, attributes, str(self._path), line, around)
        if len(self._open) == 1 and "name" in attributes:
            element.inside = f'{tag} "{attributes["name"]}"'
        (self._open[-1].children if self._open else self.root).append(element)
        self._open.append(element)
