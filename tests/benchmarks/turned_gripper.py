# SPDX-License-Identifier: LGPL-3.0-or-later
"""A gripper of two hollow rubber fingers on a rigid palm that turns once around: factorisations.

    mpirun -n 2 python -m tests.benchmarks.turned_gripper --cuts 3 --steps 200
    mpirun -n 2 python -m tests.benchmarks.turned_gripper --cuts 3 --stop 20 --policy updated

The fingers are those of the case ``gripper`` with cells cut into equal parts: 1 and 3 cuts are 4938
and 100,890 unknowns. Printed are unknowns, steps, iterations a step, factorisations, and seconds a
step without the first, which factorises.
"""

import argparse

from mpi4py import MPI

import numpy as np

import flexfem as ff

LENGTH, WIDTH, DEPTH, WALL, GAP, CELLS = 0.08, 0.016, 0.014, 0.002, 0.024, 8


def finger(inner: float, cuts: int) -> ff.SolidMesh:
    """A hollow finger whose inner side is at x = ``inner``."""
    counts = (3 * cuts, 3 * cuts, CELLS * cuts)
    box = ff.SolidMesh.box(counts, counts)
    i, j, k = np.floor(box.points[box.cells].mean(axis=1) / cuts).astype(int).T
    hollow = (i == 1) & (j == 1) & (k > 0) & (k < CELLS - 1)
    used, rows = np.unique(box.cells[~hollow], return_inverse=True)
    ticks = (
        [-DEPTH, WALL - DEPTH, -WALL, 0.0],
        [-0.5 * WIDTH, WALL - 0.5 * WIDTH, 0.5 * WIDTH - WALL, 0.5 * WIDTH],
        [-LENGTH, *np.linspace(WALL - LENGTH, -WALL, CELLS - 1), 0.0],
    )
    counted = box.points[used].T
    own = [np.interp(x / cuts, np.arange(len(t)), t) for x, t in zip(counted, ticks, strict=True)]
    sign = 1.0 if inner < 0.0 else -1.0
    places = np.column_stack([inner + sign * own[0], sign * own[1], own[2]])
    layer = (i == 2)[~hollow]
    regions = {"layer": np.flatnonzero(layer), "walls": np.flatnonzero(~layer)}
    mesh = ff.SolidMesh(places, rows.reshape(-1, 8), "hexahedron", regions=regions)
    outside = np.any(
        [(x == 0) | (x == most) for x, most in zip(counted, counts, strict=True)], axis=0
    )
    return mesh.with_surfaces(root=lambda x: x[:, 2] == 0.0, chamber=lambda x: ~outside)


def gripper(cuts: int, end: float, pressure: float) -> ff.Model:
    """The gripper, which turns about the y axis within ``end`` (s)."""
    model, palm = ff.Model("turned_gripper"), ff.Marker("palm")
    centre = ff.Ground((0.0, 0.0, 0.002))
    angle = ff.SmoothStep(0.0, end, 0.0, 2.0 * np.pi)
    model.add(ff.RigidBody("palm", 0.2, (1e-4,) * 3, position=(0.0, 0.0, 0.002)))
    # Young's modulus 1 MPa, and 20 MPa of the layer that does not stretch
    laws = {
        region: ff.laws.NeoHookean.from_young(modulus, 0.4)
        for region, modulus in (("walls", 1e6), ("layer", 2e7))
    }
    for name, inner in (("left", -GAP), ("right", GAP)):
        body = ff.Solid(name, laws, finger(inner, cuts), density=1100.0)
        model.add(
            body, ff.RigidPoints(f"{name}_bond", palm, nodes=body.node_markers("root"))
        )  # fmt: skip
        if pressure:
            grows = ff.SmoothStep(0.0, 0.1, 0.0, 1.0)
            model.add(ff.SurfacePressure(f"{name}_air", name, "chamber", pressure, amplitude=grows))
    model.add(
        ff.Spherical("axle", centre, palm),
        ff.PrescribedRotation(
            "drive", centre, palm, rotation=lambda t: (0.0, float(angle(t)), 0.0)
        ),
    )
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cuts", type=int, default=1)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--stop", type=int, help="number of steps that are computed")
    parser.add_argument("--policy", default="auto", choices=("auto", "frozen", "updated"))
    parser.add_argument("--pressure", type=float, default=0.0, help="in the chambers, Pa")
    own = parser.parse_args()
    end, stop = 2.0, own.stop or own.steps
    options = ff.RunOptions(
        dt=end / own.steps, t_end=end * stop / own.steps, rho_inf=0.8, quiet=True,
        iteration_matrix=own.policy,
    )  # fmt: skip
    summary = ff.simulate(gripper(own.cuts, end, own.pressure), options).summary
    if MPI.COMM_WORLD.rank == 0:
        steps = summary["steps"]
        print(
            f"{summary['status']}: {summary['unknowns']} unknowns, {steps} steps on "
            f"{summary['ranks']} ranks, {summary['newton_iterations'] / steps:.2f} iterations a "
            f"step, {summary['factorizations']} factorisations, "
            f"{summary['wall_seconds_steps'] / max(steps - 1, 1):.3g} s a step"
        )


if __name__ == "__main__":
    main()
