# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference motion of the high-speed flexible slider-crank.

Two rods of square section 0.03 m (E = 2.1e11 Pa, nu = 0.3, rho = 7850 kg/m^3, shear factor 5/6) and
0.3 / 0.6 m length start straight along +X and at rest; a dead moment of 500 N m acts on the first
one at the ground, gravity 9.81 m/s^2 along -Y, a slider of 0.1 kg at the far end keeps to the X
axis. ``python tests/data/generate/slider_crank.py`` writes slider_crank.csv (plane high-order rods,
some minutes); ``--exudyn`` prints Exudyn's convergence towards it instead.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import scipy  # type: ignore[import-untyped]
from planar_rods import PinnedRods, Rod
from reference_csv import BENCHMARKS, DATA, write

LENGTHS = (0.3, 0.6)
SIDE, YOUNG, POISSON, DENSITY = 0.03, 2.1e11, 0.3, 7850.0
MOMENT, SLIDER, GRAVITY = 500.0, 0.1, 9.81
T_END, SAMPLE = 0.2, 2e-5
COLUMNS = ["t", "crank_angle", "crank_rate", "slider_x", "deflection"]


def observe(
    times: np.ndarray, pin: np.ndarray, pin_rate: np.ndarray, middle: np.ndarray, far: np.ndarray
) -> np.ndarray:
    """Columns of the table from the (n, 2) points pin between rods, middle and far end of rod 2."""
    angle = np.unwrap(np.arctan2(pin[:, 1], pin[:, 0]))
    cross = pin[:, 0] * pin_rate[:, 1] - pin[:, 1] * pin_rate[:, 0]
    rate = cross / (pin**2).sum(1)
    deflection = np.linalg.norm(middle - 0.5 * (pin + far), axis=1) / LENGTHS[1]
    return np.column_stack([times, angle, rate, far[:, 0], deflection])


def plane_rods(n_elements: int, degree: int, tolerance: float) -> np.ndarray:
    """High-order solution, shape (n, 5); ``n_elements * degree`` must be even."""
    area, inertia = SIDE**2, SIDE**4 / 12.0
    shear = 5.0 / 6.0 * YOUNG / (2.0 * (1.0 + POISSON)) * area
    section = (DENSITY * area, DENSITY * inertia, YOUNG * area, shear, YOUNG * inertia)
    rods = [Rod(length, *section) for length in LENGTHS]
    model = PinnedRods(
        rods, n_elements, degree, gravity=-GRAVITY, moment=MOMENT, slider_mass=SLIDER
    )
    pin, far = model.pins[1], model.pins[2]
    middle = (pin + far) // 2
    times = np.linspace(0.0, T_END, round(T_END / SAMPLE) + 1)
    states = list(model.integrate(times, tolerance))
    p = np.array([s.position for s in states])
    v = np.array([s.velocity[pin] for s in states])
    return observe(times, p[:, pin], v, p[:, middle], p[:, far])


def _exudyn_rods(ex: Any, mbs: Any, n_elements: int, nodes_per_element: int) -> list[list[int]]:
    """Node numbers of both rods: plane elements of 2 or 3 nodes, or 3D ones (0)."""
    section = ex.SquareSection(SIDE, YOUNG, POISSON, DENSITY)
    weight, starts, rods = np.array([0.0, -GRAVITY, 0.0]), (0.0, LENGTHS[0]), []
    ea, ga, _, _, ei, _ = section.stiffness
    for start, length in zip(starts, LENGTHS, strict=True):
        if nodes_per_element == 0:
            ends = np.array([[start, 0, 0], [start + length, 0, 0]])
            rods.append(ex.add_beam(mbs, section.data, ends[0], ends[1], n_elements, weight).nodes)
            continue
        stride = nodes_per_element - 1
        points = np.linspace(start, start + length, n_elements * stride + 1)
        nodes = [
            mbs.AddNode(ex.eii.NodeRigidBody2D(referenceCoordinates=[x, 0, 0])) for x in points
        ]
        for e in range(n_elements):
            beam = ex.eii.ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[e * stride : (e + 1) * stride + 1],
                length=length / n_elements,
                massPerLength=section.mass_per_length,
                crossSectionInertia=section.rotary_inertia[1],
                bendingStiffness=ei,
                axialStiffness=ea,
                shearStiffness=ga,
            )
            marker = mbs.AddMarker(ex.eii.MarkerBodyMass(bodyNumber=mbs.AddObject(beam)))
            mbs.AddLoad(ex.eii.LoadMassProportional(markerNumber=marker, loadVector=weight))
        rods.append(nodes)
    return rods


def _exudyn_joints(ex: Any, mbs: Any, rods: list[list[int]], spatial: bool) -> None:
    """Pins, slider, driving moment; the spin of 3D rods is stopped at their first node."""
    eii = ex.eii
    ground = mbs.AddObject(eii.ObjectGround())
    joint = eii.ObjectJointSpherical if spatial else eii.ObjectJointRevolute2D
    slider = mbs.AddNode(eii.NodePoint(referenceCoordinates=[sum(LENGTHS), 0, 0]))
    mbs.AddObject(eii.ObjectMassPoint(mass=SLIDER, nodeNumber=slider))
    fixed = mbs.AddMarker(
        eii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(eii.NodePointGround()), coordinate=0)
    )
    for coordinate in (1, 2):
        moving = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=slider, coordinate=coordinate))
        mbs.AddObject(eii.ObjectConnectorCoordinate(markerNumbers=[fixed, moving]))

    def marker(node: int) -> Any:
        return mbs.AddMarker(eii.MarkerNodePosition(nodeNumber=node))

    origin = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground))
    pairs = [
        (origin, marker(rods[0][0])),
        (marker(rods[0][-1]), marker(rods[1][0])),
        (marker(rods[1][-1]), marker(slider)),
    ]
    for pair in pairs:
        mbs.AddObject(joint(markerNumbers=list(pair)))
    frame = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground))
    crank = mbs.AddMarker(eii.MarkerNodeRigid(nodeNumber=rods[0][0]))
    mbs.AddLoad(eii.LoadTorqueVector(markerNumber=crank, loadVector=[0, 0, MOMENT]))
    for rod in rods if spatial else []:
        turning = mbs.AddMarker(eii.MarkerNodeRigid(nodeNumber=rod[0]))
        axes = [0, 0, 0, 1, 0, 0]
        mbs.AddObject(eii.ObjectJointGeneric(markerNumbers=[frame, turning], constrainedAxes=axes))


def exudyn_rods(n_elements: int, dt: float, nodes_per_element: int) -> np.ndarray:
    """Exudyn solution, shape (n, 5); see ``_exudyn_rods`` for the element kinds."""
    # Late, so that importing this module does not need Exudyn.
    sys.path.insert(0, str(BENCHMARKS))
    import exudyn_beams as ex

    container = ex.exu.SystemContainer()
    mbs = container.AddSystem()
    rods = _exudyn_rods(ex, mbs, n_elements, nodes_per_element)
    _exudyn_joints(ex, mbs, rods, spatial=nodes_per_element == 0)
    kinds = ex.exu.OutputVariableType
    middle = rods[1][len(rods[1]) // 2]
    wanted = [(rods[0][-1], kinds.Position), (rods[0][-1], kinds.Velocity)]
    wanted += [(middle, kinds.Position), (rods[1][-1], kinds.Position)]
    sensors = [
        mbs.AddSensor(ex.eii.SensorNode(nodeNumber=n, outputVariableType=k, storeInternal=True))
        for n, k in wanted
    ]
    mbs.Assemble()
    options = {
        "timeIntegration.newton.relativeTolerance": 1e-8,
        "timeIntegration.newton.absoluteTolerance": 1e-8,
        "solution.sensors.active": True,
        "solution.sensors.writePeriod": SAMPLE,
    }
    settings = ex.integration_settings(round(T_END / dt), dt, options)
    ex.exu.SolveDynamic(mbs, settings)
    data = [np.array(mbs.GetSensorStoredData(s)) for s in sensors]
    return observe(data[0][:, 0], *(d[:, 1:3] for d in data))


def headline(table: np.ndarray) -> str:
    """Angle at 0.1 s, largest deflection and its time, largest rate of a full table."""
    peak = int(table[:, 4].argmax())
    # Parabola through the three samples around the largest one.
    around = slice(peak - 1, peak + 2)
    a, b, c = np.polyfit(table[around, 0] - table[peak, 0], table[around, 4], 2)
    return (
        f"angle at 0.1 s {table[round(0.1 / SAMPLE), 1]:.6f} rad, at 0.2 s {table[-1, 1]:.5f} rad, "
        f"largest deflection {c - b * b / (4 * a):.5f} at {table[peak, 0] - b / (2 * a):.5f} s, "
        f"largest rate {table[:, 2].max():.2f} rad/s"
    )


def convergence(runs: Mapping[str, Callable[[], np.ndarray]], reference: np.ndarray) -> np.ndarray:
    """Run one after another, print differences from a full table, return the last one."""
    table = reference
    for label, run in runs.items():
        start = time.perf_counter()
        table = run()
        print(f"{label} ({time.perf_counter() - start:.1f} s): {headline(table)}")
        if reference.size:
            step = (len(table) - 1) // (len(reference) - 1)
            differences = np.abs(table[::step] - reference).max(0)[1:]
            named = zip(COLUMNS[1:], differences, strict=True)
            print("    differences", *(f"{n} {d:.1e}" for n, d in named), flush=True)
    return table


def generate() -> None:
    """Integrate with two meshes and write the finest one."""
    meshes = [(4, 4), (4, 6)]
    tables: list[np.ndarray] = []
    for n_elements, degree in meshes:
        label = f"{n_elements} elements of degree {degree} per rod"
        runs = {label: partial(plane_rods, n_elements, degree, 1e-8)}
        tables.append(convergence(runs, tables[-1] if tables else np.empty(0)))
    finest = tables[-1]
    other = exudyn_rods(24, 1e-5, 3)
    errors, distances = (
        ", ".join(f"{e:.0e}" for e in np.abs(finest - table).max(0)[1:])
        for table in (tables[-2], other)
    )
    header = f"""High-speed flexible slider-crank (Wu et al., Appl. Sci. 2020, 10, 1231), plane.
t (s); angle of the chord of the first rod (rad); its rate (rad/s); position of the slider (m);
distance of the second rod's midpoint from the middle of its chord over 0.6 m.
Data and source: tests/data/generate/slider_crank.py; pinned Simo-Reissner rods without damping,
{n_elements} elements of degree {degree} per rod, scipy {scipy.__version__} DOP853, tolerance 1e-8.
{headline(finest)}.
Largest differences from {meshes[0][0]} elements of degree {meshes[0][1]}: {errors}
(the rate carries the sharp elastic waves of the suddenly applied moment, which no mesh resolves);
from Exudyn 1.13.6, 24 three-node plane elements per rod, generalized-alpha 0.9, h = 1e-5:
{distances}."""
    every = round(1e-3 / SAMPLE)
    write("slider_crank", header, COLUMNS, finest[::every], 10)


def compare() -> None:
    """Print Exudyn's convergence towards the stored table."""
    reference = np.loadtxt(DATA / "slider_crank.csv", delimiter=",", comments=["#", "t"])
    kinds = {0: "two-node 3D", 2: "two-node plane", 3: "three-node plane"}
    combinations = [(n, h, k) for k in (2, 3, 0) for n, h in [(24, 2e-5), (24, 1e-5), (48, 1e-5)]]
    runs = {
        f"Exudyn {n} {kinds[k]} elements per rod, h = {h:g}": partial(exudyn_rods, n, h, k)
        for n, h, k in combinations
    }
    convergence(runs, reference)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--exudyn", action="store_true", help="only print Exudyn's convergence")
    args = parser.parse_args()
    if args.exudyn:
        compare()
    else:
        generate()


if __name__ == "__main__":
    main()
