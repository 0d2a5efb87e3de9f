# SPDX-License-Identifier: LGPL-3.0-or-later
"""Costs of the formalisms as a table for the screen, and findings from its figures."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

__all__ = ["findings", "table_text"]

Row = Mapping[str, Any]
_HEADS = {
    "microseconds_per_cell": "us/cell", "milliseconds_accelerations": "ms/accel.",
    "iterations_per_step": "iter./step", "milliseconds_per_step": "ms/step",
}  # fmt: skip


def table_text(rows: Sequence[Row]) -> str:
    """The table for the screen, without the quartiles of ratios."""
    shown = [name for name in rows[0] if not name.endswith(("ratio_low", "ratio_high"))]
    heads = [_HEADS.get(name, name) for name in shown]
    lines = [[_cell(row[name]) for name in shown] for row in rows]
    widths = [max(map(len, column)) for column in zip(heads, *lines, strict=True)]
    words = [isinstance(rows[0][name], str) for name in shown]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if word else cell.rjust(width)
            for cell, width, word in zip(cells, widths, words, strict=True)
        )  # fmt: skip
        return "  ".join(padded).rstrip()

    return "\n".join([line(heads), *map(line, lines)])


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def findings(rows: Sequence[Row], labels: Sequence[str], energies: Sequence[Row] = ()) -> str:
    """Test the claims that Gibbs–Appell is the cheapest and Hamilton the dearest, as text.

    Every formalism is compared with Lagrange's on the same mechanism; without that there is nothing
    to compare with. Times are called different where the quartiles of their ratios are.

    Args:
        rows: costs of the formalisms.
        labels: names of the columns that distinguish mechanisms.
        energies: costs of kinetic energy and energy of accelerations.
    """
    groups: dict[tuple[Any, ...], dict[str, Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[label] for label in labels), {})[row["formalism"]] = row
    sentences = []
    for formalism, title in (
        ("gibbs_appell", "Gibbs-Appell"), ("maggi", "Maggi"), ("hamilton", "Hamilton"),
    ):  # fmt: skip
        pairs = {
            " ".join(key): (group[formalism], group["lagrange"])
            for key, group in groups.items()
            if formalism in group and "lagrange" in group
        }
        if pairs:
            sentences.append(_comparison(title, pairs))
    if energies:
        sentences.insert(0, _of_energies(energies, labels))
    if not sentences:
        return "Without Lagrange's formalism and another one there is nothing to compare."
    if any(len(group) > 1 for group in groups.values()):
        sentences.append(_extremes(groups))
    return textwrap.fill(" ".join(sentences), 100)


#: Words for the compared quantities, and the columns where the quartiles of the ratios are if it is
#: a time.
_QUANTITIES = {
    "operations": ("operations per cell", ""), "unknowns": ("unknowns", ""),
    "microseconds_per_cell": ("time per evaluation", "cell_ratio"),
    "milliseconds_per_step": ("time per step", "step_ratio"),
}  # fmt: skip
#: Ratios of times that are nearer to one are none; counts are exact.
_SAME = 0.03


def _comparison(title: str, pairs: Mapping[str, tuple[Row, Row]]) -> str:
    """Ratios to Lagrange's figures, with where they are below one and where not."""
    parts = []
    for name, (words, spread) in _QUANTITIES.items():
        ratios, sides = {}, {}
        for key, (own, other) in pairs.items():
            ratios[key] = own[name] / other[name]
            low, high = (own[f"{spread}_{e}"] if spread else ratios[key] for e in ("low", "high"))
            same = _SAME if spread else 0.0
            sides[key] = _side(min(low, ratios[key]), max(high, ratios[key]), same)
        parts.append(f"{_span(ratios)} times the {words}{_where(sides, timed=bool(spread))}")
    return f"{title} takes, relative to Lagrange, {', '.join(parts[:-1])} and {parts[-1]}."


def _of_energies(rows: Sequence[Row], labels: Sequence[str]) -> str:
    """The energy of accelerations beside the kinetic energy."""
    groups: dict[str, dict[str, Row]] = {}
    for row in rows:
        key = " ".join(row[label] for label in labels)
        groups.setdefault(key, {})[row["energy"]] = row
    parts = []
    for name, words in (("operations", "operations"), ("microseconds_per_cell", "time")):
        ratios = {
            key: g["of_accelerations"][name] / g["kinetic"][name] for key, g in groups.items()
        }
        sides = {}
        for key, group in groups.items():
            own = group["of_accelerations"]
            timed = [own["ratio_low"], own["ratio_high"]] if words == "time" else []
            bounds = [ratios[key], *timed]
            sides[key] = _side(min(bounds), max(bounds), _SAME if timed else 0.0)
        parts.append(f"{_span(ratios)} times the {words}{_where(sides, timed=words == 'time')}")
    return (
        f"The energy of accelerations takes, relative to the kinetic energy, {parts[0]} and "
        f"{parts[1]} per evaluation on a cell."
    )


def _side(low: float, high: float, same: float) -> int:
    """1 for more, -1 for less, 0 where ratios between these bounds are inconclusive."""
    return 1 if low > 1.0 + same else -1 if high < 1.0 - same else 0


def _span(ratios: Mapping[str, float]) -> str:
    low, high = (f"{bound:.2f}" for bound in (min(ratios.values()), max(ratios.values())))
    return low if low == high else f"{low} to {high}"


def _where(sides: Mapping[str, int], *, timed: bool) -> str:
    """Return cases of more and of neither as text, unless it is the same side everywhere."""
    neither = "not told apart" if timed else "the same"
    if set(sides.values()) in ({1}, {-1}):
        return ""
    if set(sides.values()) == {0}:
        return f" ({neither})"
    more = [key for key, side in sides.items() if side > 0]
    even = [key for key, side in sides.items() if side == 0]
    parts = [f"more in {', '.join(more)}"] if more else []
    parts += [f"{neither} in {', '.join(even)}"] if even else []
    parts += ["less elsewhere"] if -1 in sides.values() else []
    return f" ({'; '.join(parts)})"


def _extremes(groups: Mapping[tuple[Any, ...], Mapping[str, Row]]) -> str:
    """Test the claims mechanism by mechanism."""
    claims = [
        ("Gibbs-Appell takes fewer operations than Lagrange", _fewer("gibbs_appell", "operations")),
        ("Maggi has no multipliers", _no_multipliers),
        ("Hamilton takes the most operations", _most("hamilton", "operations")),
        ("Hamilton has the most unknowns", _most("hamilton", "unknowns")),
        ("Hamilton takes the longest per step", _longest("hamilton")),
    ]
    verdicts = []
    for claim, test in claims:
        tested = {" ".join(key): test(group) for key, group in groups.items()}
        held = {key: value for key, value in tested.items() if value is not None}
        known = {key: value for key, value in held.items() if value != _OPEN}
        wrong = [key for key, value in known.items() if value == _WRONG]
        open_ = [key for key, value in held.items() if value == _OPEN]
        if not held:
            continue
        if not known:
            verdict = "is open"
        elif not wrong:
            verdict = "holds" if len(known) == 1 else f"holds in all {len(known)}"
        elif len(wrong) == len(known):
            verdict = "does not hold" if len(known) == 1 else f"holds in none of {len(known)}"
        else:
            verdict = f"holds except in {', '.join(wrong)}"
        if open_ and known:
            verdict += f" (open in {', '.join(open_)})"
        verdicts.append(f'"{claim}" {verdict}')
    return f"Claims: {'; '.join(verdicts)}."


#: Outcomes of a test: a claim is wrong, right, or open because repeats of a timing overlap.
_WRONG, _RIGHT, _OPEN = 0, 1, 2
Test = Callable[[Mapping[str, Row]], int | None]


def _fewer(formalism: str, quantity: str) -> Test:
    def test(group: Mapping[str, Row]) -> int | None:
        if not {formalism, "lagrange"} <= set(group):
            return None
        return int(group[formalism][quantity] < group["lagrange"][quantity])

    return test


def _most(formalism: str, quantity: str) -> Test:
    def test(group: Mapping[str, Row]) -> int | None:
        if formalism not in group or len(group) < 2:
            return None
        others = [row[quantity] for name, row in group.items() if name != formalism]
        return int(group[formalism][quantity] > max(others))

    return test


def _longest(formalism: str) -> Test:
    """Of times per step, by the quartiles of their ratios to Lagrange's."""

    def test(group: Mapping[str, Row]) -> int | None:
        if not {formalism, "lagrange"} <= set(group) or len(group) < 2:
            return None
        own = group[formalism]
        others = [row for name, row in group.items() if name != formalism]
        if own["step_ratio_low"] > max(row["step_ratio_high"] for row in others):
            return _RIGHT
        if own["step_ratio_high"] < max(row["step_ratio_low"] for row in others):
            return _WRONG
        return _OPEN

    return test


def _no_multipliers(group: Mapping[str, Row]) -> int | None:
    return int(group["maggi"]["multipliers"] == 0) if "maggi" in group else None
