# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lee's frame: snap-through and snap-back of a hinged right-angled frame (Lee et al. 1968).

Column and beam of 120 with a rigid corner, hinged at both far ends; a dead load P along -Y on the
beam, 24 from the corner. Section 3 (out of plane) x 2, E = 7.2e6, nu = 0.3, shear factor 5/6; any
consistent units. The load factor t counts in units of ``--load``, 20000. The path goes up to a
limit point, down and back below zero load, and up again: it is followed by arc length.

History: ``down``, ``right``: displacement of the loaded point; ``force``: the load there.

Expected: P = 18543.7 at the limit point, where ``down`` is 49.0 (solution of the rod's differential
equations; Lee et al. without shear and extension: 18532). Run:
``mpirun -n 2 python cases/lee_frame.py``, then
``flexfem plot results/lee_frame --columns force --x down``.
"""

import sys

import flexfem as ff


def build(
    *, elements: int, column: float, beam: float, load_at: float, width: float, height: float,
    youngs_modulus: float, poisson_ratio: float, shear_factor: float, load: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements for column and beam each."""
    mesh = ff.build_mesh("frame", column=column, beam=beam, load_at=load_at, elements=elements)
    material = ff.Material(youngs_modulus, poisson_ratio, density=1.0)
    section = ff.Section.rectangle(width, height, material, shear_factor=shear_factor)
    model = ff.Model("lee_frame", mesh=mesh)
    loaded, start = ff.Marker("frame", "loaded"), (load_at, column)
    model.add(
        ff.Beam("frame", section, orientation=(0.0, 0.0, 1.0)),
        ff.Revolute("foot", ff.Ground(), ff.Marker("frame", "foot")),
        ff.Revolute("tip", ff.Ground((beam, column, 0.0)), ff.Marker("frame", "tip")),
        ff.PointForce("load", loaded, (0.0, -load, 0.0)),
        ff.Probe(
            "loaded",
            loaded,
            ("down", "right", "force"),
            lambda t, at: (start[1] - at.position[1], at.position[0] - start[0], t * load),
        ),
    )
    return model


CASE = ff.Case(
    name="lee_frame",
    summary="snap-through and snap-back of a hinged frame, by arc length (Lee et al. 1968)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 20, "beam elements of each member", minimum=2),
        ff.Option("column", float, 120.0, "length of the column", above=0.0),
        ff.Option("beam", float, 120.0, "length of the beam", above=0.0),
        ff.Option("load_at", float, 24.0, "the load's distance from the corner", above=0.0),
        ff.Option("width", float, 3.0, "of the section, out of the plane", above=0.0),
        ff.Option("height", float, 2.0, "of the section, in the plane", above=0.0),
        ff.Option("youngs_modulus", float, 7.2e6, "of the material", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the material", minimum=0.0, maximum=0.5),
        ff.Option("shear_factor", float, 5.0 / 6.0, "of the section", above=0.0, maximum=1.0),
        ff.Option("load", float, 20000.0, "at t = 1", above=0.0),
    ),
    analysis=ff.STATICS,
    arc_length=0.05,
    smoke={"elements": 2, "arc_length": 0.0, "load_steps": 2, "t_end": 0.2},
    results=lambda history: {"largest_load": float(history["force"].max())},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
