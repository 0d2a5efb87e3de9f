# SPDX-License-Identifier: LGPL-3.0-or-later
"""A frame of 484 members: its sag under its weight, and the lowest of its frequencies.

A corner sinks as much as its columns shorten under their own weight and half of the beams.

Members are welded where their ends meet, by ``ff.weld``. They are listed storey by storey as
engineers do; ``--by-kind`` lists all columns first, which changes nothing but the order.

Run: ``python examples/frame.py``, then ``flexfem view results/frame``; ``--smoke`` for a frame of
one storey.
"""

import sys
from itertools import product

import numpy as np

import flexfem as ff

BAYS, STOREYS, BAY, STOREY = (4, 8), 4, 5.0, 3.2  # columns: one more than bays; m
YOUNG, DENSITY = 2.1e11, 7850.0  # Pa, kg/m^3
Place = tuple[int, int, int]


def members(storeys: int, *, by_kind: bool) -> list[tuple[Place, Place]]:
    """Ends of all members in units of bays and storeys."""
    found = []
    for level in range(storeys):
        for x, y in product(range(BAYS[0] + 1), range(BAYS[1] + 1)):
            found.append(((x, y, level), (x, y, level + 1)))
            if x < BAYS[0]:
                found.append(((x, y, level + 1), (x + 1, y, level + 1)))
            if y < BAYS[1]:
                found.append(((x, y, level + 1), (x, y + 1, level + 1)))
    return sorted(found, key=_is_beam) if by_kind else found


def _is_beam(ends: tuple[Place, Place]) -> bool:
    return ends[0][2] == ends[1][2]


def build(storeys: int = STOREYS, *, by_kind: bool = False) -> ff.Model:
    """The frame on its foundations."""
    steel = ff.Material(youngs_modulus=YOUNG, poisson_ratio=0.3, density=DENSITY)
    column, beam = (ff.Section.rectangle(h, w, steel) for h, w in ((0.2, 0.2), (0.12, 0.3)))
    listed = members(storeys, by_kind=by_kind)
    scale = np.array([BAY, BAY, STOREY])
    names = [f"member_{k}" for k in range(len(listed))]
    parts = [
        ff.LineMesh.straight({name: [scale * a, scale * b]}, elements=2)
        for name, (a, b) in zip(names, listed, strict=True)
    ]
    mesh = ff.LineMesh.join(parts)
    model = ff.Model("frame", mesh=mesh)
    beams = [
        ff.Beam(name, beam if _is_beam(ends) else column, group=name)
        for name, ends in zip(names, listed, strict=True)
    ]
    model.add(ff.Gravity((0.0, 0.0, -9.81)), *beams, *ff.weld(mesh, beams))
    for name, (a, _) in zip(names, listed, strict=True):
        if a[2] == 0:
            start = ff.Marker(name, "start")
            model.add(ff.Rigid(f"foot_{name}", ff.Ground(scale * a), start))
    corner = names[listed.index(((0, 0, storeys - 1), (0, 0, storeys)))]
    model.add(ff.PositionProbe("corner", ff.Marker(corner, "end")))
    return model


def shortening(storeys: int) -> float:
    """Shortening (m) of the columns at a corner under their weight and half of two beams each."""
    column, beams = 0.2 * 0.2 * STOREY, 0.12 * 0.3 * BAY
    loads = [(column + beams) * above - 0.5 * column for above in range(1, storeys + 1)]
    return float(sum(loads) * DENSITY * 9.81 * STOREY / (0.2 * 0.2 * YOUNG))


def main(*, smoke: bool, by_kind: bool) -> None:
    """Sag and frequencies."""
    model = build(1 if smoke else STOREYS, by_kind=by_kind)
    count, height = len(model.beams), STOREY * (1 if smoke else STOREYS)
    options = ff.StaticOptions(load_steps=1, quiet=True,
                               output=None if smoke else "results/frame")  # fmt: skip
    at = ff.solve_static(model, options, case="frame").history["corner_z"][-1]
    sag, short = height - at, shortening(1 if smoke else STOREYS)
    print(f"{count} members: the corner sinks by {1e3 * sag:.3f} mm, its columns alone by "
          f"{1e3 * short:.3f} mm")  # fmt: skip
    # stiff corners shift some weight inwards; one of the two beams is a quarter of it
    assert abs(sag / short - 1.0) < 0.1
    found = ff.find_modes(model, ff.ModeOptions(modes=3, quiet=True)).history["frequency"]
    print(f"frequencies {', '.join(f'{f:.3f}' for f in found)} Hz")


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv, by_kind="--by-kind" in sys.argv)
