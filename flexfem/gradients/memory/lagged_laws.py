# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of friction and damping of contacts by the penalty, and of what they remember.

A contact that is closed at the start of a step acts in it with 13 numbers of that state: its normal
force N, normal n, tangential force t, weights of the triangle's nodes or place on the rigid surface
e, and the distance r from there to its node. With the slip ``d = P(q1, e) - r`` its force is F(d,
n, N, t), see ``contact.law.friction``, and ``J^T F`` acts on points and surface, where J is the
derivative of P.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.frames import SurfaceFrames
from flexfem.contact.law.closed_contacts import MOST_CLOSED, ClosedContacts
from flexfem.contact.law.data import BEND, DISTANCE, FIRST, NORMAL, SLOPE, TURN
from flexfem.contact.obstacles.contacts import Lagged
from flexfem.contact.obstacles.rigid_surface import RigidContact
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.lie import so3

__all__ = ["COUNT", "Made", "Remembered", "numbers_of", "remembered"]

#: Numbers of each contact, and which of them are which.
COUNT = 13
_PUSH, _NORMAL, _PULL, _PLACE, _START = (
    np.s_[:1], np.s_[1:4], np.s_[4:7], np.s_[7:10], np.s_[10:13]
)  # fmt: skip

#: Contacts with triangles or with a rigid surface.
Made = TriangleContact | RigidContact


@dataclass(frozen=True)
class _Acting:
    """Contacts in a step.

    Attributes:
        slots: (c,) places of their numbers.
        points: (c, p) rows of their points.
        by_slip: (c, 3, m) derivatives of the slips by the motion, J.
        forces: (c, 3, 13) of the forces by the numbers.
        loads: (c, m, 13) of ``J^T F`` by these.
        by_force: (c, 3, 3) of the forces by the slips.
    """

    slots: IntArray
    points: IntArray
    by_slip: FloatArray
    forces: FloatArray
    loads: FloatArray
    by_force: FloatArray


@dataclass(frozen=True)
class _Next:
    """Contacts that act in the next step.

    Attributes:
        slots: (c,) places of their numbers.
        points: (c, p) rows of their points.
        motion: (c, 13, m) derivatives of the numbers by the motion.
        origins: (k,) those of the step before that give tangential forces to some, ``heirs`` (k,).
        by_motion, by_numbers: (k, 3, m), (k, 3, 13) of these by the former ones.
    """

    slots: IntArray
    points: IntArray
    motion: FloatArray
    heirs: IntArray
    origins: IntArray
    by_motion: FloatArray
    by_numbers: FloatArray


@dataclass(frozen=True)
class Remembered:
    """The contacts with one surface over a step.

    Attributes:
        acting: those that act.
        after: those that act in the next one.
    """

    acting: _Acting
    after: _Next


def numbers_of(made: Made, closed: ClosedContacts, lagged: Lagged) -> FloatArray:
    """Numbers (slaves times MOST_CLOSED, 13) of closed contacts, zero where there is none."""
    found = np.zeros((MOST_CLOSED * len(made.slaves.nodes), COUNT))
    places = lagged.places[:, -3:]  # the weight of the slave is one
    found[_slots(closed.slaves)] = np.concatenate(
        [closed.pushes[:, np.newaxis], closed.normals, closed.pulls, places, lagged.start], axis=1
    )
    return found


def remembered(
    made: Made, points: FloatArray, frames: SurfaceFrames, surface: int | None
) -> Remembered:
    """Derivatives at a trial state, at which contacts have been evaluated."""
    closed, frame = made.closed, None if surface is None else frames.frames[surface]
    acting = _acting(closed, made.lagged.nodes, *_slips(made.lagged, points, frame))
    after, lagged = made.following(points)
    motion = _of_geometry(made, _slips(lagged, points, frame)[0], points[lagged.nodes], frame)
    return Remembered(acting, _next(closed, after, acting, lagged.nodes, motion))


def _slots(slaves: IntArray) -> IntArray:
    """Places of the numbers of contacts that ascend by slave."""
    first = np.searchsorted(slaves, slaves)
    slots: IntArray = MOST_CLOSED * slaves + np.arange(len(slaves)) - first
    return slots


def _slips(
    lagged: Lagged, points: FloatArray, frame: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (c, 3, m) and (c, 3, 3) of P by the motion and by e."""
    nodes, places, _ = lagged
    if frame is None:
        J = np.einsum("ck,ab->cakb", places, np.eye(3)).reshape(len(nodes), 3, 12)
        return J, points[nodes[:, 1:]].swapaxes(1, 2)
    R, J = frame[3:].reshape(3, 3), np.zeros((len(nodes), 3, 9))
    J[:, :, :3], J[:, :, 3:6], J[:, :, 6:] = np.eye(3), -R, R @ so3.skew(places)
    return J, np.broadcast_to(-R, (len(nodes), 3, 3))


def _acting(
    closed: ClosedContacts, points: IntArray, J: FloatArray, by_place: FloatArray
) -> _Acting:
    """Derivatives of the forces of contacts."""
    by_force, forces = closed.tangents, _by_numbers(closed)
    forces[:, :, _PLACE] = by_force @ by_place
    forces[:, :, _START] = -by_force
    loads = J.swapaxes(1, 2) @ forces
    if J.shape[2] == 12:  # weights of the triangle's nodes
        for k in range(3):
            loads[:, 3 + 3 * k : 6 + 3 * k, 7 + k] += closed.forces
    else:  # moments about the surface's origin
        loads[:, 6:, _PLACE] += so3.skew(np.einsum("cab,ca->cb", -J[:, :, 3:6], closed.forces))
    return _Acting(_slots(closed.slaves), points, J, forces, loads, by_force)


def _by_numbers(closed: ClosedContacts) -> FloatArray:
    """Derivatives (c, 3, 13) of forces by normal forces, normals and tangential forces."""
    n, d, eye = closed.normals, closed.slips, np.eye(3)
    friction, stick, viscous = closed.numbers
    sticking, damping = stick * closed.stiffness, viscous * closed.stiffness
    along, limit = np.einsum("ca,ca->c", n, d), friction * closed.pushes
    t = closed.pulls + sticking[:, np.newaxis] * (d - along[:, np.newaxis] * n)
    size = np.linalg.norm(t, axis=1)
    slides = size > limit
    u = t / np.where(size > 0.0, size, 1.0)[:, np.newaxis]
    # d(d - n n.d) by n
    turned = -along[:, np.newaxis, np.newaxis] * eye - np.einsum("ca,cb->cab", n, d)
    cut = np.where(slides, limit / np.where(size > 0.0, size, 1.0), 1.0)[:, np.newaxis, np.newaxis]
    by_pull = cut * (eye - slides[:, np.newaxis, np.newaxis] * np.einsum("ca,cb->cab", u, u))
    found = np.zeros((len(n), 3, COUNT))
    found[:, :, _PULL] = by_pull
    found[:, :, _NORMAL] = sticking[:, np.newaxis, np.newaxis] * (by_pull @ turned)
    found[:, :, 0] = np.where(slides, friction, 0.0)[:, np.newaxis] * u
    damped = damping * along < closed.pushes
    own = np.where(damped, damping, 0.0)[:, np.newaxis, np.newaxis]
    size_of = np.where(damped, damping * along, closed.pushes)[:, np.newaxis, np.newaxis]
    found[:, :, _NORMAL] += own * np.einsum("ca,cb->cab", n, d) + size_of * eye
    found[:, :, 0] += np.where(damped, 0.0, 1.0)[:, np.newaxis] * n
    return found


def _of_geometry(
    made: Made, J: FloatArray, at: FloatArray, frame: FloatArray | None
) -> FloatArray:  # fmt: skip
    """Derivatives (c, 13, m) of numbers by the motion, without tangential forces.

    Args:
        made: contacts, evaluated.
        J: (c, 3, m) derivatives of P.
        at: (c, p, 3) points.
        frame: of the rigid surface, None for triangles.
    """
    c = made.contacts
    n, e = c[:, NORMAL : NORMAL + 3], c[:, FIRST : FIRST + 6].reshape(-1, 2, 3)
    bend, found = c[:, BEND : BEND + 2], np.zeros((len(c), COUNT, J.shape[2]))
    stiffness = made.slaves.stiffness[made.ends[:, 0]] * c[:, SLOPE]
    if frame is not None:
        R = frame[3:].reshape(3, 3)
        y = R.T @ J  # motion of the node in the axes of the surface
        turned = np.einsum("cd,cda,cdb->cab", bend, e, e) @ y
        turned[:, :, 6:] -= so3.skew(n)
        found[:, _NORMAL], found[:, _PLACE] = R @ turned, y
        found[:, 0] = -stiffness[:, np.newaxis] * np.einsum("ca,cam->cm", n, y)
        return found
    s = c[:, DISTANCE]
    across = np.einsum("cda,cam->cdm", e, J)  # A of contact.law.penalty, and B
    turns = np.zeros((len(c), 2, 12))
    turn = c[:, TURN : TURN + 6].reshape(-1, 2, 3)
    turns[:, :, 3:] = np.einsum("cdk,ca->cdka", turn, n).reshape(-1, 2, 9)
    found[:, 0] = -stiffness[:, np.newaxis] * np.einsum("ca,cam->cm", n, J)
    found[:, _NORMAL] = np.einsum("cda,cdm->cam", e, bend[:, :, np.newaxis] * across - turns)
    moved = across + s[:, np.newaxis, np.newaxis] * turns
    found[:, _PLACE] = -np.einsum("cdk,cdm->ckm", turn, moved)
    found[:, _START] = J + np.einsum("cka,ckm->cam", at[:, 1:], found[:, _PLACE])
    return found


def _next(
    closed: ClosedContacts, after: ClosedContacts, acting: _Acting, points: IntArray,
    motion: FloatArray,
) -> _Next:  # fmt: skip
    """Contacts that act in the next step, with the tangential forces that they take over."""
    heirs = np.flatnonzero(after.origins >= 0)
    origins, n1 = after.origins[heirs], after.normals[heirs]
    n0, F, eye = closed.normals[origins], closed.forces[origins], np.eye(3)
    plane = eye - np.einsum("ca,cb->cab", n0, n0)
    q = np.einsum("cab,cb->ca", plane, F)
    by_numbers = plane @ acting.forces[origins]
    along = np.einsum("ca,ca->c", n0, F)[:, np.newaxis, np.newaxis]
    by_numbers[:, :, _NORMAL] -= along * eye + np.einsum("ca,cb->cab", n0, F)
    by_motion = plane @ acting.by_force[origins] @ acting.by_slip[origins]
    # turned into the new plane, with the same size
    out = np.einsum("ca,ca->c", n1, q)
    p = q - out[:, np.newaxis] * n1
    sizes = np.linalg.norm(q, axis=1), np.linalg.norm(p, axis=1)
    some = sizes[1] > 0.0
    ratio = np.divide(*sizes, out=np.ones(len(p)), where=some)[:, np.newaxis, np.newaxis]
    v = p / np.where(some, sizes[1], 1.0)[:, np.newaxis]
    w = q / np.where(some, sizes[0], 1.0)[:, np.newaxis]
    outer = np.einsum("ca,cb->cab", v, v)
    by_p = ratio * (eye - outer)
    by_q = by_p @ (eye - np.einsum("ca,cb->cab", n1, n1)) + np.einsum("ca,cb->cab", v, w)
    by_q = np.where(some[:, np.newaxis, np.newaxis], by_q, eye)
    by_n1 = -by_p @ (out[:, np.newaxis, np.newaxis] * eye + np.einsum("ca,cb->cab", n1, q))
    motion[heirs, _PULL] += by_n1 @ motion[heirs, _NORMAL]
    return _Next(
        _slots(after.slaves), points, motion, heirs, origins, by_q @ by_motion, by_q @ by_numbers
    )
