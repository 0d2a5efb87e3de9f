# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tape spring, as of a measuring tape, is bent until it snaps and makes a fold.

Its ends are turned against its curvature. It is stiff at first: as a beam of its curved section.
Then the section flattens and snaps, and from there on the moment stays the same whatever the angle:
the fold takes the radius of the section, and its moment is (1 + nu) D times the section's angle
(Wuest 1954; Seffen, Pellegrino 1999, "Deployment dynamics of tape springs").

Run: ``python examples/tape_moment.py`` (two minutes), then ``flexfem view results/tape_moment``;
``--smoke`` for the stiffness at the start alone.
"""

import sys
from collections.abc import Callable

import numpy as np

import flexfem as ff

LENGTH, RADIUS, ANGLE, THICK = 0.20, 0.015, np.deg2rad(110.0), 1e-4  # m, m, rad, m
COPPER = ff.Material(youngs_modulus=131e9, poisson_ratio=0.3, density=8300.0)  # with beryllium
FOLDED, TIME = np.deg2rad(-120.0), 1.0  # angle between the ends, negative against the curvature; s
CENTRE = RADIUS * 2.0 * np.sin(0.5 * ANGLE) / ANGLE  # of the section from its circle's middle, m
X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def tape(points: np.ndarray) -> np.ndarray:
    """Places of points given by length and angle; the section's centre is the origin."""
    x, a = points.T
    return np.column_stack([x, RADIUS * np.sin(a), CENTRE - RADIUS * np.cos(a)])


def build(cells: tuple[int, int], angle: Callable[[float], float]) -> ff.Model:
    """The tape between two caps, one of which slides; each is turned by half of an angle (rad)."""
    u = np.linspace(-0.5, 0.5, cells[0] + 1) * LENGTH
    v = np.linspace(-0.5, 0.5, cells[1] + 1) * ANGLE
    model = ff.Model("tape_moment", surface=ff.SurfaceMesh.grid("tape", u, v, tape))
    section = ff.ShellSection.isotropic(THICK, COPPER)
    model.add(ff.Shell("tape", section, element="director", damping=3e-3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        place, cap = (-0.5 * sign * LENGTH, 0.0, 0.0), ff.Marker(side)
        model.add(
            ff.RigidBody(side, 0.01, (1e-6,) * 3, position=place,
                         shape=ff.Box((0.003, 0.028, 0.012))),
            ff.ClampedLine(f"{side} clamp", ff.ShellLine("tape", f"tape_{side}"), cap),
            ff.PrescribedRotation(f"{side} turn", ff.Ground(place), cap,
                                  rotation=lambda t, s=sign: (0.0, 0.5 * s * angle(t), 0.0)),
        )  # fmt: skip
    model.add(
        ff.Spherical("pin", ff.Ground((-0.5 * LENGTH, 0.0, 0.0)), ff.Marker("left")),
        ff.PointOnLine("slide", ff.Ground((0.5 * LENGTH, 0.0, 0.0)), ff.Marker("right"), axis=X),
        ff.ReactionProbe("turn", "left turn"),
    )
    return model


def stiffness() -> float:
    """Moment over angle (N m/rad) of a beam with the section of the tape."""
    share = 0.5 * (ANGLE + np.sin(ANGLE)) - 4.0 * np.sin(0.5 * ANGLE) ** 2 / ANGLE
    return float(COPPER.youngs_modulus * RADIUS**3 * THICK * share / LENGTH)


def steady_moment() -> float:
    """Moment (N m) of a fold against the curvature."""
    E, nu = COPPER.youngs_modulus, COPPER.poisson_ratio
    return float(E * THICK**3 / (12.0 * (1.0 - nu**2)) * ANGLE * (1.0 + nu))


def main(*, smoke: bool) -> None:
    """Stiffness; then bend it."""
    small = 1e-4
    options = ff.StaticOptions(linear=True, quiet=True)
    history = ff.solve_static(build((16, 6), lambda t: small * t), options).history
    found = history["turn_my"][-1] / small
    print(f"stiffness {found:.2f} N m/rad, of a beam {stiffness():.2f}")
    # cells are coarse, and the section gives way a little; that of a plate is a thousandth
    assert abs(found / stiffness() - 1.0) < 0.04
    if smoke:
        return
    options = ff.RunOptions(dt=4e-3, t_end=TIME, rho_inf=0.3, quiet=True, every=2,
                            output="results/tape_moment")  # fmt: skip
    history = ff.simulate(
        build((36, 6), ff.SmoothStep(0.0, TIME, 0.0, FOLDED)), options, case="tape_moment"
    ).history
    folded = -history["turn_my"][len(history["t"]) // 2 :]
    print(f"it snaps at {-history['turn_my'].min():.3f} N m; folded {folded.mean():.4f} N m, "
          f"in closed form {steady_moment():.4f}")  # fmt: skip
    # the slack of triangles; folded along its curvature it takes 54 % of it
    assert abs(folded.mean() / steady_moment() - 1.0) < 0.05


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
