# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deep circular arch, clamped and hinged, under a load at its apex (DaDeppo, Schmidt 1975).

Arch of radius 100 over 215 degrees in the plane XY about the origin, clamped at the right support
and hinged at the left one; EI = 1e6, EA = GA = 1e8, any consistent units; a dead load along -Y at
the apex. The load factor t counts in units of ``--load``, 1000. The arch leans over before it
collapses: the path is followed by arc length, beyond the limit point to a displacement of 120.

History: ``down``, ``aside``: displacement of the apex; ``force``: the load there.

Expected: limit load 897.287 at ``down`` = 113.734 and ``aside`` = 61.146 (solution of the rod's
differential equations; DaDeppo and Schmidt without shear and extension: 897). Run:
``mpirun -n 2 python cases/deep_arch.py``.
"""

import sys

import flexfem as ff


def build(
    *, elements: int, radius: float, angle: float, axial_stiffness: float, bending_stiffness: float,
    load: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements, an even number."""
    if elements % 2:
        raise ValueError(f"deep_arch: elements must be even, got {elements}")
    mesh = ff.build_mesh(
        "arc", radius=radius, angle=angle, first=450.0 - 0.5 * angle, elements=elements
    )
    section = ff.Section.general((axial_stiffness,) * 3 + (bending_stiffness,) * 3, (1.0,) * 6)
    model = ff.Model("deep_arch", mesh=mesh)
    start, end = (tuple(mesh.points[mesh.point_groups[name]]) for name in ("start", "end"))
    apex = ff.Marker("arc", "middle")
    model.add(
        ff.Beam("arc", section, orientation=(0.0, 0.0, 1.0)),
        ff.Rigid("clamp", ff.Ground(start), ff.Marker("arc", "start")),
        ff.Revolute("hinge", ff.Ground(end), ff.Marker("arc", "end")),
        ff.PointForce("load", apex, (0.0, -load, 0.0)),
        ff.Probe(
            "apex",
            apex,
            ("down", "aside", "force"),
            lambda t, at: (radius - at.position[1], abs(at.position[0]), t * load),
        ),
    )
    return model


CASE = ff.Case(
    name="deep_arch",
    summary="collapse of a deep arch, by arc length (DaDeppo, Schmidt 1975)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 40, "beam elements, even", minimum=2),
        ff.Option("radius", float, 100.0, "of the arch", above=0.0),
        ff.Option("angle", float, 215.0, "of the arch", unit="deg", above=0.0, maximum=300.0),
        ff.Option("axial_stiffness", float, 1e8, "EA, GA2 and GA3", above=0.0),
        ff.Option("bending_stiffness", float, 1e6, "EI2, EI3 and GJ", above=0.0),
        ff.Option("load", float, 1000.0, "at the apex at t = 1", above=0.0),
    ),
    analysis=ff.STATICS,
    arc_length=0.05,
    stop_column="down",
    stop_value=120.0,
    smoke={
        "elements": 6, "arc_length": 0.0, "load_steps": 2, "t_end": 0.2,
        "stop_column": "none", "stop_value": 0.0,
    },
    results=lambda history: {"largest_load": float(history["force"].max())},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
