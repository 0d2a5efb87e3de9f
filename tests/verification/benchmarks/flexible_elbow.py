# SPDX-License-Identifier: LGPL-3.0-or-later
"""Right-angle cantilever swinging in space (Simo, Vu-Quoc 1988)."""

import numpy as np

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "spectral rods"
#: elbow z, then the tip
REFERENCE = {
    1.0: (0.951318, 9.996983, 9.976611, 0.054032),
    2.0: (4.115236, 10.106260, 9.307850, 0.069264),
    3.0: (5.501677, 10.788497, 8.938499, 1.507208),
    4.0: (4.642066, 10.441982, 9.293758, 3.508933),
    6.0: (2.540678, 8.776352, 8.181640, 6.913355),
    8.0: (1.633320, 10.023207, 7.355172, 7.960556),
    10.0: (-3.095961, 10.004320, 8.029723, 4.463119),
    14.0: (0.909312, 7.344265, 4.526358, -8.304867),
    20.0: (-2.601944, 14.092997, 9.043196, 0.496023),
    30.0: (-0.223686, 8.263446, 8.498988, 0.168537),
}
ENERGY = 114.88033


def build(elements: int) -> ff.Model:
    """Two arms of 10 in the plane, clamped, pulled out of it at the elbow."""
    steps = np.linspace(0.0, 10.0, elements + 1)
    points = np.zeros((2 * elements + 1, 3))
    points[: elements + 1, 0] = steps
    points[elements + 1 :, 0], points[elements + 1 :, 1] = 10.0, steps[1:]
    cells = np.stack([np.arange(2 * elements), np.arange(1, 2 * elements + 1)], axis=1)
    mesh = ff.LineMesh(points, cells, {"frame": np.arange(2 * elements)}, {"elbow": elements})
    section = ff.Section.general(
        stiffness=(1e6, 1e6, 1e6, 1e3, 1e3, 1e3), inertia=(1.0, 1.0, 1.0, 20.0, 10.0, 10.0)
    )
    elbow = ff.Marker("frame", "elbow")
    model = ff.Model("elbow", mesh=mesh)
    model.add(
        ff.Beam("frame", section, orientation=(0.0, 0.0, 1.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("frame", "start")),
        ff.PointForce("pull", elbow, (0.0, 0.0, 50.0),
                      amplitude=ff.Table((0.0, 1.0, 2.0), (0.0, 1.0, 0.0))),
        ff.PositionProbe("elbow", elbow),
        ff.PositionProbe("tip", ff.Marker("frame", "end")),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Elbow and tip over the force and the free vibration, and the energy put in."""
    elements, h, end = (20, 5e-3, 30.0) if full else (10, 0.02, 4.0)
    rows = {t: v for t, v in REFERENCE.items() if t <= end}
    history = run(build(elements), h, end)
    case, mesh = "right-angle cantilever", f"2 x {elements} elements, h = {h:g} s"
    columns = ("elbow_z", "tip_x", "tip_y", "tip_z")
    # displacements of 10: errors of the mesh and of the phase grow with time
    tolerance = 6e-3 if full else 5e-3
    found = compare(case, SOURCE, mesh, history, columns, rows, tolerance, 10.0)
    row = int(np.argmin(np.abs(history["t"] - 2.0)))
    work = float(history["energy_work"][row])
    what = "energy after the force, J"
    return [*found, Result(case, what, ENERGY, SOURCE, work, mesh, 5e-3)]
