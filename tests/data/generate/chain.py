# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference motion of the chain of four links.

Links of 0.5 m in a row along +X, initially straight and at rest; square section 0.01 m, E = 1e9 Pa,
nu = 0.3, rho = 1000 kg/m^3, shear factor 5/6; spherical joints, gravity 9.81 m/s^2 along -Z, 1 s.
``python tests/data/generate/chain.py`` writes chain_4x8.csv: the motion with 8 two-node elements
per link (Exudyn, converged in the step) and that of the continuous links (plane high-order rods).
"""

import sys

import numpy as np
import scipy  # type: ignore[import-untyped]
from planar_rods import PinnedRods, Rod
from reference_csv import BENCHMARKS, write

sys.path.insert(0, str(BENCHMARKS))
import exudyn_chain
from exudyn_beams import eii, exu, integration_settings

LINKS, T_END, SAMPLE = 4, 1.0, 0.05


def exudyn_tip(elements: int, dt: float, tolerance: float = 1e-8) -> np.ndarray:
    """Tip position (n, 3) every 0.05 s from the Exudyn model of the speed benchmark."""
    mbs, tip = exudyn_chain.build(LINKS, elements)
    position = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(
        eii.SensorNode(nodeNumber=tip, outputVariableType=position, storeInternal=True)
    )
    mbs.Assemble()
    options = {
        "timeIntegration.newton.relativeTolerance": tolerance,
        "timeIntegration.newton.absoluteTolerance": tolerance,
        "timeIntegration.newton.modifiedNewtonJacUpdatePerStep": True,
        "solution.sensors.active": True,
        "solution.sensors.writePeriod": SAMPLE,
    }
    exu.SolveDynamic(mbs, integration_settings(round(T_END / dt), dt, options))
    return np.array(mbs.GetSensorStoredData(sensor))[:, 1:]


def continuous_tip(n_elements: int, degree: int, tolerance: float = 1e-9) -> np.ndarray:
    """Tip position (n, 3) every 0.05 s of the continuous links."""
    section = exudyn_chain.SECTION
    ea, ga, _, _, ei, _ = section.stiffness
    values = (section.mass_per_length, section.rotary_inertia[1], ea, ga, ei)
    rods = [Rod(exudyn_chain.LINK_LENGTH, *values)] * LINKS
    model = PinnedRods(rods, n_elements, degree, gravity=float(exudyn_chain.GRAVITY[2]))
    times = np.linspace(0.0, T_END, round(T_END / SAMPLE) + 1)
    plane = np.array([state.position[-1] for state in model.integrate(times, tolerance)])
    return np.column_stack([plane[:, 0], 0.0 * plane[:, 0], plane[:, 1]])


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of two histories, m."""
    return float(np.linalg.norm(a - b, axis=1).max())


def main() -> None:
    """Run the refinements, print them and write the table."""
    steps = [1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5]
    coarse = [exudyn_tip(8, dt) for dt in steps]
    # Second order in the step: extrapolated from the two smallest.
    tips = coarse[-1] + (coarse[-1] - coarse[-2]) / 3.0
    for dt, tip in zip(steps, coarse, strict=True):
        print(f"Exudyn 4 x 8, h = {dt:g}: {difference(tip, tips):.2e} from the extrapolated one")
    previous = coarse[-2] + (coarse[-2] - coarse[-3]) / 3.0
    step_error = difference(previous, tips) / 4.0
    exact, finer = continuous_tip(2, 6), continuous_tip(4, 6)
    exact_error = difference(exact, finer)
    print(f"continuous links, 2 against 4 elements of degree 6: {exact_error:.2e}")
    for elements in (8, 16, 32):
        # A tighter tolerance is below the rounding of the finer meshes' residuals.
        tip = tips if elements == 8 else exudyn_tip(elements, 2.5e-4, 1e-6)
        print(f"Exudyn 4 x {elements}: {difference(tip, finer):.2e} from the continuous links")
    named = zip(steps, coarse, strict=True)
    deviations = ", ".join(f"{difference(t, tips):.1e} (h = {dt:g})" for dt, t in named)
    header = f"""Chain of 4 links (docstring of tests/data/generate/chain.py), tip position, m.
x, y, z: 8 two-node elements per link. Exudyn {exu.__version__}, geometrically exact beams with
Euler-parameter nodes, generalized-alpha 0.9, tolerance 1e-8, extrapolated to h = 0 from h = 1.25e-4
and 6.25e-5; estimated error of the step {step_error:.0e} m. Single runs deviate by
{deviations}.
Other two-node elements differ from it by the order of their mesh error: the distance to the
continuous links is {difference(tips, finer):.1e} m.
exact_x, exact_y, exact_z: the continuous links. Plane rods, 4 elements of degree 6 per link,
scipy {scipy.__version__} DOP853, tolerance 1e-9; estimated error {exact_error:.0e} m."""
    times = np.linspace(0.0, T_END, len(tips))
    columns = ["t", "x", "y", "z", "exact_x", "exact_y", "exact_z"]
    write("chain_4x8", header, columns, np.column_stack([times, tips, finer]), 10)


if __name__ == "__main__":
    main()
