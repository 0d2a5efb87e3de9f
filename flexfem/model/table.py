# SPDX-License-Identifier: LGPL-3.0-or-later
"""A model as text."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell
from flexfem.model.contact import Contact
from flexfem.model.controller import Controller
from flexfem.model.modal_damping import ModalDamping
from flexfem.model.probes.base import AnyProbe
from flexfem.model.structure.structure import Structure

# Rows shown of each kind before the rest is counted only
_MAX_ROWS = 8


def model_table(model: Structure) -> str:
    """Return the contents of a model as a table: one line per object, long lists shortened."""
    lines = [repr(model)]
    if model.mesh is not None:
        lines.append(f"  {model.mesh}")
    if model.surface is not None:
        lines.append(f"  {model.surface}")
    if model.gravity is not None:
        lines.append(f"  Gravity: {_numbers(model.gravity.acceleration)} m/s^2")
    for title, things in (
        ("beams", model.beams),
        ("shells", model.shells),
        ("rigid bodies", model.rigid_bodies),
        ("floating bodies", model.floating_bodies),
        ("other bodies", model.other_bodies),
        ("point masses", model.point_masses),
        ("joints", model.joints),
        ("contacts", model.of(Contact)),
        ("damping of modes", model.of(ModalDamping)),
        ("loads", model.loads),
        ("probes", model.of(AnyProbe)),
        ("controllers", model.of(Controller)),
    ):
        lines.extend(_rows(model, title, things))
    return "\n".join(lines)


def _rows(model: Structure, title: str, things: Iterable[Any]) -> list[str]:
    """Return heading and rows of one kind of object, nothing when there are none."""
    items = list(things)
    if not items:
        return []
    shown = items if len(items) <= _MAX_ROWS + 1 else items[:_MAX_ROWS]
    width = max(len(thing.name) for thing in shown)
    kinds = max(len(type(thing).__name__) for thing in shown)
    lines = [f"  {title}: {len(items)}"]
    lines += [
        f"    {thing.name:<{width}}  {type(thing).__name__:<{kinds}}  {_details(model, thing)}"
        for thing in shown
    ]
    if len(shown) < len(items):
        lines.append(f"    ... and {len(items) - len(shown)} more")
    return [line.rstrip() for line in lines]


def _details(model: Structure, thing: Any) -> str:
    """Return the most telling values of an object."""
    if isinstance(thing, Shell):
        return _shell(model, thing)
    if isinstance(thing, Beam) and thing.varies:
        return f"{_line(model, thing)}, section varies"
    if hasattr(thing, "a"):
        return f"{thing.a} - {thing.b}"
    if hasattr(thing, "section"):
        return f"{_line(model, thing)}, {thing.section.mass_per_length:.4g} kg/m"
    if isinstance(thing, Body):
        return thing.details
    if isinstance(thing, Contact):
        bodies, against = thing.members(model)
        surfaces = [type(surface).__name__ for surface in thing.surfaces]
        return f"{', '.join(bodies)} - {', '.join([*against, *surfaces])}"
    if isinstance(thing, ModalDamping):
        return f"{thing.count} modes"
    if isinstance(thing, Controller):
        return f"{', '.join(thing.inputs)} -> {', '.join(thing.outputs)}"
    if hasattr(thing, "columns"):
        return ", ".join(thing.columns)
    if hasattr(thing, "mass"):
        place = thing.marker if hasattr(thing, "marker") else f"at {_numbers(thing.position)}"
        return f"{thing.mass:.4g} kg, {place}"
    return ", ".join(str(place) for place in (*thing.markers, *thing.beams, *thing.shells))


def _shell(model: Structure, shell: Shell) -> str:
    """Return what a shell is made of."""
    rows = () if model.surface is None else model.surface.bodies.get(shell.body, ())
    section = shell.section
    edges = "".join(f', {rule} "{line}"' for line, rule in shell.edges.items())
    return (
        f'body "{shell.body}", {len(rows)} triangles, {section.thickness:.4g} m, '
        f"{section.mass:.4g} kg/m^2{edges}"
    )


def _line(model: Structure, beam: Any) -> str:
    """Return the line or curve of a beam."""
    if beam.curve is not None:
        return f"curve of degree {beam.curve.degree}, {len(beam.curve.elements.nodes)} elements"
    groups = {} if model.mesh is None else model.mesh.line_groups
    text = f'group "{beam.group}", {len(groups.get(beam.group, ()))} cells'
    return text if beam.degree is None else f"{text}, nurbs of degree {beam.degree}"


def _numbers(values: np.typing.NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
