# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a whole model: that names exist and that the parts fit together."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem.core.joint import Joint
from flexfem.core.marker import (
    Carrier,
    Ground,
    Marker,
    Observed,
    ShellLine,
    SlidingMarker,
    SurfaceMarker,
)
from flexfem.mesh.line_mesh import LineMesh, frames_of_lines, section_frames
from flexfem.mesh.nurbs.frames import control_rotations
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.contact import Contact
from flexfem.model.controller import Controller
from flexfem.model.event import Event
from flexfem.model.load_checks import check_load
from flexfem.model.modal_damping import ModalDamping
from flexfem.model.probes.base import AnyProbe
from flexfem.model.structure.place import Place
from flexfem.model.structure.structure import Structure


def validate(model: Structure) -> None:
    """Check a model.

    Raises:
        TypeError: An orientation function returns something else than numbers.
        ValueError: The first mistake found, in one line naming object and value.
    """
    if not model.bodies:
        raise ValueError(f"{model!r}: it has no bodies")
    if model.beams:
        _check_beams(model)
    if model.shells or model.surface is not None:
        _check_shells(model)
    nodes = _check_markers(model)
    for joint in model.joints:
        for pair in joint.pairs:
            _check_ends(joint, pair, nodes)
        if joint.partner is not None and joint.partner not in model.joints:
            raise ValueError(f'{_owner(joint)}: {model!r} has no joint "{joint.partner.name}"')
    for load in model.loads:
        check_load(model, load)
    for event in model.of(Event):
        for name in event.joints:
            _check_joint(model, _owner(event), name)
        for name in event.awaits:
            if not isinstance(model.get(name), Event):
                raise ValueError(f'{_owner(event)}: stops after "{name}", which is no event')
    for name in model.released:
        _check_joint(model, f"{model!r}: release", name)
    for contact in model.of(Contact):
        contact.check(model)
    for probe in model.of(AnyProbe):
        probe.check(model)
    for controller in model.of(Controller):
        controller.check(model)
    for damping in model.of(ModalDamping):
        damping.check(model)
    _check_columns(model)


def _check_joint(model: Structure, owner: str, name: str) -> None:
    """Check that there is a joint of a name, which may be open or closed."""
    if not isinstance(model.get(name), Joint):
        raise ValueError(f'{owner}: {model!r} has no joint "{name}"')


def _owner(thing: Any) -> str:
    return f'{type(thing).__name__} "{thing.name}"'


def _check_beams(model: Structure) -> None:
    """Check groups and orientations of all beams."""
    mesh, users = model.mesh, dict[str, Beam]()
    right = _have_frames(model)
    for beam in model.beams:
        try:
            if beam.group is not None:
                _check_group(model, beam, users)
            if beam.formulation == "nurbs":
                control_rotations(model.curve(beam), beam.orientation)
            elif mesh is not None and beam.orientation is not None and not right:
                section_frames(mesh.points, mesh.group_cells(str(beam.group)), beam.orientation)
        except (TypeError, ValueError) as error:
            message = str(error).removeprefix(f"{_owner(beam)}: ")
            raise type(error)(f"{_owner(beam)}: {message}") from None
    if mesh is not None:
        _check_ownership(model, mesh)


def _have_frames(model: Structure) -> bool:
    """True if no orientation of a beam of the mesh is wrong, all tested at once."""
    mesh = model.mesh
    if mesh is None:
        return False
    beams = [
        beam for beam in model.beams
        if beam.formulation != "nurbs" and beam.orientation is not None
    ]  # fmt: skip
    try:
        lines = [mesh.group_cells(str(beam.group)) for beam in beams]
        frames_of_lines(mesh.points, lines, [beam.orientation for beam in beams])
    except (TypeError, ValueError):
        return False
    return True


def _check_shells(model: Structure) -> None:
    """Check that every body of the surface mesh is that of one shell."""
    if model.surface is None:
        raise ValueError(f"{model!r} has shells but no mesh, give Model(surface=...)")
    users: dict[str, Shell] = {}
    first = model.shells[0] if model.shells else None
    for shell in model.shells:
        if first is not None and shell.element != first.element:
            raise ValueError(
                f'{_owner(shell)}: element "{shell.element}", but {_owner(first)} has '
                f'"{first.element}": all shells of a model have the same'
            )
        if shell.body not in model.surface.bodies:
            known = _checks.show(", ".join(model.surface.bodies), 200)
            raise ValueError(
                f'{_owner(shell)}: the surface mesh has no body "{shell.body}", it has {known}'
            )
        if shell.body in users:
            raise ValueError(
                f'{_owner(shell)}: body "{shell.body}" is used already by '
                f"{_owner(users[shell.body])}"
            )
        users[shell.body] = shell
    for body in model.surface.bodies:
        if body not in users:
            raise ValueError(f'{model!r}: body "{body}" of the surface mesh belongs to no shell')


def _check_group(model: Structure, beam: Beam, users: dict[str, Beam]) -> None:
    """Check that the group of a beam is in the mesh and its own."""
    assert beam.group is not None
    if model.mesh is None:
        raise ValueError(f"{model!r} has beams but no mesh, give Model(mesh=...)")
    if beam.group in users:
        raise ValueError(f'group "{beam.group}" is used already by {_owner(users[beam.group])}')
    users[beam.group] = beam
    model.mesh.group_cells(beam.group)


def _check_ownership(model: Structure, mesh: LineMesh) -> None:
    """Check that every cell belongs to one beam and that beams share no nodes."""
    rows = np.concatenate([model.beam_cells(beam) for beam in model.beams])
    beams = np.repeat(
        np.arange(len(model.beams)), [len(model.beam_cells(beam)) for beam in model.beams]
    )
    counts = np.bincount(rows, minlength=len(mesh.cells))
    if (counts > 1).any():
        cell = int(np.argmax(counts > 1))
        first, second = beams[rows == cell][:2]
        raise ValueError(
            f"{_owner(model.beams[second])}: cell {cell} belongs to "
            f"{_owner(model.beams[first])} as well"
        )
    if (counts == 0).any():
        cell = int(np.argmax(counts == 0))
        names = [name for name, members in mesh.line_groups.items() if cell in members]
        raise ValueError(
            f"{model!r}: {int((counts == 0).sum())} cells of the mesh belong to no beam, the first "
            f"is cell {cell} of {names or 'no group'}"
        )
    low = np.full(len(mesh.points), len(model.beams))
    high = np.full(len(mesh.points), -1)
    for side in (0, 1):
        np.minimum.at(low, mesh.cells[rows, side], beams)
        np.maximum.at(high, mesh.cells[rows, side], beams)
    if (low < high).any():
        node = int(np.argmax(low < high))
        raise ValueError(
            f"{_owner(model.beams[high[node]])}: node {node} at "
            f"{_checks.show(mesh.points[node].tolist())} is shared with "
            f"{_owner(model.beams[low[node]])}; bodies keep separate nodes and meet in joints"
        )


def _marked(model: Structure) -> Iterator[tuple[Any, Observed]]:
    """Yield every marker in the model with the object that has it."""
    for joint in model.joints:
        for marker in joint.markers:
            yield joint, marker
    for mass in model.point_masses:
        yield mass, mass.marker
    for load in model.loads:
        for marker in load.markers:
            yield load, marker
    for probe in model.of(AnyProbe):
        for place in probe.markers:
            yield probe, place
    for event in model.of(Event):
        for place in event.markers:
            yield event, place


def _check_markers(model: Structure) -> dict[int, Place | None]:
    """Check that all markers exist, and return their places by the markers' identities."""
    nodes: dict[int, Place | None] = {}
    for thing, marker in _marked(model):
        if id(marker) not in nodes:
            try:
                _check_line(model, thing, marker)
                nodes[id(marker)] = model.marker_place(marker)
            except ValueError as error:
                raise ValueError(f"{_owner(thing)}: {error}") from None
    return nodes


def _check_line(model: Structure, thing: Any, marker: Observed) -> None:
    """Check lines: that a carrier is a beam, the joint of a slider one, a row that of a shell."""
    if isinstance(marker, SlidingMarker):
        joint = model.get(marker.joint)
        if not isinstance(joint, Joint) or not isinstance(joint.a, Carrier):
            raise ValueError(f'{model!r} has no sliding joint "{marker.joint}"')
    elif isinstance(marker, Carrier):
        if not (isinstance(thing, Joint) and thing.slides):
            raise ValueError(f'a Carrier ("{marker.body}") is for sliding joints only')
        _check_carrier(model, marker)
    elif isinstance(marker, ShellLine):
        if not (isinstance(thing, Joint) and thing.joins_lines):
            raise ValueError(f'a ShellLine ("{marker}") is for joints of lines only')
        model.node_row(marker)
    elif isinstance(marker, SurfaceMarker):
        if not isinstance(thing, Joint):
            raise ValueError(f'a SurfaceMarker ("{marker}") is for joints only')
        _check_surface(model, marker)


def _check_carrier(model: Structure, carrier: Carrier) -> None:
    """Check that a carrier is a line of its body."""
    body, owner = model.get(carrier.body), f'Carrier on "{carrier.body}"'
    if isinstance(body, Beam):
        if carrier.line is not None:
            raise ValueError(f"{owner}: a beam has one line, give none")
    elif isinstance(body, RigidBody):
        if carrier.line is None or isinstance(carrier.line, str):
            raise ValueError(f"{owner}: give points of the line in the axes of the rigid body")
    elif isinstance(body, FloatingBody):
        known = body.reduced.lines
        if not isinstance(carrier.line, str) or carrier.line not in known:
            names = ", ".join(known) or "none, reduce the body with lines={...}"
            raise ValueError(f"{owner}: line must name one of the reduced body, which has {names}")
        if not body.has_frame_node:
            raise ValueError(
                f"{owner}: mean axes carry no lines, take an interface as frame of the body"
            )
    else:
        raise ValueError(f'{model!r} has no beam or body with lines "{carrier.body}"')


def _check_surface(model: Structure, marker: SurfaceMarker) -> None:
    """Check that the nodes of a place are those of a triangle of its shell."""
    shell = model.get(marker.body)
    if isinstance(shell, Body):
        count = len(shell.points)
        if max(marker.nodes) >= count:
            raise ValueError(
                f'SurfaceMarker on "{marker.body}": node {max(marker.nodes)}, it has {count} nodes'
            )
        return
    if not isinstance(shell, Shell) or model.surface is None:
        raise ValueError(f'SurfaceMarker: {model!r} has no shell "{marker.body}"')
    triangles = model.surface.triangles[model.surface.bodies[shell.body]]
    if not (np.isin(triangles, marker.nodes).sum(axis=1) == len(marker.nodes)).any():
        raise ValueError(
            f'SurfaceMarker on "{marker.body}": it has no triangle with the nodes '
            f"{_checks.show(marker.nodes)}"
        )


def _check_ends(joint: Joint, pair: tuple[int, int], nodes: dict[int, Place | None]) -> None:
    """Check that a joint connects two frames that can move relative to one another."""
    (first, a), (second, b) = (joint.places[number] for number in pair)
    both = "both markers" if len(joint.places) == 2 else f"{first} and {second}"
    if isinstance(a, Ground) and isinstance(b, Ground):
        raise ValueError(f"{_owner(joint)}: {both} are on the ground")
    if any(isinstance(marker, (ShellLine, SurfaceMarker)) for marker in (a, b)):
        return  # they may be on one shell
    if (
        isinstance(a, Marker)
        and isinstance(b, Marker)
        and a.body == b.body
        and nodes[id(a)] == nodes[id(b)]
    ):
        node = nodes[id(a)]
        place = f'"{a.body}"' if node is None else f'{node} of "{a.body}"'
        raise ValueError(f"{_owner(joint)}: {both} are fixed to {place}")


def _check_columns(model: Structure) -> None:
    """Check that all columns of the history have different names."""
    users: dict[str, Any] = {}
    recorded: list[AnyProbe | Controller] = [*model.of(AnyProbe), *model.of(Controller)]
    for probe in recorded:
        for column in probe.columns:
            if column in users:
                raise ValueError(
                    f'{_owner(probe)}: column "{column}" is used already by {_owner(users[column])}'
                )
            users[column] = probe
