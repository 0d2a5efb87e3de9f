# SPDX-License-Identifier: LGPL-3.0-or-later
"""Heavy top (Brüls, Cardona, Arnold 2012): states and the force of the joint."""

import numpy as np

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "DOP853 at 1e-13"
COLUMNS = ("x_x", "x_y", "x_z", "spin_1", "spin_2", "spin_3", "f_fx", "f_fy", "f_fz")
REFERENCE = {
    "fast": {
        0.1: (0.4212966589, 0.8945719743, -0.1491647006, 4.808941332, 150.0, 1.028300757,
              -361.05600479, -295.39317301, -212.26717186),
        0.5: (-0.7024682971, -0.0211651847, -0.7114002577, -0.471053102, 150.0, 5.901083048,
              523.28124351, 404.20617832, 357.33617645),
        1.0: (0.1733439641, 0.6400885921, -0.7484907911, -0.822078102, 150.0, -5.923291348,
              -517.60073948, -396.84310149, 404.57492516),
    },
    "slow": {
        0.1: (0.0045378449, 0.9988233717, -0.0482833319, -0.94848463, 1.5, -0.187754929,
              -0.76407164, -20.99241218, 3.24828972),
        0.5: (0.0072227982, 0.4058422986, -0.9139145802, -3.083040202, 1.5, -2.85519452,
              -5.77817749, -161.18447551, 365.33436996),
        1.0: (-0.0311686471, -0.9833836814, -0.1788436484, -0.196690095, 1.5, -1.848884067,
              1.13777283, 76.52117875, 16.14589544),
        2.0: (0.0496286282, 0.7581235028, -0.6502197734, -3.490612978, 1.5, 0.615464727,
              -11.57985858, -214.45759595, 186.04085125),
    },
}  # fmt: skip
SPIN = {"fast": (0.0, 150.0, -4.61538), "slow": (0.0, 1.5, -0.0461538)}


def build(spin: str) -> ff.Model:
    """The top in its benchmark data."""
    centre, omega = np.array([0.0, 1.0, 0.0]), np.array(SPIN[spin])
    model = ff.Model("heavy_top")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("top", 15.0, (0.234375, 0.46875, 0.234375), position=centre,
                     velocity=np.cross(omega, centre), angular_velocity=omega),
        ff.Spherical("tip", ff.Ground(), ff.Marker("top", offset=-centre)),
        ff.PositionProbe("x", ff.Marker("top")),
        ff.Probe("spin", ff.Marker("top"), ("spin_1", "spin_2", "spin_3"),
                 lambda t, s: s.rotation.T @ s.angular_velocity),
        ff.ReactionProbe("f", "tip"),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Centre, angular velocity in body axes, and the force on the body."""
    found = []
    for spin in ("fast", "slow"):
        # known errors of the scheme at h = 5e-4: fast 0.013 m, 0.15 rad/s, 14 N of 660 N; slow
        # 1e-6 m. A reaction of the wrong sign or of another instant is off by its own size
        h = {"fast": 1e-4 if full else 5e-4, "slow": 1e-3}[spin]
        tolerance = {"fast": 3e-3 if full else 4e-2, "slow": 2e-4}[spin]
        rows = {t: v for t, v in REFERENCE[spin].items() if full or t <= 0.5}
        history = run(build(spin), h, max(rows))
        for part, scale in ((slice(0, 3), 1.0), (slice(3, 6), 6.0), (slice(6, 9), 650.0)):
            chosen = {t: v[part] for t, v in rows.items()}
            found += compare(
                f"heavy top, {spin}", SOURCE, f"h = {h:g} s", history, COLUMNS[part], chosen,
                tolerance, scale,
            )  # fmt: skip
    return found
