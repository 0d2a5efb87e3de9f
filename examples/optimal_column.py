# SPDX-License-Identifier: LGPL-3.0-or-later
"""The strongest column: similar sections of a given volume, by the gradient of its buckling load.

A pinned column may be thick where it bends most and thin at its ends. Of all columns with similar
sections and the same volume the strongest one carries 4/3 of the load of the uniform one (J. B.
Keller, Arch. Rational Mech. Anal. 5 (1960) 275-285), with the area ``4/3 sin^2(a)`` of the uniform
one's at ``x / length = (a - sin(2 a) / 2) / pi``.

A small change of the area of each element, which costs the same volume everywhere, changes the load
of the best column by the same amount; areas are multiplied by a power of the gradient until it
does. The exponent 1/3 is that of elements whose bending moments stay: their share of the load is as
the third power of one over the area, per volume. Steps of one gradient each, for 40 elements whose
areas are constant.

Run: ``python examples/optimal_column.py``, which takes a few seconds; ``--smoke`` takes one step of
a column of eight elements.
"""

import functools
import sys

import numpy as np

import flexfem as ff

LENGTH, AREA, YOUNG = 1.0, 1e-4, 2.1e11  # m, m^2, Pa
STEEL = ff.Material(YOUNG, 0.3, 7850.0)
EULER = np.pi**2 * YOUNG * (AREA**2 / 24.0) / LENGTH**2  # of the uniform column, N
OPTIONS = ff.StaticOptions(load_steps=1, buckling_modes=1, quiet=True)


def ends(count: int) -> np.ndarray:
    """Ends of elements over the length, shorter near both ends of the column."""
    half = 0.5 * np.linspace(0.0, 1.0, count // 2 + 1) ** 1.7
    return np.concatenate([half, 1.0 - half[-2::-1]])


@functools.cache
def section(area: float) -> ff.Section:
    """A rectangle twice as wide as it is high, which bends over its height."""
    height = (0.5 * area) ** 0.5
    return ff.Section.rectangle(2.0 * height, height, STEEL)


def build(areas: np.ndarray) -> ff.Model:
    """A column under Euler's load, by the areas of the elements of its lower half (m^2)."""
    own, places = np.concatenate([areas, areas[::-1]]), ends(2 * len(areas))
    points = np.outer(LENGTH * places, (0.0, 0.0, 1.0))
    cells = np.array([[i, i + 1] for i in range(len(own))])
    mesh = ff.LineMesh(points, cells, {"column": np.arange(len(own))})

    def along(s: float) -> ff.Section:
        number = int(np.searchsorted(places, s / LENGTH, side="right")) - 1
        return section(float(own[min(number, len(own) - 1)]))

    foot, head = ff.Marker("column", "start"), ff.Marker("column", "end")
    model = ff.Model("optimal_column", mesh=mesh)
    model.add(
        ff.Beam("column", along, orientation=(0.0, 1.0, 0.0)),
        ff.Revolute("foot", ff.Ground(), foot, axis=(0.0, 1.0, 0.0)),
        ff.PrescribedDisplacement("beside", ff.Ground(), head, axis=(1.0, 0.0, 0.0)),
        ff.PrescribedDisplacement("across", ff.Ground(), head, axis=(0.0, 1.0, 0.0)),
        ff.PointForce("push", head, (0.0, 0.0, -EULER)),
        ff.PositionProbe("head", head),
    )
    return model


def strongest(elements: int, steps: int) -> tuple[np.ndarray, float]:
    """Areas of the lower half, and the load in units of Euler's."""
    volumes = 2.0 * np.diff(ends(elements)[: elements // 2 + 1])
    areas = np.full(elements // 2, AREA)
    for step in range(steps):
        found = ff.gradient(build, "buckling:1", {"areas": areas}, OPTIONS)
        by_volume = found.gradient["buckling:1"]["areas"] / volumes
        print(
            f"{step:2d}: {found.value['buckling:1']:.5f} of Euler's load; by volume, largest over "
            f"least: {by_volume.max() / by_volume.min():.3g}"
        )
        areas = areas * np.cbrt(by_volume)
        areas *= AREA / (areas @ volumes)
    outcome = ff.solve_static(build(areas), OPTIONS)
    return areas, float(outcome.summary["buckling"][0])


def main(*, smoke: bool) -> None:
    """Find the column, and compare its load with Keller's."""
    areas, load = strongest(*((8, 1) if smoke else (40, 6)))
    print(f"{load:.4f} of Euler's load, Keller's optimum is {4.0 / 3.0:.4f}")
    if not smoke:
        options = ff.StaticOptions(
            t_end=0.9, load_steps=3, buckling_modes=1, quiet=True, output="results/optimal_column",
            fields="beam_surfaces",
        )  # fmt: skip
        ff.solve_static(build(areas), options)


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
