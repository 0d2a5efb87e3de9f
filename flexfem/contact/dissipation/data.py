# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of laws, motions and groups of pairs that dissipate."""

import numpy as np

from flexfem.contact.primitives.data import Pairs
from flexfem.kernels.records import Float1D, Float2D, Int1D, Int2D, Record

__all__ = [
    "ACROSS",
    "ALONG",
    "ARMS",
    "FORCE",
    "FRICTION",
    "GROUP_FIELDS",
    "KNOWN",
    "LAST_FIELDS",
    "LAST_FORCE",
    "LAST_PUSH",
    "LAST_SLIP",
    "LAST_TANGENT",
    "NORMAL",
    "NORMAL_LAWS",
    "PUSH",
    "RATIO",
    "SIGMA",
    "SLIP",
    "TANGENT",
    "Groups",
    "Law",
    "StepMotion",
    "slow_speed",
]

#: Slow speed over that of a fall through the gap below which surfaces repel; without gravity, m/s.
_SLOW, _WEIGHTLESS = 5e-3, 1e-3

#: Unit vector from the second primitives to the first, 3 numbers.
NORMAL = 0
#: Normal force, N.
PUSH = 3
#: Vectors from the mean points of both sides to where friction acts, twice 3 numbers, m.
ARMS = 4
#: Direction of the slip and the one across it, unit vectors tangential to the surface, 3 numbers.
ALONG, ACROSS = 10, 13
#: Friction on the first primitive, 3 numbers, N.
FORCE = 16
#: Minus its derivative by the slip at a given normal force, 3 x 3 numbers, N/m.
TANGENT = 19
#: Friction over the normal force, 3 numbers.
RATIO = 28
#: Slip of the step and sigma, the one with the final slip rate, 3 numbers each, m.
SLIP, SIGMA = 31, 34
#: Numbers of a group.
GROUP_FIELDS = 37

# What the last trial state of a step has left for the next one.
#: 1 after one
KNOWN = 0
#: slip, friction over the normal force, and minus the derivative of friction
LAST_SLIP, LAST_FORCE, LAST_TANGENT = 1, 4, 7
#: separation, normal force and its slope, for the prediction of the normal force
LAST_PUSH = 16
LAST_FIELDS = 19

#: Places in the losses.
NORMAL_LAWS, FRICTION = 0, 1


class Law(Record):
    """Laws of dissipation of all pairs.

    Attributes:
        damping: Growth of the normal force with the speed of approach, s/m; 0 for none.
        friction: Coefficient of sliding friction; 0 for none.
        static_friction: That of bodies that are about to slide, not smaller.
        stribeck_speed: Speed of slip at which the difference of both has fallen to 1/e, m/s.
        slip_speed: Speed of slip from which on friction is that of Coulomb's law, m/s.
    """

    damping: float
    friction: float
    static_friction: float
    stribeck_speed: float
    slip_speed: float


def slow_speed(gravity: float, dhat: float) -> float:
    """Default of the slip speed, m/s.

    It is that of a fall through a given small part of the gap, so that the relative errors of
    models under gravity do not depend on their size.

    Args:
        gravity: acceleration, m/s^2; 0 for none.
        dhat: gap below which surfaces repel, m.
    """
    return _SLOW * float(np.sqrt(gravity * dhat)) if gravity > 0.0 else _WEIGHTLESS


class StepMotion(Record):
    """Motion of all points in a step.

    Attributes:
        before: Positions before it, shape (n, 3), metres.
        after: Positions after it, shape (n, 3), metres.
        spins: Rotation vectors of the step in inertial axes, zero where unknown, shape (n, 3), rad.
        rates: Velocities before it, shape (n, 3), m/s.
        spin_rates: Angular velocities before it, as ``spins``, shape (n, 3), rad/s.
        radius: Distance of the surface from the points, shape (n,), metres.
        dt: Size of the step, s.
    """

    before: Float2D
    after: Float2D
    spins: Float2D
    rates: Float2D
    spin_rates: Float2D
    radius: Float1D
    dt: float


class Groups(Record):
    """Groups of pairs that act, each with the points that it pushes.

    Attributes:
        count: Number of groups, shape (1,); they are the first rows of what follows.
        every: Number of each group among those of all pairs, shape (g,).
        rows: First row of each group in the response to the step, and the one after the last one,
            shape (g, 2).
        starts: First entry of each group, shape (g + 1,).
        sides: First entry of each group that belongs to the second primitives, shape (g,).
        points: Points of the entries, shape (e,).
        weights: Parts of the normal force on them: their sum is 1 on the first side and -1 on the
            second one, shape (e,).
        numbers: Normal, forces and tangent of each group, shape (g, GROUP_FIELDS).
        slopes: Stiffness of each group along the normal, along the slip and across it, not
            negative, shape (g, 3), N/m.
        last: Forces and slopes of all groups of pairs at the last trial state, shape
            (all, LAST_FIELDS).
        losses: Energy that normal laws and friction have dissipated in the step, shape (2,), J.
    """

    count: Int1D
    every: Int1D
    rows: Int2D
    starts: Int1D
    sides: Int1D
    points: Int1D
    weights: Float1D
    numbers: Float2D
    slopes: Float2D
    last: Float2D
    losses: Float1D

    @classmethod
    def of(cls, pairs: Pairs) -> "Groups":
        """Memory for the groups of pairs, in one step."""
        groups, entries = max(len(pairs.starts) - 1, 0), pairs.points.size
        return cls(
            count=np.zeros(1, np.int64), every=np.zeros(groups, np.int64),
            rows=np.zeros((groups, 2), np.int64),
            starts=np.zeros(groups + 1, np.int64),
            sides=np.zeros(groups, np.int64), points=np.zeros(entries, np.int64),
            weights=np.zeros(entries), numbers=np.zeros((groups, GROUP_FIELDS)),
            slopes=np.zeros((groups, 3)), last=np.zeros((groups, LAST_FIELDS)),
            losses=np.zeros(2),
        )  # fmt: skip

    def forget(self) -> None:
        """Begin another step with the same pairs, whose normal forces are those of the last one."""
        self.last[:, :LAST_PUSH] = 0.0
