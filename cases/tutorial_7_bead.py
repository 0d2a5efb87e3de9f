# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 7: a bead on a wire, options of your own, parallel runs and restarts.

A steel wire (diameter ``--diameter``, E = 2.1e11 N/m^2, nu = 0.3, rho = 7850 kg/m^3) runs from the
top of a helix of 0.3 m radius down to its foot, or along ``--shape line`` straight, and is clamped
at both ends. A bead of 0.5 kg starts at rest near the top and slides down with friction until an
event ends the run where it arrives.

History: ``path_x``, ``path_y``, ``path_z`` (m) of the bead; ``way`` (m), the arc length along the
wire; ``speed`` (m/s) along it.

Expected: the bead arrives after 1.936 s on the helix, with 2.49 m/s.
Run: ``mpirun -n 2 python cases/tutorial_7_bead.py --checkpoint-every 200``.
"""

import math
import sys

import flexfem as ff


def build(
    *, shape: str, elements: int, radius: float, height: float, diameter: float,
    youngs_modulus: float, poisson_ratio: float, density: float, mass: float, friction: float,
    gravity: float,
) -> ff.Model:  # fmt: skip
    """Model with a wire of this shape and so many cubic elements."""
    wire = _wire(shape, elements, radius, height)
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    slide = ff.Sliding("slide", ff.Carrier("wire"), ff.Marker("bead"))
    slider = ff.SlidingMarker("slide")

    model = ff.Model("tutorial_7_bead")
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Beam("wire", ff.Section.circle(diameter, steel), curve=wire),
        ff.RigidBody("bead", mass, (4e-4 * mass,) * 3,
                     position=wire.position(wire.parameter_at(0.02)), shape=ff.Sphere(0.03)),
        ff.Rigid("top", ff.Ground(wire.position(0.0)), ff.Marker("wire", "start")),
        ff.Rigid("foot", ff.Ground(wire.position(1.0)), ff.Marker("wire", "end")),
        slide,
        ff.JointFriction("rubbing", slide, coefficient=friction),
    )  # fmt: skip

    # the run ends one centimetre before the foot
    arrival = wire.length - 0.01
    model.add(
        ff.Event("arrival", slider, lambda t, at: at.arc - arrival, ff.Stop(), direction=1),
        ff.PositionProbe("path", ff.Marker("bead")),
        ff.Probe("place", slider, ("way", "speed"), lambda t, at: (at.arc, at.arc_rate)),
    )
    return model


def _wire(shape: str, elements: int, radius: float, height: float) -> ff.NurbsCurve:
    """Curve from the top to the foot."""
    top = (radius, 0.0, height)
    if shape == "line":
        return ff.NurbsCurve.line(top, (-radius, 0.0, 0.0), degree=3, elements=elements)
    angle = 3.0 * math.pi
    pitch = -height / (angle / (2.0 * math.pi))
    return ff.NurbsCurve.helix(
        (0.0, 0.0, height), top, (0.0, 0.0, 1.0), angle, pitch, elements=elements
    )


CASE = ff.Case(
    name="tutorial_7_bead",
    summary="tutorial 7: a bead on a wire; options, presets, ranks and restarts",
    description=__doc__,
    build=build,
    options=(
        ff.Option("shape", str, "helix", "of the wire", choices=("helix", "line")),
        ff.Option("elements", int, 32, "cubic elements of the wire", minimum=2),
        ff.Option("radius", float, 0.3, "of the helix", unit="m", above=0.0),
        ff.Option("height", float, 0.8, "of its top", unit="m", above=0.0),
        ff.Option("diameter", float, 0.012, "of the wire", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the wire", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the wire", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the wire", unit="kg/m^3", above=0.0),
        ff.Option("mass", float, 0.5, "of the bead", unit="kg", above=0.0),
        ff.Option("friction", float, 0.1, "Coulomb's coefficient", minimum=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2", above=0.0),
    ),
    dt=2e-3,
    t_end=4.0,
    presets={"shape": {"line": {"elements": 6, "dt": 1e-3}}},
    smoke={"shape": "line", "elements": 3, "t_end": 6e-3},
    results=lambda history: {
        "last_way": float(history["way"][-1]),
        "largest_speed": float(history["speed"].max()),
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
