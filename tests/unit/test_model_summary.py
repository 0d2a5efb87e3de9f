# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summary of models: masses against the assembled mass matrix, counts against the system."""

import json
from itertools import pairwise

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem._checks import InputError
from flexfem.lie import so3

pytestmark = pytest.mark.serial

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
OFFSET = ff.Section.rectangle(0.04, 0.02, STEEL, mass_centre=(0.01, -0.02))
SKIN = ff.ShellSection.isotropic(0.01, STEEL)
X, Y, Z = np.eye(3)
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]


def arc(u: np.ndarray) -> np.ndarray:
    """Sheet on a quarter of a cylinder of 0.5 m."""
    return np.column_stack([0.5 * np.sin(u[:, 0]), u[:, 1], 0.5 * np.cos(u[:, 0])])


def many_bodies(element: str) -> ff.Model:
    """Beams of both formulations off their axes, rigid bodies, masses, a shell."""
    lines = {"first": [(0, 0, 0), (0.8, 0.1, -0.2)], "second": [(1, 2, 0), (1.2, 1, -0.5)]}
    mesh = ff.LineMesh.straight(lines, 2)
    surface = ff.SurfaceMesh.grid("sheet", np.linspace(0, 1.5, 4), np.linspace(0, 1, 4), arc)
    model = ff.Model("many", mesh=mesh, surface=surface)
    model.add(
        ff.Beam("first", OFFSET),
        ff.Beam("second", OFFSET, orientation=(1.0, 1.0, 0.0)),
        ff.Beam("curve", OFFSET, curve=ff.NurbsCurve.line((1, 1, 1), (1, 1.5, 1.2))),
        ff.Shell("sheet", SKIN, element=element, mass="consistent"),
        ff.RigidBody(
            "block", 3.0, [[0.3, 0.01, 0], [0.01, 0.2, 0.02], [0, 0.02, 0.25]],
            position=(1, 2, 3), centre=(0.1, -0.2, 0.3), rotation=TURN,
        ),
        ff.PointMass("lump", 0.7, ff.Marker("second", 0.5, offset=(0.1, 0.2, -0.1))),
        ff.PointMass("bob", 0.4, ff.Marker("block", offset=(0.3, 0.0, 0.1))),
        ff.Spherical("pin", ff.Ground(), ff.Marker("first", "start")),
    )  # fmt: skip
    return model


def assembled(model: ff.Model) -> tuple[np.ndarray, object]:
    """Mass matrix (6, 6) of rigid motions about the origin in inertial axes, and the system."""
    from flexfem.lie import se3
    from flexfem.simulation.run.setup import set_up
    from flexfem.solvers.modal.linearization import Linearization

    _, system = set_up(model, None, 1000)
    linear = Linearization(system)
    linear.evaluate(np.zeros(system.constraints.size))
    mass, motions = linear.matrices().mass, []
    for twist in np.eye(6):
        parts = []
        for part in system.parts:
            block = part.block
            frames = block.frames[: block.owned]
            back = np.swapaxes(se3.rotation(frames), -1, -2)
            speed = back @ twist[3:]
            moved = np.einsum("nij,nj->ni", back, twist[:3] + np.cross(twist[3:], frames[:, :3]))
            motion = np.concatenate([moved, speed], axis=1)[:, : block.width]
            if block.dirichlet is not None:  # no rotations at shells' corners
                motion[block.dirichlet[: block.owned]] = 0.0
            parts.append(motion.ravel())
        vector = linear.vector()
        vector.set(0.0)
        vector.getArray()[: linear.unknowns] = np.concatenate(parts)
        motions.append(vector)
    result = np.array([[a.dot(mass * b) for b in motions] for a in motions])
    return result, system


def errors(model: ff.Model) -> tuple[float, float, float]:
    """Differences of mass, first moments and moments of inertia about the origin, by the mass."""
    whole, M = ff.describe(model).total, assembled(model)[0]
    m, c = whole.mass, whole.centre
    first = m * np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    about_origin = whole.inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
    parts = M[:3, :3] - m * np.eye(3), M[3:, :3] - first, M[3:, 3:] - about_origin
    one, two, three = (float(np.abs(part).max()) / m for part in parts)
    return one, two, three


@pytest.mark.parametrize("element", ["rotation_free", "director"])
def test_masses_are_those_of_the_mass_matrix(element: str) -> None:
    """The elements' own quadrature and lumping have nothing in common with the sums here."""
    model = many_bodies(element)
    # equal to round-off, of director shells to a rule for curved triangles: a wrong arm, a missing
    # rotary inertia or a missing body is off by 1e-4 at least
    assert max(errors(model)) < (1e-13 if element == "rotation_free" else 1e-6)
    counts, system = ff.describe(model).mobility, assembled(model)[1]
    assert counts.unknowns == system.unknowns
    assert counts.constraints == system.multipliers == 3


def test_the_mass_matrix_of_curved_beams_tends_to_the_masses() -> None:
    """Mass centres off a curved axis: those of the elements are off to second order."""
    found = []
    for elements in (2, 4):
        curve = ff.NurbsCurve.arc((1, 1, 1), (1, 1.5, 1), X, 2.0, elements=elements)
        model = ff.Model()
        model.add(ff.Beam("curve", OFFSET, curve=curve))
        found.append(errors(model))
    (mass, *coarse), (_, *fine) = found
    assert mass < 1e-13
    # a factor 3.1 from two to four elements, 4 in the limit; a wrong offset stays
    assert np.all(np.array(coarse) > 2.5 * np.array(fine))
    assert max(coarse) < 5e-3


def test_masses_of_shapes() -> None:
    """Closed forms: a rod, a quarter of a ring, a plate, a box that is rotated."""
    thin = ff.Section.circle(0.001, STEEL)
    surface = ff.SurfaceMesh.rectangle("plate", (2.0, 0.5), (3, 2))
    model = ff.Model(
        mesh=ff.LineMesh.straight({"rod": [(1, 0, 0), (1, 0, 2.0)]}, 3), surface=surface
    )
    quarter = ff.NurbsCurve.arc((0, 0, 0), (0.5, 0, 0), Z, np.pi / 2)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    model.add(
        ff.Beam("rod", thin), ff.Beam("ring", thin, curve=quarter), ff.Shell("plate", SKIN),
        ff.RigidBody(
            "box", 2.0, (0.1, 0.2, 0.25), rotation=turn, shape=ff.Box((1.0, 2.0, 3.0))
        ),
    )  # fmt: skip
    rod, ring, plate, box = ff.describe(model).bodies
    mass = 7850.0 * np.pi * 0.0005**2
    assert rod.masses.mass == pytest.approx(2.0 * mass, rel=1e-13)
    # m L^2/12; the section's own part is 1e-7 of it, an inertia about an end four times as much
    np.testing.assert_allclose(np.diag(rod.masses.inertia)[:2], 2.0 * mass * 4.0 / 12.0, rtol=1e-6)
    np.testing.assert_allclose(rod.masses.centre, [1, 0, 1], atol=1e-14)
    # 2 R/pi from the centre along both axes; the chord's middle is 20 % nearer
    np.testing.assert_allclose(ring.masses.centre[:2], 1.0 / np.pi, rtol=1e-9)
    own = mass * 0.25 * np.pi * (0.25 - 2.0 / np.pi**2)
    np.testing.assert_allclose(ring.masses.inertia[2, 2], own, rtol=1e-5)
    assert plate.masses.mass == pytest.approx(78.5, rel=1e-13)
    moments = 78.5 / 12.0 * np.array([0.25, 4.0, 4.25])
    np.testing.assert_allclose(plate.masses.inertia, np.diag(moments), atol=1e-12)
    expected = turn @ np.diag([0.1, 0.2, 0.25]) @ turn.T
    np.testing.assert_allclose(box.masses.inertia, expected, atol=1e-15)
    np.testing.assert_allclose(box.size, [0.6 + 1.6, 0.8 + 1.2, 3.0], rtol=1e-14)


@pytest.mark.slow
def test_a_floating_body_has_the_mass_of_its_mesh() -> None:
    """A rod along x, rotated along y: m L^2/12 about its middle, half a length from its origin."""
    from tests.unit.reduction_bodies import LENGTH, NODES, SECTION, beam

    reduced = ff.reduce_body(beam(1), NODES, modes=0)
    model = ff.Model()
    model.add(ff.FloatingBody("rod", reduced, position=(1.0, 2.0, 3.0), rotation=TURN))
    summary = ff.describe(model)
    (rod,) = summary.bodies
    mass = SECTION.mass_per_length * LENGTH
    assert rod.masses.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(rod.masses.centre, [1.0, 2.0 + LENGTH / 2, 3.0], atol=1e-12)
    slender = mass * LENGTH**2 / 12.0 + SECTION.inertia[4, 4] * LENGTH
    # rotated the wrong way, the moment about x would be that about the axis, a thousandth
    np.testing.assert_allclose(rod.masses.inertia[0, 0], slender, rtol=1e-9)
    np.testing.assert_allclose(rod.size, [0.0, LENGTH, 0.0], atol=1e-15)
    assert rod.degrees_of_freedom == 12


def bar(name: str, start: np.ndarray, end: np.ndarray) -> ff.RigidBody:
    return ff.RigidBody(name, 1.0, (0.1, 0.1, 0.1), position=0.5 * (start + end))


def four_bar(joint: type[ff.Revolute]) -> ff.Model:
    """Crank, rod and rocker with four hinges of parallel axes."""
    points = np.array([[0, 0, 0], [0, 1, 0], [1.2, 1.1, 0], [1, 0, 0.0]])
    model = ff.Model("four_bar")
    bars = [bar(f"bar_{i}", points[i], points[i + 1]) for i in range(3)]
    model.add(*bars)
    for i, point in enumerate(points):
        first, second = (
            ff.Ground(point)
            if k in (-1, 3)
            else ff.Marker(f"bar_{k}", offset=point - bars[k].position)
            for k in (i - 1, i)
        )
        model.add(joint(f"hinge_{i}", first, second, axis=Z))
    return model


def test_freedoms_of_linkages() -> None:
    """A four-bar linkage of rigid bars: three redundant rows by Gruebler's count, one motion."""
    counts = ff.describe(four_bar(ff.Revolute)).mobility
    assert (counts.motions, counts.grubler, counts.redundant) == (1, -2, 3)
    assert counts.degrees_of_freedom == 1
    # hinges that leave translations along their axes: each bar but the planar motion slides
    loose = ff.describe(four_bar(ff.PointOnLine)).mobility
    assert loose.redundant == 0
    assert loose.motions == loose.grubler == 18 - 8


def test_freedoms_of_a_long_chain() -> None:
    """Many rows in one group: pivots count what singular values count in short chains."""
    names = [f"link_{i}" for i in range(70)]
    model = ff.Model("chain")
    model.add(*(ff.RigidBody(n, 1.0, (1, 1, 1), position=(i, 0, 0)) for i, n in enumerate(names)))
    ends = [ff.Ground(), *(ff.Marker(name) for name in names)]
    for i, (a, b) in enumerate(pairwise(ends)):
        offset = ff.Marker(a.body, offset=(1, 0, 0)) if i else a
        model.add(ff.Revolute(f"hinge_{i}", offset, b, axis=Z))
    counts = ff.describe(model).mobility
    assert (counts.constraints, counts.redundant, counts.motions) == (350, 0, 70)
    last = ff.Marker("link_69", offset=(1, 0, 0))
    model.add(ff.Revolute("close", ff.Ground((70, 0, 0)), last, axis=Z))
    counts = ff.describe(model).mobility
    # three motions out of the plane of the loop are constrained twice, and, as it is straight, its
    # length
    assert (counts.constraints, counts.redundant, counts.motions) == (355, 4, 69)


def test_sheets_are_held_by_their_edges() -> None:
    """Clamped: none left; hinged along a line: one; in a plane of symmetry: three."""
    left = {}
    for rule in ("clamped", "hinged", "symmetric x"):
        mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 1.0), (2, 2))
        model = ff.Model(surface=mesh)
        model.add(ff.Shell("sheet", SKIN, edges={"sheet_left": rule}))
        counts = ff.describe(model).mobility
        left[rule] = (counts.motions, counts.supports, counts.fixed)
    assert left == {"clamped": (0, 6, 9), "hinged": (1, 5, 9), "symmetric x": (3, 3, 3)}


def test_plane_of_symmetry_may_be_oblique() -> None:
    """Nodes there have axes of their own, in which their supports are given."""
    R = so3.exp(np.array([0.3, 0.5, -0.7]))  # is not its own inverse
    mesh = ff.SurfaceMesh.grid("sheet", [0.0, 0.5, 1.0], [0.0, 0.5, 1.0], lambda p: p @ R[:2])
    model = ff.Model(surface=mesh)
    model.add(ff.Shell("sheet", SKIN, edges={"sheet_left": "symmetric"}))
    counts = ff.describe(model).mobility
    # (2, 4, 3) where axes are rotated the wrong way
    assert (counts.motions, counts.supports, counts.fixed) == (3, 3, 3)


def test_plane_of_symmetry_is_that_of_the_own_triangles() -> None:
    """A wall that comes last in the mesh is no neighbour of triangles at an edge."""
    ticks = [0.0, 0.5, 1.0]
    sheet = ff.SurfaceMesh.grid("sheet", ticks, ticks, lambda p: np.insert(p, 2, 0.0, axis=1))
    wall = ff.SurfaceMesh.grid("wall", ticks, ticks, lambda p: np.insert(p, 0, 3.0, axis=1))
    model = ff.Model(surface=ff.SurfaceMesh.join([sheet, wall]))
    model.add(ff.Shell("sheet", SKIN, edges={"sheet_left": "symmetric"}), ff.Shell("wall", SKIN))
    # refused as curved if it were; the wall is free
    counts = ff.describe(model).mobility
    assert (counts.motions, counts.supports, counts.fixed) == (3 + 6, 3, 3)


def test_matrix_entries_are_those_of_the_tangent() -> None:
    """Of beams, shells and joints; a missing pattern of patches would leave out two thirds."""
    model = many_bodies("rotation_free")
    from flexfem.simulation.run.setup import set_up
    from flexfem.solvers.modal.linearization import Linearization

    _, system = set_up(model, None, 1000)
    linear = Linearization(system)
    linear.evaluate(np.zeros(system.constraints.size))
    linear.matrices()
    actual = sum(int(mat.mat.getInfo()["nz_used"]) for mat in linear._mats[:1])
    # the linearisation has room for the pairs of joints and a diagonal of multipliers besides
    assert ff.describe(model).entries == pytest.approx(actual, rel=0.1)


def test_matrix_entries_of_bodies_of_all_families() -> None:
    """By hand: a row of n elements of two nodes has n + 1 + 2 n pairs of nodes."""
    points = np.linspace(0.0, 1.0, 5)[:, np.newaxis] * X
    mesh = ff.ElementMesh(points, [[0, 1], [1, 2], [2, 3], [3, 4]], "interval")
    model = ff.Model("parts", mesh=ff.LineMesh.straight({"beam": [(0, 1, 0), (1, 1, 0)]}, 4))
    model.add(
        ff.Beam("beam", OFFSET),
        ff.Beam(
            "curve", OFFSET, curve=ff.NurbsCurve.line((0, 2, 0), (1, 2, 0), degree=1, elements=4)
        ),
        ff.UFLBody("bar", mesh, lambda x, X, p: ufl.inner(ufl.grad(x), ufl.grad(x)), density=1.0),
        ff.RigidBody("block", 1.0, np.eye(3)),
    )
    entries = {body.name: 36 * 13 for body in model.beams} | {"bar": 9 * 13, "block": 36}
    assert ff.describe(model).entries == sum(entries.values())
    facts = {one.name: one for one in ff.describe(model).bodies}
    assert {name: facts[name].elements for name in entries} == {
        "beam": 4, "curve": 4, "bar": 4, "block": 0,
    }  # fmt: skip
    assert [one.unknowns for one in facts.values()] == [30, 30, 6, 15]


def test_text_and_numbers() -> None:
    model = many_bodies("rotation_free")
    model.add(
        *(ff.RigidBody(f"ball_{i}", 1.0, (1, 1, 1), position=(i, 0, 0)) for i in range(12)),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("block"), axis=Z, angle=lambda t: t),
        ff.SpringDamper("spring", ff.Ground((0, 0, 9.0)), ff.Marker("block"), stiffness=10.0),
        ff.PointForce("push", ff.Marker("block"), (1.0, 0.0, 0.0), amplitude=lambda t: t),
        ff.PositionProbe("place", ff.Marker("block")),
    )
    summary = ff.describe(model)
    text = str(summary)
    for words in (
        "3 beams, 1 shell, 13 rigid bodies, 2 point masses", "... and 5 more", "beam, nurbs",
        "1 constraint", "1 force law", "(1, 0, 0) N, times a function of time", "gravity none",
        "ground - block", "degrees of freedom left",
    ):  # fmt: skip
        assert words in text
    values = json.loads(json.dumps(summary.as_dict()))
    assert values["total"]["mass"] == summary.total.mass
    assert values["degrees_of_freedom"] == summary.mobility.degrees_of_freedom
    assert [joint["role"] for joint in values["joints"]] == ["joints", "drives", "forces"]


def test_what_is_no_model_is_refused() -> None:
    with pytest.raises(TypeError, match="check: model must be"):
        ff.describe("model")
    with pytest.raises(InputError, match="it has no bodies"):
        ff.describe(ff.Model())
