# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids that keep energy and momenta: the tumbling L-shaped block, the twisting column.

Simo, Tarnow, ZAMP 43 (1992) 757: a block with arms of 6 m and 10 m, 3 m square, pushed at their
ends by opposite forces that rise and fall within 5 s, then free. Forces, shape and mesh of bricks
are those of the benchmark's input in moofeKIT; the rubber is neo-Hookean with its moduli.
"""

from collections.abc import Iterator

import numpy as np

import flexfem as ff
from tests.verification.result import Result

Values = np.ndarray
#: Section of the arms, m, bricks along the longer one beyond the corner, and time of the load, s.
SIDE, LAYERS, PUSHED = 3.0, 5, 5.0
#: Shear and bulk modulus, Pa, density, kg/m^3, and force at each end per second of the rise, N/s.
MODULI, DENSITY, FORCE = (997.5, 5209.0), 10.0, (256.0, 512.0, 768.0)


def block(halves: int = 2, layers: int = LAYERS) -> ff.SolidMesh:
    """Bricks: so many across each arm, twice as many along the shorter one; layers beyond it."""
    x = np.linspace(0.0, 2.0 * SIDE, 2 * halves + 1)
    y = np.concatenate([x[: halves + 1], np.linspace(SIDE, 10.0, layers + 1)[1:]])
    grid = np.stack(np.meshgrid(x, y, x[: halves + 1], indexing="ij"), axis=-1)
    shape = grid.shape[:3]
    first = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), -1)
    first = first.reshape(-1, 3)
    first = first[(first[:, 0] < halves) | (first[:, 1] < halves)]
    corners = [[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    rows = [np.ravel_multi_index((first + corner).T, shape) for corner in corners]
    used, cells = np.unique(np.stack(rows, axis=1), return_inverse=True)
    points = grid.reshape(-1, 3)[used] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0, 0, 1]])
    mesh = ff.SolidMesh(points, cells.reshape(-1, 8), "hexahedron")
    ends = {"long": points[:, 0] == -10.0, "short": points[:, 1] == 2.0 * SIDE}
    facets = {name: mesh.boundary[on[mesh.boundary].all(axis=1)] for name, on in ends.items()}
    return ff.SolidMesh(points, cells.reshape(-1, 8), "hexahedron", surfaces=facets)


def tumbling(mesh: ff.SolidMesh, degree: int, formulation: str = "displacement") -> ff.Model:
    """The block with its loads."""

    def rise(t: float) -> float:
        return max(0.0, min(t, PUSHED - t))

    traction = np.array(FORCE) / SIDE**2
    model = ff.Model("tumbling_block")
    model.add(
        ff.Solid("block", ff.laws.NeoHookean(*MODULI), mesh, density=DENSITY, degree=degree,
                 formulation=formulation),
        ff.SurfaceTraction("at_long", "block", "long", traction, amplitude=rise),
        ff.SurfaceTraction("at_short", "block", "short", -traction, amplitude=rise),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
    )  # fmt: skip
    return model


def drifts(history: dict[str, Values], start: float) -> tuple[float, float, float]:
    """Changes of energy and angular momentum after a time, relative, and linear momentum.

    The latter is relative to the momentum that the mass has at the root mean square of its speed.
    """
    free = np.asarray(history["t"]) > start - 1e-9
    energy = (history["energy_kinetic"] + history["energy_strain"])[free]
    momenta = [
        np.stack([history[f"all_{kind}{axis}"] for axis in "xyz"], axis=1)[free] for kind in "pl"
    ]
    linear, angular = (np.linalg.norm(values - values[0], axis=1).max() for values in momenta)
    mass = DENSITY * SIDE**2 * 13.0
    speed = np.sqrt(2.0 * history["energy_kinetic"][free].max() / mass)
    return (
        float(np.abs(energy / energy[0] - 1.0).max()),
        float(angular / np.linalg.norm(momenta[1][0])),
        float(linear / (mass * speed)),
    )


def flight(mesh: ff.SolidMesh, degree: int, formulation: str, end: float) -> dict[str, Values]:
    """History of the block until a time, s."""
    options = ff.RunOptions(
        dt=0.1, t_end=end, integrator="energy_momentum", rho_inf=1.0, tolerance=1e-12, quiet=True
    )
    return dict(ff.simulate(tumbling(mesh, degree, formulation), options).history)


def tumbles(full: bool) -> Iterator[Result]:
    """Energy and momenta of the block after its loads."""
    runs = [(block(1, 2), 1, "displacement", 6.0)]
    if full:
        runs = [(block(), 1, "displacement", 20.0), (block(1, 2), 2, "dilatation", 8.0)]
    for mesh, degree, formulation, end in runs:
        found = drifts(flight(mesh, degree, formulation, end), PUSHED)
        label = f"{len(mesh.cells)} bricks, degree {degree}, {formulation}, h = 0.1 s to {end:g} s"
        name = "change, relative, after the loads"
        # generalized-alpha changes energy and angular momentum by percents
        for quantity, value, tolerance in zip(
            ("energy", "angular momentum", "linear momentum"), found, (1e-10, 1e-12, 1e-12),
            strict=True,
        ):  # fmt: skip
            yield Result(
                "tumbling L-shaped block", f"{quantity}: {name}", 0.0, "conserved", value, label,
                tolerance,
            )  # fmt: skip


def twists() -> Iterator[Result]:
    """Energy of the twisting column."""
    case = ff.load_case("twisting_column")
    for ratio in (0.45, 0.499):
        run = case.run(
            poisson_ratio=ratio, integrator="energy_momentum", rho_inf=1.0, tolerance=1e-9
        )
        # generalized-alpha loses 4e-4
        yield Result(
            "twisting column", "energy: largest change, relative", 0.0, "conserved",
            max(abs(run.summary["results"][key]) for key in ("energy_lost", "energy_made")),
            f"2 cells across, dilatation, nu = {ratio:g}, h = 0.5 ms", 1e-6,
        )  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All lines; the short one is a coarse block that has just begun to tumble freely."""
    return [*tumbles(full), *(twists() if full else ())]
