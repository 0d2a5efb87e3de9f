# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rubber bushing between two rigid rings, turned and moved.

A tube of neo-Hookean rubber, shear modulus 1 MPa and nearly incompressible, from ``--inner-radius``
10 mm to ``--outer-radius`` 25 mm and ``--length`` 40 mm, is bonded to a rigid ring outside, which
is fixed, and to one inside. That one turns about the axis Z by ``--turn`` 40 degrees, and moves
along it by ``--axial`` and across it by ``--radial``, all in proportion to the load factor t.
Curved hexahedra of second order whose change of volume is linear.

History: ``turn`` (deg), ``axial``, ``radial`` (m) of the inner ring; force
``force_fx, force_fy, force_fz`` (N) that moves it, with ``force_mx, force_my, force_mz`` (N m), and
moment ``moment_mx, moment_my, moment_mz`` (N m) that turns it, with ``moment_fx, moment_fy,
moment_fz`` (N); ``mid_turn`` (deg), by which the rubber half way between the rings has turned;
``volume_J``, present over initial volume of the rubber.

Expected: a long bushing of incompressible rubber turns with the moment
4 pi mu length turn/(1/inner^2 - 1/outer^2), whatever the turn, and half way by the part
(1/a^2 - 1/r^2)/(1/a^2 - 1/b^2) less; it moves along its axis with the force
2 pi mu length axial/ln(outer/inner). ``results`` has these beside those found: 42.4 N m for
41.8 N m. Run:
``python cases/rubber_bushing.py``, then ``flexfem render results/rubber_bushing``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Values = npt.NDArray[np.float64]


def build(
    *, refine: int, inner_radius: float, outer_radius: float, length: float, shear_modulus: float,
    bulk_modulus: float, density: float, ring_mass: float, turn: float, axial: float,
    radial: float,
) -> ff.Model:  # fmt: skip
    """Model of the bushing, moved so far at t = 1."""
    mesh = ff.build_body_mesh(
        "bushing", inner_radius=inner_radius, outer_radius=outer_radius, length=length,
        cells_around=8 * 2**refine, cells_across=2 * 2**refine, cells_along=2 * 2**refine,
    )  # fmt: skip
    rubber = ff.Solid(
        "rubber", ff.laws.NeoHookean(shear_modulus, bulk_modulus), mesh, density=density,
        formulation="dilatation", fixed={"outer": "xyz"},
    )  # fmt: skip
    inertia = 0.5 * ring_mass * inner_radius**2
    ring = ff.Marker("ring")
    half = 0.5 * (inner_radius + outer_radius)

    def motion(t: float, at: ff.MarkerState, middle: ff.MarkerState) -> tuple[float, ...]:
        angles = (math.atan2(y, x) for x, y in (at.turn[:2, 0], middle.position[:2]))
        own, mid = (math.degrees(angle) for angle in angles)
        return own, float(at.position[2]), float(at.position[0]), mid

    model = ff.Model("rubber_bushing")
    model.add(
        rubber,
        ff.RigidBody("ring", ring_mass, (inertia, inertia, inertia)),
        ff.RigidPoints("bond", ring, nodes=rubber.node_markers("inner")),
        ff.PrescribedTranslation("move", ff.Ground(), ring, lambda t: (radial * t, 0.0, axial * t)),
        ff.PrescribedRotation("turn", ff.Ground(), ring, lambda t: (0, 0, math.radians(turn) * t)),
        ff.Probe(
            "motion",
            [ring, ff.Marker("rubber", (half, 0.0, 0.0))],
            ("turn", "axial", "radial", "mid_turn"),
            motion,
        ),
        ff.ReactionProbe("force", "move"),
        ff.ReactionProbe("moment", "turn"),
        ff.SolidProbe("volume", "rubber", measures=("J",)),
    )
    return model


def results(
    history: Mapping[str, Values], *, inner_radius: float, outer_radius: float, length: float,
    shear_modulus: float, turn: float, axial: float,
) -> dict[str, float]:  # fmt: skip
    """Moment and force at the end beside those of a long bushing."""
    last = {name: float(values[-1]) for name, values in history.items()}
    a, b = inner_radius, outer_radius
    across, half = a**-2 - b**-2, 0.5 * (a + b)
    angle = math.radians(turn) * last["t"]
    moment = 4.0 * math.pi * shear_modulus * length * angle / across
    force = 2.0 * math.pi * shear_modulus * length * axial * last["t"] / math.log(b / a)
    return {
        "moment": last["moment_mz"],
        "expected_moment": moment,
        "force": last["force_fz"],
        "expected_force": force,
        "mid_turn": last["mid_turn"],
        "expected_mid_turn": math.degrees(angle) * (half**-2 - b**-2) / across,
    }


CASE = ff.Case(
    name="rubber_bushing",
    summary="rubber bushing between rigid rings, turned and moved: moments and forces",
    description=__doc__,
    build=build,
    options=(
        ff.Option("refine", int, 0, "level of the mesh", minimum=0, maximum=4),
        ff.Option("inner_radius", float, 0.01, "of the rubber", unit="m", above=0.0),
        ff.Option("outer_radius", float, 0.025, "of the rubber", unit="m", above=0.0),
        ff.Option("length", float, 0.04, "of the rubber", unit="m", above=0.0),
        ff.Option("shear_modulus", float, 1e6, "of the rubber", unit="N/m^2", above=0.0),
        ff.Option("bulk_modulus", float, 1e9, "of the rubber", unit="N/m^2", above=0.0),
        ff.Option("density", float, 1100.0, "of the rubber", unit="kg/m^3", above=0.0),
        ff.Option("ring_mass", float, 0.1, "of the inner ring", unit="kg", above=0.0),
        ff.Option("turn", float, 40.0, "of the inner ring about its axis", unit="deg"),
        ff.Option("axial", float, 0.0, "motion of the inner ring along its axis", unit="m"),
        ff.Option("radial", float, 0.0, "motion of the inner ring across its axis", unit="m"),
    ),
    analysis=ff.STATICS,
    load_steps=5,
    smoke={"load_steps": 1, "t_end": 0.1},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
