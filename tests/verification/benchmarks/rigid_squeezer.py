# SPDX-License-Identifier: LGPL-3.0-or-later
"""Andrews' squeezer: seven bodies in the plane (Schiehlen 1990; Hairer, Wanner 1996, VII.7).

Two chains of bodies and one more body hang at the end of the coupler; a spring holds that body, a
constant moment drives the crank. Milliseconds, rates of a thousand rad/s.
"""

import math

import numpy as np

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "DAE at 1e-12"
BETA, THETA, GAMMA, PHI, DELTA, OMEGA, EPSILON = (
    -0.0617138900142764, 0.0, 0.455279819163070, 0.222668390165886, 0.487364979543843,
    -0.222668390165886, 1.23054744454982,
)  # fmt: skip
NAMES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
REFERENCE = {
    0.01: (2.160113131532, -1.883364231107, 0.158516758001, -0.328641075175, 0.525154774798,
           0.328641075175, 1.068427204632),
    0.02: (8.184905889662, -7.890505363730, 0.209536913385, -0.238325596596, 0.522536917156,
           0.238325596596, 1.086275108600),
    0.03: (15.81077119515, -15.75637105841, 0.04082224012, -0.53473011634, 0.52440996588,
           0.53473011634, 1.04808074104),
}  # fmt: skip
RATE = {0.01: (711.923153,), 0.02: (726.558343,), 0.03: (1139.920302,)}
MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
MOMENTS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
#: lengths and places of mass centres in the bodies' axes, from their first joint
RR, RA, D, DA, SS, SA, SB, SC, SD = (
    0.007,
    0.00092,
    0.028,
    0.0115,
    0.035,
    0.01874,
    0.01043,
    0.018,
    0.02,
)
E, EA, ZT, TA, TB = 0.02, 0.01421, 0.04, 0.02308, 0.00916
U, UA, UB, ZF, FA = 0.04, 0.01228, 0.00449, 0.02, 0.01421
SPRING, REST, MOMENT = 4530.0, 0.07785, 0.033


def _turn(angle: float) -> np.ndarray:
    """Rotation about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def build() -> ff.Model:
    """The mechanism at rest; all offsets are counted from the bodies' first joints."""
    model, axis = ff.Model("squeezer"), (0.0, 0.0, 1.0)
    zero = np.zeros(3)
    angles = (BETA, BETA + THETA, GAMMA, PHI + DELTA, DELTA, OMEGA + EPSILON, EPSILON)
    centres = ((RA, 0), (-DA, 0), (SA, 0), (0, EA - E), (TA, TB), (ZF - FA, 0), (UA, -UB))
    # the third body's own axes: x from B along ss, which gamma measures from -y
    centres = (*centres[:2], (SB, -SA), *centres[3:5], centres[5], centres[6])
    turns = [_turn(angle) for angle in angles]
    origin_a, origin_b = np.array([*A, 0.0]), np.array([*B, 0.0])
    pin_2 = turns[0] @ (RR, 0, 0)
    pin_4 = origin_a + turns[4] @ (ZT, 0, 0)
    pin_6 = origin_a + turns[6] @ (0, -U, 0)
    starts = (zero, pin_2, origin_b, pin_4, origin_a, pin_6, origin_a)
    for k in range(7):
        inertia = (MOMENTS[k], MOMENTS[k], MOMENTS[k])
        model.add(
            ff.RigidBody(
                f"k{k + 1}", MASSES[k], inertia, position=starts[k], rotation=turns[k],
                centre=(*centres[k], 0.0),
            )
        )  # fmt: skip
    parents = (
        ff.Ground(), ff.Marker("k1", offset=(RR, 0, 0)), ff.Ground(origin_b),
        ff.Marker("k5", offset=(ZT, 0, 0)), ff.Ground(origin_a),
        ff.Marker("k7", offset=(0, -U, 0)), ff.Ground(origin_a),
    )  # fmt: skip
    for k, parent in enumerate(parents):
        model.add(ff.Revolute(f"joint_{k + 1}", parent, ff.Marker(f"k{k + 1}"), axis=axis))
    # planar already: further revolutes would be redundant
    end = ff.Marker("k2", offset=(-D, 0, 0))
    for name, offset in (("k3", (0, -SS, 0)), ("k4", (0, -E, 0)), ("k6", (ZF, 0, 0))):
        model.add(ff.PointOnLine(f"end_{name}", end, ff.Marker(name, offset=offset), axis=axis))
    model.add(
        ff.SpringDamper("spring", ff.Ground((*C, 0.0)), ff.Marker("k3", offset=(SD, -SC, 0)),
                        stiffness=SPRING, rest_length=REST),
        ff.PointMoment("motor", ff.Marker("k1"), (0.0, 0.0, MOMENT)),
        ff.Probe(
            "angles", [ff.Marker(f"k{k}", rotation=turns[k - 1]) for k in range(1, 8)],
            [f"angle_{k}" for k in range(1, 8)],
            lambda t, *states: [math.atan2(s.rotation[1, 0], s.rotation[0, 0]) for s in states],
            unwrap=[f"angle_{k}" for k in range(1, 8)],
        ),
        ff.Probe("rate", ff.Marker("k1"), ("beta_rate",), lambda t, s: s.angular_velocity[2:]),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """The seven angles and the crank's rate."""
    h, end = (1e-5, 0.03) if full else (2e-5, 0.01)
    history = dict(run(build(), h, end, tolerance=1e-12))
    angle = [history[f"angle_{k}"] for k in range(1, 8)]
    values = (angle[0], angle[1] - angle[0], angle[2], angle[3] - angle[4], angle[4],
              angle[5] - angle[6], angle[6])  # fmt: skip
    history |= dict(zip(NAMES, values, strict=True))
    common = ("Andrews' squeezer", SOURCE, f"h = {h:g} s", history)
    rows = {t: v for t, v in REFERENCE.items() if t <= end + 1e-12}
    rates = {t: v for t, v in RATE.items() if t <= end + 1e-12}
    # of second order; another sign or place of a mass is off by tenths
    tolerance = 1e-4
    return [
        *compare(*common, NAMES, rows, tolerance, 1.0),
        *compare(*common, ("beta_rate",), rates, tolerance, 1000.0),
    ]
