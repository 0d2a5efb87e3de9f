# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic bodies made of particles: sums over them are what integrals over a body must give."""

import math
from dataclasses import dataclass
from itertools import permutations

import numpy as np

import flexfem as ff
from flexfem.families.floating.inertia import BodyData
from flexfem.lie import se3, so3


@dataclass
class ParticleBody:
    """Random particles and functions; ``interfaces`` relative ones, then ``modes`` amplitudes.

    ``places`` (p, 3) at rest, ``functions`` (p, 3, N), of which the last belong to quadratic
    coordinates with matrices ``bends`` (N - n, n, n).
    """

    rest: np.ndarray
    modes: int
    masses: np.ndarray
    places: np.ndarray
    functions: np.ndarray
    bends: np.ndarray
    data: BodyData

    @property
    def nodes(self) -> int:
        """Nodes without that of the frame."""
        return len(self.rest) + -(-self.modes // 3)


def symmetric(rng, size, order):
    """Random tensor that does not see the order of its indices."""
    tensor = rng.normal(size=(size,) * order)
    return sum(tensor.transpose(p) for p in permutations(range(order))) / math.factorial(order)


def polynomial(rng, size):
    """Random elastic forces of second and third order."""
    i, j = np.triu_indices(size)
    cubic = np.ascontiguousarray(0.3 * symmetric(rng, size, 4)[i, j][:, i, j])
    return {"quadratic": symmetric(rng, size, 3)[i, j], "cubic": cubic}


def particle_body(
    rng, interfaces=2, modes=4, *, stiffening=False, mean_axes=False, nonlinear=False, particles=20
):
    """A body of random particles."""
    n = (12 if nonlinear else 6) * interfaces + modes
    rest, places = rng.normal(size=(interfaces, 3)), rng.normal(size=(particles, 3))
    masses = rng.uniform(0.5, 1.5, particles)
    functions = rng.normal(size=(particles, 3, n))
    bends, pulling = np.zeros((0, n, n)), np.zeros((0, n))
    K, D = (X @ X.T for X in (rng.normal(size=(n, n)), 0.3 * rng.normal(size=(n, n))))
    if stiffening:
        bends = 0.3 * rng.normal(size=(12, n, n))
        bends += bends.swapaxes(1, 2)
        functions = np.concatenate([functions, rng.normal(size=(particles, 3, 12))], axis=2)
        pulling = 0.3 * rng.normal(size=(6 * interfaces, n, n))
        pulling = (pulling + pulling.swapaxes(1, 2)).reshape(-1, n)
    full = np.concatenate([places[:, :, np.newaxis], functions], axis=2)
    count = full.shape[2]
    conditions = np.zeros((0, n))
    if mean_axes:
        conditions = 0.2 * rng.normal(size=(6, n))
        for c in range(interfaces):
            conditions[:, 6 * c : 6 * c + 6] += np.eye(6)
    elastic = dict.fromkeys(("quadratic", "cubic"), np.zeros((0, 0)))
    if nonlinear:
        elastic = polynomial(rng, n)
    data = BodyData(
        rest=rest,
        mass=float(masses.sum()),
        moments=np.einsum("p,pai->ai", masses, full),
        products=np.einsum("p,pai,pbj->abij", masses, full, full).reshape(9 * count, count),
        stiffness=K,
        damping=D,
        bending=bends.reshape(-1, n),
        pulling=pulling,
        compliance=np.linalg.inv(K[: 6 * interfaces, : 6 * interfaces]),
        conditions=conditions,
        **elastic,
    )
    return ParticleBody(rest, modes, masses, places, functions, bends, data)


def state(rng, body, size=0.3):
    """Frames (n, 12), twists and their rates (n, 6) of frame, interfaces and amplitudes."""
    count = 1 + body.nodes
    frames, still = np.zeros((count, 12)), 1 + len(body.rest)
    frames[0] = se3.frame(rng.normal(size=3), so3.exp(rng.normal(size=3)))
    for c, place in enumerate(body.rest):
        off = se3.frame(place + size * rng.normal(size=3), so3.exp(size * rng.normal(size=3)))
        frames[1 + c] = se3.compose(frames[0], off)
    for a in range(still, count):
        frames[a] = se3.frame(size * rng.normal(size=3), np.eye(3))
    velocity, acceleration = rng.normal(size=(2, count, 6))
    velocity[still:, 3:] = acceleration[still:, 3:] = 0.0
    return frames, velocity, acceleration


def coordinates(body, frames):
    """Elastic coordinates of a body whose frame is the first of the frames.

    In a nonlinear body a region that turns by the vector t moves by ``a t x r + b/2 t x (t x r)``.
    """
    found, products = [], []
    for c, place in enumerate(body.rest):
        relative = se3.compose(se3.inverse(frames[0]), frames[1 + c])
        t = so3.log(se3.rotation(relative))
        if len(body.data.quadratic):
            angle = np.linalg.norm(t)
            both = 2.0 * (1.0 - np.cos(angle)) / angle**2 * np.outer(t, t)
            products.append(both[np.triu_indices(3)])
            t = np.sin(angle) / angle * t
        found += [se3.position(relative) - place, t]
    found.append(frames[1 + len(body.rest) :, :3].ravel()[: body.modes])
    return np.concatenate(found + products)


def positions(body, frames):
    """Particles (p, 3) in space."""
    eta = coordinates(body, frames)
    every = np.concatenate([eta, 0.5 * np.einsum("kij,i,j->k", body.bends, eta, eta)])
    local = body.places + body.functions @ every
    return se3.position(frames[0]) + local @ se3.rotation(frames[0]).T


def bar(ends=("left", "right"), *, length=1.0, side=0.02, modes=4, stiffening=False, cells=4):
    """Reduced data of an aluminium bar of square section along x from its first end."""
    from mpi4py import MPI

    section = ff.Section.rectangle(side, side, ff.Material(7e10, 0.3, 2700.0))
    line = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], cells + 1)
    body = ff.beam_body(line, section, orientation=(0.0, 1.0, 0.0), comm=MPI.COMM_SELF)
    places = {name: (x, 0.0, 0.0) for name, x in zip(ends, (0.0, length), strict=False)}
    return ff.reduce_body(body, places, modes=modes, geometric_stiffness=stiffening)
