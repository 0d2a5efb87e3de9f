# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sharp and aligned rigid bodies that fall on each other: they never overlap.

The kinds of scenes are those of K. Erleben, "Methodology for assessing mesh-based contact point
methods", ACM Trans. Graph. 37 (2018) 39, with which M. Li et al., "Incremental potential contact",
ACM Trans. Graph. 39 (2020) 49, test their method: spikes, wedges, crevices, cliffs, inner edges of
a plane, and bodies whose edges and corners meet exactly. Each body falls on one that is fixed, in
small steps and in such in which it would get through the other one.
"""

from dataclasses import dataclass

import numpy as np

import flexfem as ff
from flexfem._types import FloatArray, IntArray
from flexfem.lie import so3
from flexfem.mesh.triangles import solids
from tests.verification.result import Result

#: Size of the bodies, m, speed at the start, m/s, and gap between them.
SIZE, SPEED, APART = 0.1, 2.0, 0.008
#: Step, s: in one the bodies move by a quarter of the gap; and time of the fall, s.
STEP, FALL = 1e-3, 16e-3
Solid = tuple[FloatArray, IntArray]


def prism(outline: list[tuple[float, float]]) -> Solid:
    """Prism along y of an outline in x and z, counterclockwise seen from -y, around its first."""
    flat, n = SIZE * np.array(outline), len(outline)
    ends = [np.insert(flat, 1, y, axis=1) for y in (-0.5 * SIZE, 0.5 * SIZE)]
    k, fan = np.arange(n), np.arange(1, n - 1)
    after = (k + 1) % n
    front = np.stack([0 * fan, fan, fan + 1], axis=1)
    sides = [np.stack(c, axis=1) for c in ((k, k + n, after + n), (k, after + n, after))]
    return np.concatenate(ends), np.concatenate([front, front[:, ::-1] + n, *sides])


def spike() -> Solid:
    """Pyramid with its tip at the origin, above which it is."""
    h = 0.2
    corners = [(-h, -h, 1.0), (h, -h, 1.0), (h, h, 1.0), (-h, h, 1.0), (0.0, 0.0, 0.0)]
    faces = [[0, 1, 2], [0, 2, 3], [4, 1, 0], [4, 2, 1], [4, 3, 2], [4, 0, 3]]
    return SIZE * np.array(corners), np.array(faces)


def cube(z: float) -> Solid:
    """Cube with a face at z = 0, above it with z = 1 and below it with z = -1."""
    points, triangles = solids.box((SIZE,) * 3)
    return points + np.array([0.0, 0.0, 0.5 * z * SIZE]), triangles


def frame() -> Solid:
    """Square plate with a square hole in the middle, its upper side at z = 0."""
    out, hole = 0.5 * SIZE, 0.12 * SIZE
    ring = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    flat = np.concatenate([out * ring, hole * ring])
    points = np.concatenate([np.column_stack([flat, np.full(8, z)]) for z in (-0.5 * SIZE, 0.0)])
    k = np.arange(4)
    after = (k + 1) % 4
    quads = [(k + 8, after + 8, after + 12, k + 12), (k + 4, after + 4, after, k),
             (k, after, after + 8, k + 8), (k + 12, after + 12, after + 4, k + 4)]  # fmt: skip
    return points, np.concatenate(
        [np.stack(c, axis=1) for a, b, c, d in quads for c in ((a, b, c), (a, c, d))]
    )


def plane() -> Solid:
    """Block of many triangles whose upper side is z = 0."""
    n = 6
    x, y = (c.ravel() for c in np.meshgrid(*[np.linspace(-1.5, 1.5, n + 1)] * 2, indexing="ij"))
    top = SIZE * np.column_stack([x, y, np.zeros(len(x))])
    under = top - [0.0, 0.0, 0.5 * SIZE]
    i, j = (c.ravel() for c in np.meshgrid(range(n), range(n), indexing="ij"))
    a = (n + 1) * i + j
    up = np.concatenate(
        [np.stack([a, a + n + 1, a + n + 2], axis=1), np.stack([a, a + n + 2, a + 1], axis=1)]
    )
    rim = np.concatenate([
        (n + 1) * np.arange(n), (n + 1) * n + np.arange(n), (n + 1) * np.arange(n, 0, -1) + n,
        np.arange(n, 0, -1),
    ])  # fmt: skip
    on, count = np.roll(rim, -1), len(top)
    sides = [np.stack(c, axis=1)
             for c in ((rim + count, on + count, on), (rim + count, on, rim))]  # fmt: skip
    return np.concatenate([top, under]), np.concatenate([up, up[:, ::-1] + count, *sides])


def turned(solid: Solid, *vector: float) -> Solid:
    """A solid rotated by a vector, in half turns."""
    return solid[0] @ so3.exp(np.pi * np.array(vector)).T, solid[1]


WEDGE = prism([(0.0, 0.0), (0.3, 1.0), (-0.3, 1.0)])
RIDGE, PEAK = turned(WEDGE, 1.0, 0.0, 0.0), turned(spike(), 1.0, 0.0, 0.0)
#: Its faces are parallel to those of the wedge.
CREVICE = prism([(0.0, -1.0), (-0.3, 0.0), (-0.8, 0.0), (-0.8, -1.3), (0.8, -1.3), (0.8, 0.0),
                 (0.3, 0.0)])  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A body that falls from above z = ``up`` on one that is fixed.

    Attributes:
        falling, fixed: their surfaces, m; they touch for ``up = 0``.
        aside: first place and speed of the falling one along x, m and m/s.
        up: its first height, m.
    """

    falling: Solid
    fixed: Solid
    aside: tuple[float, float] = (0.0, 0.0)
    up: float = 0.0


SCENES = {
    "spike on spike": Scene(spike(), PEAK),
    "spike on wedge": Scene(spike(), RIDGE),
    "spike on plane": Scene(spike(), plane(), (0.0, 1.0)),
    "spike in crevice": Scene(spike(), CREVICE, (0.003, 0.0), -0.85 * SIZE),
    "spike in hole": Scene(spike(), frame(), (0.0, 0.0), -0.6 * SIZE),
    "wedge on wedge": Scene(WEDGE, RIDGE),
    "wedge across wedge": Scene(turned(WEDGE, 0.0, 0.0, 0.5), RIDGE),
    "wedge in crevice": Scene(WEDGE, CREVICE, (0.0, 0.0), -SIZE),
    "wedge on plane": Scene(WEDGE, plane(), (0.0, 1.0)),
    "wedge on cliff": Scene(WEDGE, cube(-1.0), (0.5 * SIZE, -1.0)),
    "cube on cube": Scene(cube(1.0), cube(-1.0)),
    "cube on cliff": Scene(cube(1.0), cube(-1.0), (0.5 * SIZE, 0.0)),
    "cube beside cliff": Scene(cube(1.0), cube(-1.0), (SIZE, -0.5)),
    "cube over inner edges": Scene(cube(1.0), plane(), (0.0, 3.0)),
    "cube edge on edge": Scene(turned(cube(0.0), 0.25, 0.0, 0.0), RIDGE, up=SIZE / np.sqrt(2.0)),
}  # fmt: skip


#: Gain of energy, relative to that of the start. Impacts that are no discrete derivatives make a
#: tenth or more of it. Where edges graze, closest points jump within a step, which makes most.
GAIN = 1e-3
GRAZING = {"spike in crevice": 2e-2, "cube beside cliff": 1e-2, "cube on cliff": 1e-2}


def fallen(name: str, step: float) -> list[Result]:
    """Gap, energy and way of a fall."""
    scene = SCENES[name]
    points, triangles = scene.fixed
    fixed = ff.SurfaceMesh(points, triangles, {"fixed": np.arange(len(triangles))})
    place = (scene.aside[0], 0.0, scene.up + APART)
    body = ff.RigidBody(
        "body", 1.0, (2e-3,) * 3, position=place, velocity=(scene.aside[1], 0.0, -SPEED),
        centre=scene.falling[0].mean(axis=0), shape=ff.SurfaceShape(*scene.falling),
    )  # fmt: skip
    model = ff.Model("scene")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        body,
        ff.Contact("touch", "body", surfaces=ff.RigidMesh(ff.Ground(), mesh=fixed)),
        ff.ContactProbe("touching", "touch"),
        ff.EnergyProbe(),
    )
    options = ff.RunOptions(dt=step, t_end=FALL, rho_inf=1.0, quiet=True)
    outcome = ff.simulate(model, options)
    if outcome.status != "ok":
        raise RuntimeError(f"{name}: {outcome.status}")
    history = outcome.history
    gap, weight = history["touching_gap"], history["energy_gravity"]
    energy = sum(history[f"energy_{kind}"] for kind in ("kinetic", "strain", "gravity"))
    start = float(energy[0])
    steps = f"h = {step:g} s, {len(gap) - 1} steps"
    return [
        # 0 or less where they overlap; the gap at the start counts as that at which they repel
        Result(name, "least gap, over that at which they repel", 0.6, "above 0, up to 1",
               float(gap.min() / gap[0]), steps, 0.999),
        Result(name, "energy gained", 0.0, "conservation",
               max(float(energy.max()) / start - 1.0, 0.0), steps, GRAZING.get(name, GAIN)),
        # without contact, and of a body that gets through, it is 1
        Result(name, "way down, over that of a free fall", 0.0, "the fall has ended",
               float((weight[0] - weight[-1]) / (9.81 * (SPEED * FALL + 4.905 * FALL**2))), steps,
               0.6),
    ]  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All scenes, with steps of a sixteenth of the fall, and with one step alone."""
    steps = (STEP, FALL) if full else (STEP,)
    return [line for step in steps for name in SCENES for line in fallen(name, step)]
