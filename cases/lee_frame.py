# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lee's frame: snap-through and snap-back of a hinged right-angled frame (Lee et al. 1968).

Column and beam of 120 with a rigid corner, hinged at both far ends; a dead load P along -Y on the
beam, 24 from the corner. Section 3 (out of plane) x 2, E = 7.2e6, nu = 0.3, shear factor 5/6; any
consistent units. The load factor t counts in units of 20000. The path goes up to a limit point,
down and back below zero load, and up again: it is followed by arc length.

History: ``down``, ``right``: displacement of the loaded point.

Expected: P = 18543.7 at the limit point, where ``down`` is 49.0 (solution of the rod's differential
equations; Lee et al. without shear and extension: 18532). Run:
``mpirun -n 2 python cases/lee_frame.py``, then
``python postprocess/plot_history.py results/lee_frame --columns t --x down``.
"""

import sys

import flexfem as ff

LOAD = 20000.0


def build(*, elements: int) -> ff.Model:
    """Model with ``elements`` beam elements for column and beam each."""
    mesh = ff.build_mesh("frame", elements=elements)
    material = ff.Material(youngs_modulus=7.2e6, poisson_ratio=0.3, density=1.0)
    section = ff.Section.rectangle(3.0, 2.0, material, shear_factor=5.0 / 6.0)
    model = ff.Model("lee_frame", mesh=mesh)
    loaded, start = ff.Marker("frame", "loaded"), (24.0, 120.0)
    model.add(
        ff.Beam("frame", section, orientation=(0.0, 0.0, 1.0)),
        ff.Revolute("foot", ff.Ground(), ff.Marker("frame", "foot")),
        ff.Revolute("tip", ff.Ground((120.0, 120.0, 0.0)), ff.Marker("frame", "tip")),
        ff.PointForce("load", loaded, (0.0, -LOAD, 0.0)),
        ff.Probe(
            "loaded",
            loaded,
            ("down", "right"),
            lambda t, at: (start[1] - at.position[1], at.position[0] - start[0]),
        ),
    )
    return model


CASE = ff.Case(
    name="lee_frame",
    summary="snap-through and snap-back of a hinged frame, by arc length (Lee et al. 1968)",
    description=__doc__,
    build=build,
    options=(ff.Option("elements", int, 20, "beam elements of each member", minimum=2),),
    analysis=ff.STATICS,
    arc_length=0.05,
    smoke={"elements": 2, "arc_length": 0.0, "load_steps": 2, "t_end": 0.2},
    results=lambda history: {"largest_load": LOAD * float(history["t"].max())},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
