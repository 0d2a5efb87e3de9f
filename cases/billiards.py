# SPDX-License-Identifier: LGPL-3.0-or-later
"""Break shot: a fast ball scatters a triangle of balls and a wall of boxes.

The cue ball flies along X at ``--speed`` 8 m/s into a triangle of ``--rows`` rows of homogeneous
balls (radius 28.575 mm, 0.17 kg), ``--spacing`` apart, past whose tip it aims by ``--offset``;
behind the triangle stand ``--boxes`` cubes side by side. All are free rigid bodies that touch one
another, frictionless and elastic unless ``--friction`` and ``--restitution`` say more. With
``--table`` they lie under gravity on the plane z = 0 between four cushions, without it they float
in space with their centres in that plane.

History: ``gap`` (m), the least one; of the contact ``contact_penetration`` (m), ``contact_fx,
contact_fy, contact_fz, contact_normal`` (N) and ``contact_closed``, the number of points within
reach; velocity of the cue ball ``cue_vx, cue_vy, cue_vz`` (m/s); momenta about the origin and
centre of mass of all ``momentum_px, momentum_py, momentum_pz, momentum_lx, momentum_ly,
momentum_lz, momentum_cx, momentum_cy, momentum_cz`` (kg m/s, kg m^2/s, m);
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J), the strain energy being that of contacts.

Expected: nothing overlaps, whatever the step. In space both momenta stay as they are
(``momentum_error``, over the cue ball's momentum; ``angular_momentum_error``, over that times the
depth of the triangle). Without friction and with a restitution of 1 the energy stays, too
(``energy_made``, its largest excess over the start's, and ``energy_lost``, what is missing at the
end, both over the start's kinetic energy). One ball that is hit in the middle (``--rows 1 --boxes
0``) takes over all of the cue ball's speed. Steps that are longer than an impact take those of
neighbours for one, which has many outcomes with the same energy and momenta: from two rows the cue
ball comes back with a fifth of its speed if one impact follows the other, which takes steps of
1e-6 s (-1.598 m/s instead of -1.6), and with up to 0.4 of it at larger ones.
Run: ``python cases/billiards.py``, then ``flexfem render results/billiards --view z``.
"""

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]
#: Ratio of height and side of a triangle with three equal sides.
HEIGHT = 0.5 * math.sqrt(3.0)


@dataclass(frozen=True)
class Numbers:
    """Balls, boxes and table: the options of these names."""

    rows: int
    boxes: int
    radius: float
    mass: float
    spacing: float
    box_side: float
    box_mass: float
    speed: float
    offset: float
    run_up: float
    table: bool
    table_length: float
    table_width: float

    @property
    def depth(self) -> float:
        """Of the triangle, between its front and its back, m."""
        return 2.0 * self.radius + HEIGHT * self.pitch * (self.rows - 1)

    @property
    def pitch(self) -> float:
        """Distance of the centres of neighbours, m."""
        return 2.0 * self.radius + self.spacing

    def balls(self) -> Iterator[ff.RigidBody]:
        """The cue ball, then the triangle row by row, whose tip is at the origin."""
        yield self.ball("cue", -self.pitch - self.run_up, self.offset, self.speed)
        for row in range(self.rows):
            for k in range(row + 1):
                x, y = HEIGHT * self.pitch * row, self.pitch * (k - 0.5 * row)
                yield self.ball(f"ball_{row + 1}_{k + 1}", x, y)

    def ball(self, name: str, x: float, y: float, speed: float = 0.0) -> ff.RigidBody:
        """One of the balls."""
        return ff.RigidBody(
            name, self.mass, (0.4 * self.mass * self.radius**2,) * 3,
            position=(x, y, self.above(self.radius)), velocity=(speed, 0.0, 0.0),
            shape=ff.Sphere(self.radius),
        )  # fmt: skip

    def cubes(self) -> Iterator[ff.RigidBody]:
        """The boxes behind the triangle."""
        half = 0.5 * self.box_side
        x = self.depth - self.radius + self.spacing + half
        for k in range(self.boxes):
            y = (self.box_side + self.spacing) * (k - 0.5 * (self.boxes - 1))
            yield ff.RigidBody(
                f"box_{k + 1}", self.box_mass, (self.box_mass * self.box_side**2 / 6.0,) * 3,
                position=(x, y, self.above(half)), shape=ff.Box((self.box_side,) * 3),
            )  # fmt: skip

    def above(self, half: float) -> float:
        """Height of the centre of a body of this half height, m."""
        return half + self.spacing if self.table else 0.0

    def planes(self) -> list[ff.RigidPlane]:
        """The bed of the table, and its cushions around the middle of the scene."""
        if not self.table:
            return []
        middle = np.array((0.5 * self.table_length - 2.0 * self.pitch - self.run_up, 0.0, 0.0))
        found = [ff.RigidPlane(ff.Ground())]
        for half, along in ((self.table_length, 0), (self.table_width, 1)):
            for sign in (-1.0, 1.0):
                inwards = -sign * np.eye(3)[along]
                across = np.eye(3)[1 - along]
                axes = np.column_stack([across, np.cross(inwards, across), inwards])
                found.append(ff.RigidPlane(ff.Ground(middle - 0.5 * half * inwards, axes)))
        return found


def build(
    *, gravity: float, friction: float, restitution: float, reach: float, **values: float
) -> ff.Model:
    """Model of the break; ``values`` are those of :class:`Numbers`."""
    numbers = Numbers(**values)  # type: ignore[arg-type]
    if reach > numbers.spacing:
        raise ValueError(
            f"the reach must be at most the spacing, {numbers.spacing:g} m, got {reach:g}"
        )
    model = ff.Model("billiards")
    model.add(*numbers.balls(), *numbers.cubes())
    if numbers.table:
        model.add(ff.Gravity((0.0, 0.0, -gravity)))
    model.add(
        ff.Contact(
            "bodies", surfaces=numbers.planes(), friction=friction, restitution=restitution,
            reach=reach,
        ),
        ff.ContactProbe("contact", "bodies", names={"gap": "gap"}),
        ff.Probe("cue_velocity", ff.Marker("cue"), ("cue_vx", "cue_vy", "cue_vz"),
                 lambda t, cue: cue.velocity.tolist()),
        ff.MomentumProbe("momentum"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(
    history: Mapping[str, Points], *, rows: int, radius: float, spacing: float, mass: float,
    speed: float,
) -> dict[str, float]:  # fmt: skip
    """Least gap, changes of energy and momenta, and how the cue ball leaves."""
    energy = sum(history[f"energy_{kind}"] for kind in ("kinetic", "strain", "gravity"))
    start = history["energy_kinetic"][0]
    depth = 2.0 * radius + HEIGHT * (2.0 * radius + spacing) * (rows - 1)
    return {
        "least_gap": float(history["gap"].min()),
        "energy_made": float((energy - energy[0]).max() / start),
        "energy_lost": float((energy[0] - energy[-1]) / start),
        "momentum_error": _change(history, "momentum_p") / (mass * speed),
        "angular_momentum_error": _change(history, "momentum_l") / (mass * speed * depth),
        **{f"last_cue_v{axis}": float(history[f"cue_v{axis}"][-1]) for axis in "xyz"},
    }


def _change(history: Mapping[str, Points], name: str) -> float:
    """Largest change of a vector since the start."""
    vector = np.column_stack([history[f"{name}{axis}"] for axis in "xyz"])
    return float(np.linalg.norm(vector - vector[0], axis=1).max())


CASE = ff.Case(
    name="billiards",
    summary="break shot of rigid balls and boxes: contact that keeps energy and momenta",
    description=__doc__,
    build=build,
    options=(
        ff.Option("rows", int, 5, "of the triangle of balls", minimum=1, maximum=40),
        ff.Option("boxes", int, 4, "behind the triangle", minimum=0, maximum=100),
        ff.Option("radius", float, 0.028575, "of a ball", unit="m", above=0.0),
        ff.Option("mass", float, 0.17, "of a ball", unit="kg", above=0.0),
        ff.Option("spacing", float, 1e-4, "between neighbours at the start", unit="m", above=0.0),
        ff.Option("box_side", float, 0.06, "of a box", unit="m", above=0.0),
        ff.Option("box_mass", float, 0.2, "of a box", unit="kg", above=0.0),
        ff.Option("speed", float, 8.0, "of the cue ball at the start", unit="m/s", above=0.0),
        ff.Option("offset", float, 0.0, "of the cue ball's path along Y", unit="m"),
        ff.Option("run_up", float, 0.05, "of the cue ball to the tip", unit="m", minimum=0.0),
        ff.Option("table", bool, False, "a table under the balls, and gravity"),
        ff.Option("table_length", float, 2.54, "between cushions", unit="m", above=0.0),
        ff.Option("table_width", float, 1.27, "between cushions", unit="m", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z, with a table", unit="m/s^2", above=0.0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("restitution", float, 1.0, "speed after over speed before", minimum=0.0,
                  maximum=1.0),
        ff.Option("reach", float, 5e-5, "gap below which bodies repel", unit="m", above=0.0),
    ),
    dt=1e-3,
    t_end=0.2,
    integrator="energy_momentum",
    rho_inf=1.0,
    tolerance=1e-10,
    every=2,
    smoke={"rows": 1, "boxes": 1, "run_up": 1e-4, "dt": 1e-4, "t_end": 5e-4},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
