# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director shells with large rotations, thin plates, kinks.

Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551-1569.
"""

import numpy as np
import pytest

from flexfem.families.shell_director.triangles import DirectorTriangles
from flexfem.mesh.shells.director_nodes import director_nodes
from flexfem.mesh.surface_mesh import SurfaceMesh
from tests.unit.director_triangles import (
    equilibrium,
    flat_held,
    forces,
    moved,
    quadratic,
    rigidly,
    sparse_tangent,
    upright,
)
from tests.unit.triangles import PATTERNS, isotropic, rectangle

pytestmark = pytest.mark.serial
TINY = 1e-9


def built(nodes, frames, directors, thickness, modulus, ratio, directions=None):
    """Triangles of an isotropic shell."""
    shear = 5 / 12 * modulus / (1 + ratio) * thickness * np.eye(2)
    stiffness = isotropic(thickness, modulus, ratio)
    return DirectorTriangles.build(
        nodes.astype(np.int32), frames, directors, stiffness, shear, directions=directions
    )


def plate(counts, pattern, sides, thickness, modulus, ratio):
    """A flat rectangle, its places and what is idle."""
    points, triangles = rectangle(counts, pattern, sides)
    places, nodes, edges = quadratic(points, triangles)
    frames, up = upright(places), np.tile([0.0, 0.0, 1.0], (len(nodes), 3, 1))
    made = built(nodes, frames, up, thickness, modulus, ratio)
    return made, frames, edges, flat_held(len(frames), len(points))


def edge_loads(places, edges, chosen, total):
    """Forces (n, 3) of a uniform load along z on the chosen places' edges."""
    corners = len(places) - len(edges)
    own = chosen[edges].all(1) & chosen[corners:]
    lengths = np.linalg.norm(np.diff(places[edges[own]], axis=1)[:, 0], axis=1)
    load = np.zeros_like(places)
    for k in range(2):
        np.add.at(load[:, 2], edges[own, k], lengths / 6)
    load[corners:][own, 2] += lengths * 2 / 3
    return load * total / lengths.sum()


@pytest.mark.parametrize("pattern", ["parallel", "union_jack", "crossed"])
def test_cantilever_under_end_shear(pattern):
    made, frames, edges, held = plate((16, 1), pattern, (10.0, 1.0), 0.1, 1.2e6, 0.0)
    x = frames[:, 0]
    held[x < TINY] = True
    load = edge_loads(frames[:, :3], edges, x > 10 - TINY, 4.0)
    change = (equilibrium(made, frames, load, held, 4) - frames)[x > 10 - TINY].mean(0)
    # measured 0.4 % and 0.2 %; without relaxed shear or interpolated membrane it is a few per cent
    np.testing.assert_allclose(change[[0, 2]], [-3.286, 6.698], rtol=0.006)


def test_slit_annular_plate():
    """Lifted along one side of the slit by 0.8 N/m, clamped along the other."""
    parameters, triangles = rectangle((4, 20), "parallel", (4.0, 2 * np.pi))
    parameters, nodes, edges = quadratic(parameters, triangles)
    radius, angle = 6 + parameters[:, 0], parameters[:, 1]
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], 1)
    frames, up = upright(places), np.tile([0.0, 0.0, 1.0], (len(nodes), 3, 1))
    made = built(nodes, frames, up, 0.03, 21e6, 0.0)
    held = flat_held(len(frames), len(places) - len(edges))
    held[angle > 2 * np.pi - TINY] = True
    load = edge_loads(places, edges, angle < TINY, 0.8 * 4.0)
    change = equilibrium(made, frames, load, held, 8) - frames
    inner, outer = (np.argmin(abs(parameters[:, :2] - [r, 0.0]).sum(1)) for r in (0.0, 4.0))
    # measured: 1.7 and 1.4 % below on these 4 x 20 cells; strains as they are give 12 % less
    np.testing.assert_allclose(change[[inner, outer], 2], [13.891, 17.528], rtol=0.02)


@pytest.mark.parametrize("exact", [True, False])
def test_hemisphere_with_a_hole(exact):
    """A quarter of it, between planes of symmetry, with midpoints of edges given or found."""

    def surface(parameters):
        f, t = parameters[:, 0], parameters[:, 1]
        return 10 * np.stack([np.cos(t) * np.cos(f), np.cos(t) * np.sin(f), np.sin(t)], 1)

    parameters, triangles = rectangle((8, 8), "parallel", (np.pi / 2, 0.4 * np.pi))
    middles = (parameters[np.roll(triangles, -1, 1)] + parameters[np.roll(triangles, -2, 1)]) / 2
    planes = np.zeros((len(triangles), 3, 3))
    first, last = middles[:, :, 0] < TINY, middles[:, :, 0] > np.pi / 2 - TINY
    planes[first], planes[last] = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]
    mesh = SurfaceMesh(
        surface(parameters), triangles, {"shell": np.arange(len(triangles))},
        midpoints=surface(middles.reshape(-1, 3)).reshape(-1, 3, 3) if exact else None,
    )  # fmt: skip
    found = director_nodes(mesh, np.arange(len(triangles)), planes)
    frames, held = found.frames.copy(), found.held.copy()
    for chosen in (first, last):
        normal, own = planes[chosen][0], np.unique(found.nodes[:, 3:][chosen])
        turns = frames[own, 3:].reshape(-1, 3, 3)
        turns[:, :, 0], turns[:, :, 1] = normal, np.cross(turns[:, :, 2], normal)
        frames[own, 3:] = turns.reshape(-1, 9)
        held[own] = [True, False, False, False, True, True]
    points = mesh.points
    held[np.flatnonzero(parameters[:, 0] < TINY), 1] = True
    held[np.flatnonzero(parameters[:, 0] > np.pi / 2 - TINY), 0] = True
    outwards, inwards = (np.argmin(np.linalg.norm(points - 10 * e, axis=1)) for e in np.eye(3)[:2])
    held[outwards, 2] = True
    load = np.zeros((len(frames), 3))
    load[outwards, 0], load[inwards, 1] = 200, -200
    made = built(found.nodes, frames, found.directors, 0.04, 6.825e7, 0.3)
    change = equilibrium(made, frames, load, held, 5) - frames
    # measured: up to 0.5 % below; directors out of the planes of symmetry lock: 20 % below
    result = [change[outwards, 0], -change[inwards, 1]]
    np.testing.assert_allclose(result, [4.067, 8.178], rtol=0.01)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize(("clamped", "expected"), [(False, 0.0040624), (True, 0.0012653)])
def test_thin_plates_do_not_lock(pattern, clamped, expected):
    """Unit pressure, stiffness and sides, thickness 1e-4; Timoshenko: Theory of Plates."""
    thickness = 1e-4
    modulus = 12 * (1 - 0.09) / thickness**3
    made, frames, _, held = plate((8, 8), pattern, (1.0, 1.0), thickness, modulus, 0.3)
    rim = ((frames[:, :2] < TINY) | (frames[:, :2] > 1 - TINY)).any(1)
    held[:, :2] = True
    held[rim] |= np.array([True, True, True, clamped, clamped, True])
    load = np.zeros((len(frames), 6))
    np.add.at(load[:, 2], made.nodes[:, 3:6], np.repeat(made.areas[:, None] / 3, 3, 1))
    free = np.flatnonzero(~held)
    K = sparse_tangent(made, frames)[free][:, free].toarray()
    deflections = np.zeros(load.shape)
    deflections.ravel()[free] = np.linalg.solve(K, load.ravel()[free])
    centre = deflections[np.argmin(abs(frames[:, :2] - 0.5).sum(1)), 2]
    # measured within 3 %; the full shear gives 5 to 33 % less, and almost nothing on 4 x 4 cells
    np.testing.assert_allclose(centre, expected, rtol=0.05)


def test_a_closed_path_of_loads_leaves_nothing():
    made, frames, _, held = plate((6, 2), "perturbed", (3.0, 1.0), 0.1, 1e6, 0.3)
    held[frames[:, 0] < TINY] = True
    tip, rng = frames[:, 0] > 3 - TINY, np.random.default_rng(2)
    state, largest = frames, 0.0
    for size in (1.0, 1.0, 0.0):
        load = np.zeros((len(frames), 3))
        load[tip] = 3.0 * size * rng.normal(size=(tip.sum(), 3))
        # from one load to the next, not from the start
        state = equilibrium(made, state, load, held, 1, tolerance=1e-10)
        largest = max(largest, made.energies(state)[:, 3].sum())
    # a strain that remembers its path keeps 3e-4 of the energy (quadrature-point rotations do)
    assert made.energies(state)[:, 3].sum() < 1e-15 * largest
    # positions and directors; rotations about these are idle
    assert abs(state - frames)[:, [0, 1, 2, 5, 8, 11]].max() < 1e-8


def tee(cells):
    """A T of three arms of length one and width 0.2 in the plane x, z."""

    def arm(name, end):
        return SurfaceMesh.grid(
            name, np.linspace(0.0, 1.0, cells + 1), [0.0, 0.1, 0.2],
            lambda p: p[:, :1] * np.array(end) + p[:, 1:] * np.array([0.0, 1.0, 0.0]),
        )  # fmt: skip

    arms = [arm("left", [-1.0, 0, 0]), arm("right", [1.0, 0, 0]), arm("down", [0, 0, -1.0])]
    points, triangles, bodies = [], [], {}
    for mesh in arms:
        shift, rows = 3 * (cells + 1) * len(points), 4 * cells * len(triangles)
        points.append(mesh.points)
        triangles.append(mesh.triangles + shift)
        bodies[next(iter(mesh.bodies))] = rows + np.arange(len(mesh.triangles))
    xyz, back = np.unique(np.round(np.concatenate(points), 12), axis=0, return_inverse=True)
    return SurfaceMesh(xyz, back.ravel()[np.concatenate(triangles)], bodies)


def test_branching_shells_turn_as_one():
    """The frame of three beams, clamped left and below, with a force at the right end."""
    mesh = tee(8)
    found = director_nodes(mesh, np.arange(len(mesh.triangles)))
    modulus, thickness, force = 1e9, 0.01, 1e-3
    made = built(found.nodes, found.frames, found.directors, thickness, modulus, 0.0)
    x, _, z = found.frames[:, :3].T
    held = found.held.copy()
    held[(x < -1 + TINY) | (z < -1 + TINY)] = True
    middles = np.arange(len(x)) >= len(found.corners)
    joint = middles & (abs(x) < TINY) & (abs(z) < TINY)
    # nothing is idle where directors differ: else the turn is taken by no arm or by all
    assert not held[joint, 5].any()
    assert held[middles & ~joint, 5].all()
    tip = x > 1 - TINY
    load = edge_loads(found.frames[:, :3], found.edges, tip, force)
    change = equilibrium(made, found.frames, load, held, 1, tolerance=1e-10) - found.frames
    # moment F at the joint into two clamped arms of stiffness 4 EI each, and an arm of 1 m
    EI = modulus * 0.2 * thickness**3 / 12
    deflection = force * (1 / 3 + 1 / 8) / EI
    # shear is 1e-4 of bending, the stretch of the arm below 1e-5, the mesh 5e-4
    np.testing.assert_allclose(change[tip, 2].mean(), deflection, rtol=3e-3)


def test_a_rigid_turn_of_a_kinked_shell_is_free():
    mesh = tee(2)
    found = director_nodes(mesh, np.arange(len(mesh.triangles)))
    made = built(found.nodes, found.frames, found.directors, 0.01, 1e9, 0.3)
    turn = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    frames = rigidly(found.frames, turn, np.array([5.0, 0.0, 0.0]))
    # rounding; directors that stay behind are of the order of the stiffness
    assert abs(forces(made, frames)).max() < 1e-12 * 1e9
    step = np.zeros((len(frames), 6))
    step[:, 3:] = 0.1
    assert abs(forces(made, moved(frames, step))).max() > 1e-6 * 1e9
