# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options: names, defaults and admissible values, for the command line and for Python callers."""

import difflib
import functools
import inspect
import math
import operator
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, dataclass_transform

from flexfem._checks import show
from flexfem._files import number_in


@dataclass(frozen=True)
class Option:
    """One named value with its type, default, unit and admissible range.

    Args:
        name: Python identifier; ``beam_length`` becomes ``--beam-length`` on the command line.
        kind: ``int``, ``float``, ``str`` or ``bool`` (a bool becomes ``--name`` / ``--no-name``);
            several numbers are a :class:`VectorOption`.
        default: Value when the option is not given.
        help: One line for ``--help``.
        unit: Physical unit shown in ``--help``; None for pure numbers.
        minimum: Smallest admissible number.
        maximum: Largest admissible number.
        above: The number must be strictly greater than this one.
        choices: Admissible values; empty when any is.
        note: Sentences that the reference adds to the help.

    Raises:
        ValueError: If the name, the type or the default is not admissible.
    """

    name: str
    kind: type[int] | type[float] | type[str] | type[bool] | type[tuple[float, ...]]
    default: Any
    help: str
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    choices: Sequence[Any] = ()
    note: str = ""

    _KINDS: ClassVar[tuple[type, ...]] = (int, float, str, bool)

    def __post_init__(self) -> None:
        """Check the declaration itself."""
        if not self.name.isidentifier() or self.name.startswith("_"):
            raise ValueError(f"Option '{self.name}': the name is not a plain Python identifier")
        if self.kind not in self._KINDS:
            known = ", ".join(kind.__name__ for kind in self._KINDS)
            more = "; several numbers are a VectorOption" if self.kind is tuple else ""
            raise ValueError(f"Option '{self.name}': type {self.kind!r} is not {known}{more}")
        if self.default is not None:
            try:
                self.check(self.default)
            except (TypeError, ValueError) as error:
                raise ValueError(f"Option '{self.name}': the default {error}") from None

    @property
    def flag(self) -> str:
        """The option as written on a command line."""
        return "--" + self.name.replace("_", "-")

    def parse(self, text: str) -> Any:
        """Turn command-line text into a checked value.

        Raises:
            ValueError: If the text is no admissible value; the message starts with "must be".
        """
        try:
            return self.check(self._read(text))
        except (TypeError, ValueError):
            raise ValueError(f"must be {self.describe()}, got '{text}'") from None

    def _read(self, text: str) -> Any:
        """The value of a text; numbers are decimal, while Python's own take 1_0 for 10.

        Raises:
            ValueError: The text is none.
        """
        if self.kind in (int, float):
            number_in(text)
        kind: type[Any] = self.kind
        return kind(text)

    def check(self, value: Any) -> Any:
        """Return the value as the option's own type.

        Raises:
            TypeError: If the value has another type.
            ValueError: If the value is NaN, infinite or out of range.
        """
        converted = self._convert(value)
        inside = not self.choices or converted in self.choices
        if self.kind is int and abs(converted) > _MOST:
            inside = False
        elif self.kind in (int, float):
            inside = inside and math.isfinite(converted) and self._in_range(converted)
        if not inside:
            raise ValueError(f"must be {self.describe()}, got {show(value)}")
        return converted

    def _convert(self, value: Any) -> Any:
        """Accept NumPy scalars as numbers, but neither truth values nor text."""
        try:
            if isinstance(value, bool) is not (self.kind is bool) or (
                isinstance(value, str) is not (self.kind is str)
            ):
                raise TypeError
            return operator.index(value) if self.kind is int else self.kind(value)
        except (TypeError, ValueError, OverflowError):
            raise TypeError(f"must be {self.describe()}, got {show(value)}") from None

    def _in_range(self, value: float) -> bool:
        return (
            (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
            and (self.above is None or value > self.above)
        )

    def describe(self) -> str:
        """Name the admissible values, e.g. "a finite number > 0 [s]"."""
        if self.choices:
            return "one of " + ", ".join(map(str, self.choices))
        kinds = {
            int: "a whole number",
            float: "a finite number",
            str: "text",
            bool: "True or False",
        }
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in ((">", self.above), (">=", self.minimum), ("<=", self.maximum))
            if bound is not None
        ]
        text = " ".join([kinds[self.kind], " and ".join(bounds)]).strip()
        return f"{text} [{self.unit}]" if self.unit else text


@dataclass(frozen=True, init=False)
class VectorOption(Option):
    """Several numbers, as many as the default has: ``--gravity 0,0,-9.81``, a tuple in Python.

    Each component is an option as well, which leaves the others as they are: ``gravity[2]``.

    Args:
        name: Python identifier, as of :class:`Option`.
        default: The numbers when the option is not given: a sequence or an array.
        help: One line for ``--help``.
        unit: Physical unit of each number; None for pure numbers.
        minimum: Smallest admissible number.
        maximum: Largest admissible number.
        above: Each number must be strictly greater than this one.
        note: Sentences that the reference adds to the help.

    Raises:
        ValueError: The name is not admissible, or the default has no numbers or others.
    """

    _KINDS: ClassVar[tuple[type, ...]] = (tuple,)

    def __init__(
        self, name: str, default: Iterable[float], help: str, *, unit: str | None = None,
        minimum: float | None = None, maximum: float | None = None, above: float | None = None,
        note: str = "",
    ) -> None:  # fmt: skip
        """Declare the option."""
        numbers = numbers_of(default)
        if not numbers:
            raise ValueError(f"Option '{name}': the default must be numbers, got {show(default)}")
        super().__init__(
            name, tuple, numbers, help, unit, minimum, maximum, above, choices=(), note=note
        )
        object.__setattr__(self, "default", self.check(numbers))

    @property
    def component(self) -> Option:
        """Each of the numbers as an option."""
        return Option(
            self.name, float, None, self.help, self.unit, self.minimum, self.maximum, self.above
        )

    def check(self, value: Any) -> tuple[float, ...]:
        """Return the numbers, of a sequence or an array; see :meth:`Option.check`."""
        numbers = numbers_of(value)
        if numbers is None:
            raise TypeError(f"must be {self.describe()}, got {show(value)}")
        try:
            checked = tuple(self.component.check(number) for number in numbers)
        except (TypeError, ValueError) as error:
            raise type(error)(f"must be {self.describe()}, got {show(value)}") from None
        if len(checked) != len(self.default):
            raise ValueError(f"must be {self.describe()}, got {show(value)}")
        return checked

    def _read(self, text: str) -> tuple[float, ...]:
        return tuple(number_in(part) for part in text.split(","))

    def describe(self) -> str:
        """Name the admissible values, e.g. "3 numbers separated by commas, ..."."""
        return f"{len(self.default)} numbers separated by commas, each {self.component.describe()}"


def numbers_of(value: Any) -> tuple[Any, ...] | None:
    """The entries of a sequence or an array; None if it is none, or a text."""
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        return None
    return tuple(value)


#: A component of a vector, ``gravity[2]``.
_COMPONENT = re.compile(r"(\w+)\[(\d+)\]", flags=re.ASCII)


def with_components(options: Iterable[Option]) -> dict[str, Option]:
    """Options by their names, each vector followed by its components."""
    known: dict[str, Option] = {}
    for one in options:
        known[one.name] = one
        if isinstance(one, VectorOption):
            known |= {f"{one.name}[{k}]": one.component for k in range(len(one.default))}
    return known


def vector_of(name: str) -> str:
    """The name of the vector with this component; other names stay as they are."""
    found = _COMPONENT.fullmatch(name)
    return name if found is None else found[1]


def with_changed_components(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by option, where those of components have taken their places in the vectors."""
    whole = {name: value for name, value in values.items() if vector_of(name) == name}
    for name, value in values.items():
        if found := _COMPONENT.fullmatch(name):
            numbers = list(whole[found[1]])
            numbers[int(found[2])] = value
            whole[found[1]] = tuple(numbers)
    return whole


def value_text(value: Any) -> str:
    """A value as it is typed on a command line, and named."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ",".join(map(value_text, value))
    return repr(value) if isinstance(value, float) else str(value)


@dataclass(frozen=True, init=False)
class GridOption(Option):
    """Numbers of nodes along two directions, such as "31x21"."""

    def __init__(self, name: str, default: str, help: str) -> None:
        """Declare the option; arguments as for :class:`Option`."""
        super().__init__(name, str, default, help)

    def check(self, value: Any) -> str:
        """Return the text; see :meth:`Option.check`."""
        text: str = super().check(value)
        try:
            grid_nodes(text)
        except ValueError:
            raise ValueError(f"must be {self.describe()}, got {value!r}") from None
        return text

    def describe(self) -> str:
        """See :meth:`Option.describe`."""
        return "two whole numbers > 1 such as 31x21"


def grid_nodes(text: str) -> tuple[int, int]:
    """Return the two numbers of nodes in a text such as "31x21".

    Raises:
        ValueError: It is not of this form, or a number is below 2.
    """
    found = re.fullmatch(r"(\d+)x(\d+)", text, flags=re.ASCII)
    if found is None or min(int(found[1]), int(found[2])) < 2:
        raise ValueError(f'a grid is written as two whole numbers > 1 such as 31x21, got "{text}"')
    return int(found[1]), int(found[2])


@dataclass(frozen=True)
class TargetsOption(Option):
    """Values of columns, such as "t=0.5,1;tip_z=-0.1"."""

    def check(self, value: Any) -> str:
        """Return the text, also of a mapping of columns to values; see :meth:`Option.check`."""
        if isinstance(value, Mapping):
            parts = [f"{name}={','.join(map(repr, list(some)))}" for name, some in value.items()]
            value = ";".join(parts) or "none"
        text: str = super().check(value)
        try:
            target_values(text)
        except ValueError:
            raise ValueError(f"must be {self.describe()}, got {value!r}") from None
        return text

    def describe(self) -> str:
        """See :meth:`Option.describe`."""
        return "values of columns such as t=0.5,1;tip_z=-0.1, or none"


def target_values(text: str) -> dict[str, tuple[float, ...]]:
    """Return the values of each column in a text such as "t=0.5,1;tip_z=-0.1"; "none" has none.

    Raises:
        ValueError: It is not of this form, or a value is not finite.
    """
    found: dict[str, tuple[float, ...]] = {}
    for part in () if text == "none" else text.split(";"):
        name, sign, numbers = part.strip().partition("=")
        values = tuple(float(number) for number in numbers.split(","))
        if not name or not sign or not all(map(math.isfinite, values)):
            raise ValueError(f'values are written as t=0.5,1;tip_z=-0.1, got "{text}"')
        found[name] = found.get(name, ()) + values
    return found


#: Fields that the series for ParaView can hold, and ``beam_surfaces``, a series of its own.
FIELDS = (
    "angular_velocity", "axial_stress", "beam_surfaces", "bending_energy", "bending_moment",
    "deformation", "displacement", "energy", "force", "force_magnitude", "membrane_energy",
    "moment", "moment_magnitude", "resultant", "shear_stress", "strain", "stress", "thickness",
    "velocity", "von_mises",
)  # fmt: skip


@dataclass(frozen=True)
class FieldsOption(Option):
    """Fields to write, such as "displacement,resultant"; see :func:`field_names`."""

    def check(self, value: Any) -> str:
        """Return the text, also of a list of names; see :meth:`Option.check`."""
        if isinstance(value, Sequence) and not isinstance(value, str):
            value = ",".join(map(str, value)) or "none"
        text: str = super().check(value)
        for name in field_names(text) or ():
            if name not in FIELDS:
                hint = meant(name, FIELDS)
                raise ValueError(
                    f"must be {self.describe()}, got {value!r}" + (f"; {hint}?" if hint else "")
                )
        return text

    def describe(self) -> str:
        """See :meth:`Option.describe`."""
        return "all, none, or names of fields such as displacement,resultant"


def field_names(text: str) -> frozenset[str] | None:
    """Return the names in a text such as "displacement,resultant"; None for "all"."""
    if text == "all":
        return None
    return frozenset() if text == "none" else frozenset(text.split(","))


@dataclass(frozen=True, init=False)
class ProgressOption(Option):
    """Display of progress: see :func:`progress_kind`."""

    def __init__(self) -> None:
        """Declare the option."""
        text = "on stderr: a bar (auto: on terminals only), or lines, every 30 s or S seconds"
        super().__init__("progress", str, "auto", text)

    def check(self, value: Any) -> str:
        """Return the text; see :meth:`Option.check`."""
        text: str = super().check(value)
        try:
            progress_kind(text)
        except ValueError:
            raise ValueError(f"must be {self.describe()}, got {value!r}") from None
        return text

    def describe(self) -> str:
        """See :meth:`Option.describe`."""
        return "auto, bar, lines, lines:SECONDS or none"


#: Default of the seconds between two lines of progress.
_EVERY = 30.0
#: Largest whole number that arrays hold.
_MOST = 2**63 - 1


def is_text(path: str) -> bool:
    """Return True if the name of a file is UTF-8 and has no NUL."""
    return "\0" not in path and not any("\ud800" <= letter <= "\udfff" for letter in path)


def meant(name: str, known: Iterable[str]) -> str:
    """Names that an unknown one is spelt like, as "did you mean a or b"; empty without any."""
    near = difflib.get_close_matches(name, list(known))
    return f"did you mean {' or '.join(near)}" if near else ""


def progress_kind(text: str) -> tuple[str, float]:
    """Return "auto", "bar", "lines" or "none", and the seconds between two lines.

    Raises:
        ValueError: The text is none of these words, nor "lines:" and a time (s) of 0.1 or more.
    """
    word, colon, seconds = text.partition(":")
    if word not in ("auto", "bar", "lines", "none") or (colon and word != "lines"):
        raise ValueError(f'progress must be auto, bar, lines, lines:SECONDS or none, got "{text}"')
    try:
        every = number_in(seconds) if colon else _EVERY
    except ValueError:
        every = math.nan
    if not 0.1 <= every < math.inf:
        raise ValueError(f'progress: seconds between two lines must be 0.1 or more, got "{text}"')
    return word, every


PROGRESS = ProgressOption()


def option(help: str, *, default: Any = MISSING, kind: type[Option] = Option, **more: Any) -> Any:
    """Declare a field of settings that is an option, with its whole description.

    Its name and type are those of the field. Without a default, each case gives one.

    Args:
        help: One line for ``--help``, which the reference shows as well.
        default: Value when the option is not given.
        kind: Class of the option.
        more: Unit, bounds, choices and note, see :class:`Option`.
    """
    return field(default=default, metadata={"help": help, "kind": kind, "more": more})


def setting(help: str, *, default: Any, note: str = "", compare: bool = True) -> Any:
    """Declare a field of settings that is not numerical: no option of cases."""
    return field(default=default, metadata={"help": help, "note": note}, compare=compare)


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option, setting))
def settings[Kind: type[Settings]](cls: Kind) -> Kind:
    """Make a frozen dataclass of a class of settings.

    Options and paths are collected from its fields, and their descriptions are added to its
    docstring. A plain value of an inherited option is another default.
    """
    dataclass(frozen=True, kw_only=True)(cls)
    inherited, own = {one.name: one for one in cls.OPTIONS}, {}
    for one in fields(cls):
        if one.name not in inspect.get_annotations(cls):
            continue
        if "kind" in one.metadata:
            own[one.name] = _declared(one)
        elif one.name in inherited:
            inherited[one.name] = replace(inherited[one.name], default=one.default)
    cls.OPTIONS = tuple((own | inherited).values())
    cls.PATHS = tuple(one.name for one in fields(cls) if one.type == Path | None)
    others = [one for one in fields(cls) if "note" in one.metadata]
    entries = [(one.name, _entry(one)) for one in cls.OPTIONS]
    entries += [(one.name, "{help}. {note}".format_map(one.metadata).rstrip()) for one in others]
    cls.__doc__ = _with_arguments(inspect.cleandoc(cls.__doc__ or ""), entries)
    _check_names(cls)
    return cls


def _check_names(cls: type["Settings"]) -> None:
    """Make the constructor of a class of settings name unknown options, and the nearest ones."""
    construct, known = cls.__init__, [one.name for one in fields(cls)]

    @functools.wraps(construct)
    def checked(self: "Settings", *values: Any, **options: Any) -> None:
        if values:
            raise TypeError(
                f"{cls.__name__}: give options by name, as {known[0]}=..., got {show(values[0])}"
            )
        for name in options:
            if name not in known:
                hint = meant(name, known) or f"known are {', '.join(sorted(known))}"
                raise TypeError(f"{cls.__name__}: no option '{name}', {hint}")
        construct(self, **options)

    cls.__init__ = checked  # type: ignore[method-assign]


def _declared(one: Any) -> Option:
    """The option that a field of settings declares."""
    default = None if one.default is MISSING else one.default
    kind: type[Option] = one.metadata["kind"]
    return kind(one.name, one.type, default, one.metadata["help"], **one.metadata["more"])


def _entry(one: Option) -> str:
    """Help, admissible values and note of an option."""
    values = "" if one.kind is bool else f" ({one.describe()})"
    if one.kind is str and not one.choices:
        values = f" [{one.unit}]" if one.unit else ""
    return f"{one.help}{values}. {one.note}".rstrip()


def _with_arguments(doc: str, entries: Iterable[tuple[str, str]]) -> str:
    """A docstring with a list of arguments before the errors raised."""
    arguments = [
        textwrap.fill(
            f"{name}: {text}", 96, initial_indent=" " * 4, subsequent_indent=" " * 8,
            break_on_hyphens=False,
        )
        for name, text in entries
    ]  # fmt: skip
    text, raises, reasons = doc.partition("\n\nRaises:")
    return "\n".join([f"{text}\n\nArgs:", *arguments]) + raises + reasons


@settings
class Settings:
    """Numerical options of one kind of analysis; subclasses have one field for each option."""

    # All options, those that the class itself declares first.
    OPTIONS: ClassVar[tuple[Option, ...]] = ()
    #: Options that a restart may not change.
    RESTART_AGREES: ClassVar[tuple[str, ...]] = ()
    # Fields that are paths, or None.
    PATHS: ClassVar[tuple[str, ...]] = ()

    output: Path | None = setting("folder of the results; None writes nothing", default=None)
    quiet: bool = setting("show no progress, whatever ``progress`` is", default=False)
    progress: str = setting(f"{PROGRESS.help}: {PROGRESS.describe()}", default=PROGRESS.default)
    case_options: Mapping[str, Any] | None = setting(
        "values of the case's own options, for the summary; a case sets them", default=None,
        compare=False,
    )  # fmt: skip

    @property
    def recorded(self) -> dict[str, Any]:
        """Values of all options, also of the case's own, for the summary."""
        own = {one.name: getattr(self, one.name) for one in self.OPTIONS}
        return {**(self.case_options or {}), **own}

    def __post_init__(self) -> None:
        """Check every value and turn it into its plain Python type.

        Raises:
            TypeError: If a value has the wrong type.
            ValueError: If a value is out of range.
        """
        for option in (*self.OPTIONS, PROGRESS):
            try:
                value = option.check(getattr(self, option.name))
            except (TypeError, ValueError) as error:
                raise type(error)(f"{type(self).__name__}: {option.name} {error}") from None
            object.__setattr__(self, option.name, value)
        for name in self.PATHS:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._path(name))

    def _path(self, name: str) -> Path:
        """A field as a path.

        Raises:
            TypeError: It is none.
            ValueError: It is not UTF-8, or has a NUL.
        """
        try:
            path = Path(getattr(self, name))
            if not is_text(str(path)):
                raise ValueError(
                    f"{type(self).__name__}: {name} {str(path)!a} is not UTF-8; rename the file or "
                    "folder"
                )
            return path
        except TypeError:
            value = getattr(self, name)
            raise TypeError(
                f"{type(self).__name__}: {name} must be a path or None, got {value!r}"
            ) from None
