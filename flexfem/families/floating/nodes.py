# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of the bodies in floating frames: their nodes numbered body after body."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.marker import Marker
from flexfem.core.runs import starts
from flexfem.families.floating.inertia import BodyData
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.lie import se3
from flexfem.model.bodies.floating_body import MEAN_AXES, FloatingBody

__all__ = ["FloatingNodes", "body_data"]


#: Extent of a body in a direction, over its largest extent, that counts as zero.
_FLAT = 1e-10


class FloatingNodes:
    """Nodes of all bodies in floating frames, the same on every rank.

    Attributes:
        bodies: the bodies in the model's order.
        first: (b + 1,) first node of each.
        frames, velocities: (n, 12) and (n, 6) of the nodes at the start.
        held: (n, 6) True for unknowns of a node that are no amplitudes, which are fixed.
        body_of_node: (n,).
    """

    def __init__(self, bodies: Sequence[FloatingBody]) -> None:
        """Number the nodes and place them."""
        self.bodies = list(bodies)
        self.first: IntArray = starts([body.nodes for body in bodies])
        count = int(self.first[-1])
        self.body_of_node: IntArray = np.repeat(np.arange(len(bodies)), np.diff(self.first))
        self.frames = np.tile(se3.frame(np.zeros(3), np.eye(3)), (count, 1))
        self.velocities = np.zeros((count, 6))
        self.held: BoolArray = np.zeros((count, 6), dtype=np.bool_)
        for first, body in zip(self.first[:-1].tolist(), bodies, strict=True):
            self._place(first, body)

    def _place(self, first: int, body: FloatingBody) -> None:
        """Frames and velocities of the nodes of a body."""
        R, places = body.rotation, body.places
        for i, place in enumerate(places):
            self.frames[first + i] = se3.frame(body.position + R @ place, R)
            spin = R.T @ body.angular_velocity
            self.velocities[first + i, :3] = R.T @ body.velocity + np.cross(spin, place)
            self.velocities[first + i, 3:] = spin
        held = self.held[first + len(places) : first + body.nodes]
        held[:, 3:] = True
        # the last node may have fewer amplitudes
        held[:, :3] = np.arange(3 * len(held)).reshape(-1, 3) >= body.reduced.modes

    @property
    def placed(self) -> FloatArray:
        """Frames (p, 12) at the start of the nodes that have a place in space."""
        frames: FloatArray = self.frames[~self.held[:, 3]]
        return frames

    @cached_property
    def locks(self) -> list[ElasticLock]:
        """Joints that constrain motions which the bodies' meshes cannot represent."""
        locks = []
        for body in self.bodies:
            held = body.reduced.held.reshape(-1, 6)
            for i in body.relative:
                locked = np.flatnonzero(held[i]).tolist()
                if locked:
                    name = body.reduced.interfaces[i].name
                    a, b = (Marker(body.name, p, rotation=body.rotation) for p in (None, name))
                    locks.append(ElasticLock(f"{body.name} {name}", a, b, locked))
        return locks

    @cached_property
    def kinds(self) -> list[list[int]]:
        """Numbers of the bodies that have the same integrals."""
        kinds: dict[tuple[int, str, bool], list[int]] = {}
        for number, body in enumerate(self.bodies):
            key = id(body.reduced), body.frame, body.stiffening
            kinds.setdefault(key, []).append(number)
        return list(kinds.values())


def body_data(body: FloatingBody) -> BodyData:
    """Integrals of a body about its frame, for its own elastic coordinates."""
    reduced, origin, own = body.reduced, body.origin, body.coordinates
    columns = np.concatenate([[0], 1 + own])
    moments, products = reduced.moments[:, columns], reduced.products[:, :, columns][..., columns]
    stiffness = _locked(body, reduced.stiffness[np.ix_(own, own)])
    damping = np.ascontiguousarray(reduced.damping[np.ix_(own, own)])
    elastic = {name: np.empty((0, 0)) for name in ("quadratic", "cubic")}
    if (polynomial := reduced.polynomial) is not None:
        elastic = {name: getattr(polynomial, name) for name in elastic}
        moments, products = polynomial.with_products(moments, products)
        stiffness = polynomial.stiffness
        damping = np.pad(damping, (0, len(stiffness) - len(damping)))
    products = products.copy()
    # positions count from the origin of the frame
    products[:, :, 0, :] -= origin[:, np.newaxis, np.newaxis] * moments
    moments[:, 0] -= reduced.mass * origin
    products[:, :, :, 0] -= moments[:, np.newaxis] * origin[:, np.newaxis]
    count = 6 * len(body.relative)
    n = len(stiffness)
    bending, pulling = np.empty((0, n)), np.empty((0, n))
    conditions = _conditions(body, moments, products)
    if body.stiffening:
        assert reduced.interface_stiffness is not None
        pulling = reduced.interface_stiffness[own[:count]][:, own][..., own]
        moments, products, bending = _second_order(body, moments, products)
    return BodyData(
        rest=body.places[-len(body.relative) :] - origin if count else np.empty((0, 3)),
        mass=reduced.mass,
        moments=np.ascontiguousarray(moments),
        products=np.ascontiguousarray(products.reshape(-1, moments.shape[1])),
        stiffness=stiffness,
        damping=damping,
        bending=np.ascontiguousarray(bending.reshape(-1, n)),
        pulling=np.ascontiguousarray(pulling.reshape(-1, n)),
        compliance=np.ascontiguousarray(np.linalg.pinv(stiffness[:count, :count], hermitian=True)),
        conditions=conditions,
        **elastic,
    )


def _second_order(
    body: FloatingBody, moments: FloatArray, products: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrals with the fields ``a + B r`` as further functions, and these by coordinates.

    Returns:
        Moments (3, n + 13), products (3, 3, n + 13, n + 13), and matrices Z (12, n, n).
    """
    reduced, own = body.reduced, body.coordinates
    assert reduced.acceleration_stiffness is not None
    work = reduced.acceleration_stiffness[:, own][..., own].copy()
    shift = np.einsum("b,aij->abij", body.origin, work[:3])
    work[3:] -= shift.reshape(work[3:].shape)
    # fields 1 and r_b, each along three axes: their products with all functions
    scalars = np.concatenate([moments[np.newaxis], products[:, :, 0]])  # (4, 3, n + 1)
    corner = np.zeros((4, 4))
    corner[0, 0], corner[0, 1:], corner[1:, 0] = reduced.mass, moments[:, 0], moments[:, 0]
    corner[1:, 1:] = products[:, :, 0, 0]
    # by component: fields of acceleration a + B r along axis a are four of the twelve
    by_axis = np.concatenate([work[:3, np.newaxis], work[3:].reshape(3, 3, *work.shape[1:])], 1)
    diagonal = np.diag(corner)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))  # a flat body has zero thickness
    inverse = np.linalg.pinv(corner / np.outer(scale, scale), rcond=_FLAT, hermitian=True)
    Z = np.einsum("qp,apij->aqij", inverse / np.outer(scale, scale), by_axis)
    n = moments.shape[1]
    wide, all_of = np.zeros((3, n + 12)), np.zeros((3, 3, n + 12, n + 12))
    wide[:, :n], all_of[:, :, :n, :n] = moments, products
    for a in range(3):
        rows = slice(n + 4 * a, n + 4 * a + 4)
        wide[a, rows] = corner[0]
        all_of[a, :, rows, :n] = scalars.transpose(1, 0, 2)
        all_of[:, a, :n, rows] = scalars.transpose(1, 2, 0)
        for b in range(3):
            all_of[a, b, rows, n + 4 * b : n + 4 * b + 4] = corner
    return wide, all_of, Z.reshape(12, *work.shape[1:])


def _locked(body: FloatingBody, stiffness: FloatArray) -> FloatArray:
    """The stiffness with entries for locked coordinates, without which it would be singular."""
    held = body.reduced.held.reshape(-1, 6)[body.relative].ravel()
    out = np.ascontiguousarray(stiffness)
    diagonal = np.diagonal(out)[: len(held)].reshape(-1, 6)
    for part in (slice(0, 3), slice(3, 6)):
        largest = float(diagonal[:, part].max(initial=0.0)) or 1.0
        for i in np.flatnonzero(held):
            if part.start <= i % 6 < part.stop:
                out[i, i] = largest
    return out


def _conditions(body: FloatingBody, moments: FloatArray, products: FloatArray) -> FloatArray:
    """Mean displacement and rotation of a body by its elastic coordinates, for mean axes."""
    n = moments.shape[1] - 1
    if body.frame != MEAN_AXES or not body.reduced.interfaces:
        return np.empty((0, n))
    second = products[:, :, 0, 0]
    inertia = np.trace(second) * np.eye(3) - second
    axes = ((1, 2), (2, 0), (0, 1))
    turns = np.array([products[a, b, 0, 1:] - products[b, a, 0, 1:] for a, b in axes])
    return np.concatenate([moments[:, 1:] / body.reduced.mass, np.linalg.solve(inertia, turns)])
