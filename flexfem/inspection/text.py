# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summaries of models and findings as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem._memory import available, shown
from flexfem._types import FloatArray
from flexfem.inspection.body_facts import BodyFacts, MassFacts
from flexfem.inspection.finding import Finding, listed, owner_of
from flexfem.inspection.joint_facts import ROLES, JointFacts
from flexfem.inspection.model_facts import ModelFacts
from flexfem.model.bodies.basic import Beam

if TYPE_CHECKING:
    from flexfem.core.load import Load
    from flexfem.model.contact import Contact
    from flexfem.model.model import Model

__all__ = ["description_text", "findings_text"]

#: Rows shown of each kind before the rest is counted only.
_ROWS = 8
#: Products of inertia relative to the largest moment below which they are none.
_ROUND_OFF = 1e-9
#: Headings of the joints by their function.
_HEADINGS = {
    "joints": "joints",
    "drives": "drives",
    "forces": "springs, stops, friction and actuators",
    "locks": "locks of bodies that move in one plane only",
}


def description_text(description: ModelFacts) -> str:
    """The table of a summary."""
    model = description.model
    lines = [repr(model)]
    gravity = "none" if model.gravity is None else f"{_vector(model.gravity.acceleration)} m/s^2"
    lines += [f"  gravity {gravity}", *_bodies(description), *_joints(description.joints)]
    for title, things in (
        ("loads", [(load, _where(load)) for load in model.loads]),
        ("contacts", [(c, _touching(model, c)) for c in model.contacts]),
        ("events", [(event, listed(list(event.joints))) for event in model.events]),
        ("probes", [(probe, listed(list(probe.columns))) for probe in model.probes]),
    ):
        rows = [[thing.name, type(thing).__name__, text] for thing, text in things]
        lines += _section(f"{title}: {len(rows)}", rows) if rows else []
    return "\n".join([*lines, *_mobility(description), *_sizes(description)])


def findings_text(findings: Sequence[Finding]) -> str:
    """The section "warnings"."""
    if not findings:
        return "warnings: none"
    lines = [f"warnings: {len(findings)}"]
    for finding in findings:
        lines += [f"  [{finding.check}] {finding.where}: {finding.what}", f"      {finding.hint}"]
    return "\n".join(lines)


def _bodies(description: ModelFacts) -> list[str]:
    """A table of the bodies, then all together."""
    facts = description.bodies
    counts = Counter(one.kind for one in facts)
    told = ", ".join(_plural(count, name) for name, count in counts.items())
    header = [
        "name", "kind", "mass kg", "mass centre m", "inertia about it kg m^2", "size m",
        "elements", "DOFs",
    ]  # fmt: skip
    rows: list[list[str]] = []
    for name in counts:
        own = [one for one in facts if one.kind == name]
        shown = own if len(own) <= _ROWS + 1 else own[:_ROWS]
        rows += [_body_row(one, description.extent) for one in shown]
        if len(shown) < len(own):
            rows.append([f"... and {len(own) - len(shown)} more"])
    whole = description.total
    return [
        f"bodies: {told}",
        *_aligned([header, *rows]),
        f"  together {_number(whole.mass)} kg, "
        f"mass centre {_vector(whole.centre, description.extent)} m, "
        f"inertia about it {_inertia(whole)} kg m^2",
    ]


def _body_row(facts: BodyFacts, extent: float) -> list[str]:
    kind = facts.kind
    if isinstance(facts.body, Beam):
        kind += f", {facts.body.formulation}"
    size = " x ".join(_number(value) for value in _cleaned(facts.size))
    return [
        facts.name, kind, _number(facts.masses.mass), _vector(facts.masses.centre, extent),
        _inertia(facts.masses), size if facts.size.any() else "-",
        str(facts.elements or "-"), str(facts.degrees_of_freedom) if facts.unknowns else "-",
    ]  # fmt: skip


def _joints(facts: Sequence[JointFacts]) -> list[str]:
    """Tables of joints, drives and forces."""
    lines = []
    for role in ROLES:
        own = [one for one in facts if one.role == role]
        if not own:
            continue
        count = sum(one.constraints for one in own)
        holds = f", {_plural(count, 'constraint')}" if count else ""
        rows = [[one.name, one.kind, _ends(one.ends), _row_counts(one)] for one in own]
        lines += _section(f"{_HEADINGS[role]}: {len(own)}{holds}", rows)
    return lines


def _row_counts(facts: JointFacts) -> str:
    """Constraints, force laws and open rows of a joint."""
    told = [
        (facts.constraints, "constraint"), (facts.laws, "force law"), (facts.open, "open row"),
    ]  # fmt: skip
    return ", ".join(_plural(count, name) for count, name in told if count) or "nothing"


def _ends(ends: Sequence[str]) -> str:
    return " - ".join(ends) if len(ends) <= 3 else f"{ends[0]} - {listed(ends[1:])}"


def _where(load: Load) -> str:
    """Return a load's place and size, and whether it changes, as text."""
    places = [str(place) for place in (*load.markers, *load.beams, *load.shells)]
    units = ("N", "N m") if load.markers else ("", "")
    sizes = ["varies along it"] if not load.uniform else [
        f"{_vector(part)} {unit}"
        for part, unit in zip(load.wrench, units, strict=True)
        if np.any(part)
    ]  # fmt: skip
    more = ["times a function of time"] if load.amplitude is not None else []
    follows = ["following"] if load.follower else []
    return ", ".join([listed(places), *(size.strip() for size in sizes), *follows, *more])


def _touching(model: Model, contact: Contact) -> str:
    """Return the bodies and surfaces of a contact as text."""
    bodies, against = contact.members(model)
    others = [*against, *(type(surface).__name__ for surface in contact.surfaces)]
    return f"{listed(bodies)} - {listed(others)}"


def _mobility(description: ModelFacts) -> list[str]:
    """Counts of degrees of freedom and constraints."""
    counts = description.mobility
    fixed = f", {counts.fixed} of them fixed" if counts.fixed else ""
    redundant = f", {counts.redundant} of them redundant" if counts.redundant else ""
    supports = f" - {counts.supports}" if counts.supports else ""
    return [
        "degrees of freedom",
        *_aligned(
            [
                ["unknowns", f"{counts.unknowns}{fixed}"],
                ["constraints", f"{counts.constraints}{redundant}"],
                ["degrees of freedom left", str(counts.degrees_of_freedom)],
                [
                    "motions of rigid-body parts",
                    f"{counts.motions} by the rank of their constraints, "
                    f"6 x {counts.bodies}{supports} - {counts.whole_constraints} = "
                    f"{counts.grubler} by counting (Gruebler)",
                ],
            ]
        ),
    ]


def _sizes(description: ModelFacts) -> list[str]:
    """Lengths of elements, slenderness, the matrix."""
    rows = [["characteristic length", f"{_number(description.extent)} m"]]
    meshes = description.meshes
    if meshes:
        small = min(meshes, key=lambda one: float(one.lengths.min()))
        large = max(meshes, key=lambda one: float(one.longest.max()))
        rows += [
            ["shortest element or edge", _length(small.lengths.min(), small.body)],
            ["longest element or edge", _length(large.longest.max(), large.body)],
        ]
    known = [one for one in meshes if np.isfinite(one.slenderness)]
    if known:
        thin = max(known, key=lambda one: one.slenderness)
        rows.append([
            "largest slenderness",
            f"{_number(thin.slenderness)}: {_number(thin.length)} m by {_number(thin.depth)} m, "
            f"{owner_of(thin.body)}",
        ])  # fmt: skip
    size = description.matrix_bytes / 1e6
    more = ", more with contact" if description.model.contacts else ""
    rows.append(
        ["matrix of a step", f"about {description.entries} entries, {_number(size)} MB{more}"]
    )
    room = available()
    left = f", {shown(room)} are left" if np.isfinite(room) else ""
    rows.append(["memory of a run", f"about {shown(description.memory)} on one rank{left}"])
    return ["sizes", *_aligned(rows)]


def _section(title: str, rows: Sequence[Sequence[str]]) -> list[str]:
    """A heading and rows, long lists shortened."""
    shown = rows if len(rows) <= _ROWS + 1 else rows[:_ROWS]
    lines = [title, *_aligned(shown)]
    if len(shown) < len(rows):
        lines.append(f"  ... and {len(rows) - len(shown)} more")
    return lines


def _aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows with columns of common widths."""
    table = [list(row) for row in rows]
    whole = [row for row in table if len(row) > 1]
    columns = max((len(row) for row in whole), default=1)
    widths = [max((len(row[k]) for row in whole), default=0) for k in range(columns)]
    return [
        "  " + "  ".join(text.ljust(w) for text, w in zip(row, widths, strict=False)).rstrip()
        for row in table
    ]


def _length(value: float, body: Any) -> str:
    return f"{_number(value)} m, {owner_of(body)}"


def _plural(count: int, name: str) -> str:
    if count == 1:
        return f"1 {name}"
    ending = "es" if name.endswith("s") else "s"
    return f"{count} {name[:-1]}ies" if name.endswith("y") else f"{count} {name}{ending}"


def _inertia(masses: MassFacts) -> str:
    """Moments xx, yy, zz, and products xy, xz, yz where there are some."""
    J = masses.inertia
    moments = _vector(np.diag(J))
    products = J[[0, 0, 1], [1, 2, 2]]
    if np.abs(products).max() <= _ROUND_OFF * np.abs(J).max(initial=0.0):
        return moments
    return f"{moments}, xy xz yz {_vector(products)}"


def _cleaned(values: FloatArray, size: float = 0.0) -> FloatArray:
    """Values without those that are round-off of the largest, or of a size."""
    largest = np.abs(values).max(initial=size)
    cleaned: FloatArray = np.where(np.abs(values) <= 1e-12 * largest, 0.0, values)
    return cleaned


def _vector(values: FloatArray, size: float = 0.0) -> str:
    return "(" + ", ".join(_number(value) for value in _cleaned(np.asarray(values), size)) + ")"


def _number(value: float) -> str:
    return f"{value:.5g}"
