# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies, and groups of bodies, that nothing connects to the rest."""

from collections.abc import Iterator

import numpy as np

from flexfem.core.marker import Attachment, Ground, Marker
from flexfem.core.row import RowKind
from flexfem.inspection.finding import Finding, listed, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.mobility import part_rows
from flexfem.joints.force import Force
from flexfem.kinematics.start_rows import StartRows

_GROUND = -1
#: Part of a fall that joints feel which is none.
_ZERO = 1e-9
#: Functions of markers whose gradients turn as bodies fall.
_STRAIGHT = (RowKind.DISTANCE, RowKind.SPAN, RowKind.CATENARY)
#: Joints to the ground that are looked at before all joints are.
_FEW = 8


def find(inspection: Inspection) -> Iterator[Finding]:
    """Groups that float, but for that which is the model itself in free flight."""
    model, parts = inspection.model, inspection.parts
    groups = _groups(inspection)
    floating = [group for group in groups if _GROUND not in group]
    falls = model.gravity is not None and bool(model.gravity.acceleration.any())
    if len(groups) == 1 and floating:
        if falls and inspection.moves is not False:
            yield Finding(
                "unconnected", repr(model), "it is not connected to the ground and falls freely",
                "join it to Ground(), or leave gravity out",
            )  # fmt: skip
        return
    if falls and inspection.moves is not False:
        yield from _falling(inspection, [group for group in groups if _GROUND in group])
    if floating and len(floating) == len(groups):  # in free flight: the heaviest group is the model
        masses = np.trace(parts.inertia[:, :3, :3], axis1=1, axis2=2)
        floating.remove(max(floating, key=lambda group: float(masses[sorted(group)].sum())))
    for group in floating:
        names = [name for i in sorted(group) for name in parts.names[i]]
        where = listed([owner_of(model[name]) for name in names])
        what = "no joint, contact or fixed edge connects it to anything"
        if len(names) > 1:
            what = "no joint, contact or fixed edge connects them to the other bodies or the ground"
        hint = "add the missing joint, or add the body to a contact"
        yield Finding("unconnected", where, what, hint)


def _falling(inspection: Inspection, held: list[set[int]]) -> Iterator[Finding]:
    """The model, if joints tie it to the ground but none of them keeps it from falling.

    Forces, contacts and sliders may keep it: where there are some, nothing is reported.
    """
    model, rows = inspection.model, inspection.rows
    if len(held) != 1 or model.contacts or model.loads or not rows.rigid:
        return
    at_ground = [
        number
        for number, joint in enumerate(rows.joints)
        if any(isinstance(marker, Ground) for marker in joint.markers)
    ]
    # a few tell of most models that they are held; the rows of all joints take long
    few = StartRows(inspection.serial, inspection.parts, at_ground[:_FEW])
    if not (_holds(inspection, few) or _holds(inspection, rows)):
        yield Finding(
            "unconnected", repr(model), "it falls freely: no joint to the ground supports it",
            "join it to Ground() at its supports, or leave gravity out",
        )  # fmt: skip


def _holds(inspection: Inspection, joints: StartRows) -> bool:
    """True if joints or supports resist a fall of all parts together, without rotation.

    At its start, or later: distances to the ground across the fall, such as a pendulum's that is
    let go from the side, resist once bodies have fallen.
    """
    to_ground = (joints.rows.term_nodes < 0).any(axis=1)
    if np.isin(joints.rows.kinds[to_ground], _STRAIGHT).any():
        return True
    gravity = inspection.model.gravity
    assert gravity is not None
    table = part_rows(inspection, joints, joints.rows.rigid)
    down = np.asarray(gravity.acceleration) / np.linalg.norm(gravity.acceleration)
    # gradients are with respect to twists in the axes of the parts
    turns = inspection.parts.frames[:, 3:].reshape(-1, 3, 3)
    ways = np.concatenate([np.einsum("nij,i->nj", turns, down), np.zeros((1, 3))])
    drops = np.zeros(int(table.row.max(initial=-1)) + 1)
    np.add.at(drops, table.row, np.einsum("tsi,tsi->t", table.gradient[..., :3], ways[table.nodes]))
    return bool(np.abs(drops).max(initial=0.0) >= _ZERO)


def _groups(inspection: Inspection) -> list[set[int]]:
    """Connected parts, by number; -1 is the ground."""
    model = inspection.model
    group_of = {part: {part} for part in (_GROUND, *range(len(inspection.parts)))}
    # groups in the order of their last joints, the ground only if something is joined to it
    groups = {id(group): group for part, group in group_of.items() if part != _GROUND}

    def join(ends: set[int]) -> None:
        met = {id(group_of[end]): group_of[end] for end in ends}
        largest = max(met.values(), key=len)
        for group in met.values():
            groups.pop(id(group), None)
            if group is not largest:
                largest |= group
                group_of.update(dict.fromkeys(group, largest))
        groups[id(largest)] = largest

    for joint in model.joints:
        # a force may act from the ground, as on feet and wheels
        outside = {_GROUND} if isinstance(joint, Force) else set[int]()
        join({_end(inspection, marker) for marker in joint.markers} | outside)
    for contact in model.contacts:
        bodies, against = contact.members(model)
        named = {inspection.parts.number[name] for name in (*bodies, *against)}
        join(named | {_end(inspection, surface.place) for surface in contact.surfaces})
    for part in np.unique(inspection.rows.supports().nodes[:, 0]):
        join({int(part), _GROUND})
    return list(groups.values())


def _end(inspection: Inspection, marker: Attachment) -> int:
    """Part that carries a marker."""
    if isinstance(marker, Ground):
        return _GROUND
    assert isinstance(marker, Marker)
    return inspection.parts.number[marker.body]
