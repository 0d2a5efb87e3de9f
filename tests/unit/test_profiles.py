# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profiles against published tables, thin-walled theory, and finite elements on triangles."""

from math import pi

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.vtu.polygons import cut
from flexfem.materials.saint_venant import Cell, solve_section
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
G = 2.1e11 / 2.6
Q2, Q3, T = 1, 2, 3
SHAPES = {
    "I": ff.Section.i_section(0.055, 0.1, 0.0041, 0.0057, STEEL, fillet=0.007),
    "welded I": ff.Section.i_section(0.055, 0.1, 0.0041, 0.0057, STEEL),
    "channel": ff.Section.channel(0.055, 0.1, 0.0045, 0.0075, STEEL, fillet=0.01),
    "angle": ff.Section.angle(0.1, 0.065, 0.008, STEEL, fillet=0.01),
    "T": ff.Section.t_section(0.05, 0.06, 0.005, 0.006, STEEL, fillet=0.006),
}


def integrals(p):
    """Area, first and second moments of a polygon, by Green's theorem."""
    q = np.roll(p, -1, axis=0)
    (y, z), (v, w) = p.T, q.T
    c = y * w - v * z
    second = [c @ (z * z + z * w + w * w), c @ (y * y + y * v + v * v)]
    mixed = c @ (y * w + 2 * y * z + 2 * v * w + v * z)
    first = [c @ (y + v), c @ (z + w)]
    return 0.5 * c.sum(), np.array(first) / 6.0, np.array(second) / 12.0, mixed / 24.0


@pytest.mark.parametrize(
    ("name", "section", "listed"),
    [
        # EN 10365: area, both second moments and mass; the listed torsion constant 1.20 cm^4 is
        # that of an interpolation formula for rolled profiles
        ("IPE 100", SHAPES["I"], (10.32, 171.0, 15.92, 8.1)),
        (
            "IPE 200", ff.Section.i_section(0.1, 0.2, 0.0056, 0.0085, STEEL, fillet=0.012),
            (28.48, 1943.0, 142.4, 22.4),
        ),
    ],
    ids=["IPE 100", "IPE 200"],
)  # fmt: skip
def test_tables_of_profiles(name, section, listed):
    shape = section.shape
    area, strong, weak, mass = listed
    # listed with three and four digits; without the fillets the area would be 4 % less
    assert shape.area * 1e4 == pytest.approx(area, rel=5e-4)
    assert shape.second_moments[0] * 1e8 == pytest.approx(strong, rel=5e-4)
    assert shape.second_moments[1] * 1e8 == pytest.approx(weak, rel=5e-4)
    assert section.mass_per_length == pytest.approx(mass, rel=5e-3)
    if name == "IPE 100":
        assert shape.torsion_constant * 1e8 == pytest.approx(1.20, rel=0.05)
    # the stiffness has them where they belong: the strong axis is e2
    assert section.stiffness[4, 4] == 2.1e11 * shape.second_moments[0]
    assert section.stiffness[0, 0] == 2.1e11 * shape.area


@pytest.mark.parametrize("name", SHAPES)
def test_constants_are_those_of_the_outline(name):
    """The polygon of the picture; arcs have four sides there, so that it has a little more."""
    section = SHAPES[name]
    shape = section.shape
    area, first, second, mixed = integrals(section.outline)
    # sharp shapes to round-off; the polygon cuts 0.3 % off fillets, a wrong corner is more
    bound = 1e-12 if name == "welded I" else 6e-3
    assert area == pytest.approx(shape.area, rel=bound)
    assert np.abs(first).max() < bound * area * np.ptp(section.outline)
    np.testing.assert_allclose(second, shape.second_moments, rtol=bound)
    assert mixed == pytest.approx(shape.product, rel=bound, abs=1e-12 * second[0])
    assert (shape.product != 0.0) == (name == "angle")
    faces = cut(section.outline)
    parts = [integrals(section.outline[face])[0] for face in faces]
    assert min(parts) > -1e-12 * area  # the caps of beams do not overlap
    assert sum(parts) == pytest.approx(area, rel=1e-12)


def test_rectangle_is_that_of_the_series():
    """One cell, where constants and stresses are known in closed form."""
    b, h = 0.02, 0.05
    corners = np.array([[0.0, 0.0], [b, 0.0], [b, h], [0.0, h]])
    found, known = solve_section([Cell(corners)]), ff.Section.rectangle(b, h, STEEL)
    # degree 6 in the whole: three digits of the torsion; shear is a polynomial and exact
    assert found.torsion_constant == pytest.approx(known.shape.torsion_constant, rel=2e-3)
    np.testing.assert_allclose(found.shear_factors, 5 / 6 * np.eye(2), atol=1e-10)
    assert np.abs(found.shear_centre).max() < 1e-12
    side = np.argmin(np.abs(found.points - [0.5 * b, 0.0]).sum(axis=1))
    assert found.torsion[side] == pytest.approx(known.walls[0].stress[3, 1, T], rel=2e-2)
    assert found.shear[side, 1] == pytest.approx(1.5 / (b * h), rel=1e-10)


@pytest.mark.parametrize("t", [1e-3, 2.5e-4])
def test_thin_walls(t):
    """Formulas of thin-walled open sections, as t goes to zero; deviations are of order t/b."""
    b, h = 0.05, 0.1
    bound = 4.0 * t / b
    channel = ff.Section.channel(b + t / 2, h + t, t, t, STEEL).shape
    # shear centre of the middle line b x h outside of the web: 3 b^2/(h + 6 b); the other side of
    # the web would be off by twice that
    e = 3 * b * b / (h + 6 * b)
    back = channel.outline[:, 0].min()
    assert channel.shear_centre[0] == pytest.approx(back + t / 2 - e, rel=bound)
    assert channel.torsion_constant == pytest.approx((2 * b + h) * t**3 / 3, rel=bound)
    warping = t * b**3 * h**2 * (3 * b + 2 * h) / (12 * (6 * b + h))
    assert channel.warping_constant == pytest.approx(warping, rel=bound)
    beam = ff.Section.i_section(b, h + t, t, t, STEEL).shape
    assert beam.torsion_constant == pytest.approx((2 * b + h) * t**3 / 3, rel=bound)
    assert beam.warping_constant == pytest.approx(t * b**3 * h**2 / 24, rel=bound)
    # the web carries the shear force: area h t, a little less by the flanges' own
    assert beam.shear_factors[1] * beam.area == pytest.approx(h * t, rel=0.12)
    # where the middle lines of the legs cross
    for shape, corner in (
        (ff.Section.angle(b, h, t, STEEL).shape, (0.5 * t, 0.5 * t)),
        (ff.Section.t_section(b, h, t, t, STEEL).shape, (0.5 * b, h - 0.5 * t)),
    ):
        origin = shape.outline.min(axis=0)
        away = np.array(shape.shear_centre) - origin - corner
        assert np.abs(away).max() < bound * t


@pytest.fixture(scope="module")
def triangles():
    """Constants from quadratic finite elements on the triangles of gmsh."""
    from mpi4py import MPI

    import dolfinx
    import gmsh
    import ufl
    from dolfinx.fem.petsc import LinearProblem
    from dolfinx.io.gmsh import model_to_mesh

    def solve(outline, arcs, size):
        """Outline with places (i, centre) at which the side from vertex i is an arc."""
        gmsh.initialize(interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            geo, sides = gmsh.model.geo, []
            points = [geo.addPoint(y, z, 0.0, size) for y, z in outline]
            for i, a in enumerate(points):
                b = points[(i + 1) % len(points)]
                if i in arcs:
                    sides.append(geo.addCircleArc(a, geo.addPoint(*arcs[i], 0.0, size), b))
                else:
                    sides.append(geo.addLine(a, b))
            surface = geo.addPlaneSurface([geo.addCurveLoop(sides)])
            geo.synchronize()
            gmsh.model.addPhysicalGroup(2, [surface], 1)
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(2)
            mesh = model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=2).mesh
        finally:
            gmsh.finalize()

        def integral(form):
            return dolfinx.fem.assemble_scalar(dolfinx.fem.form(form))

        V = dolfinx.fem.functionspace(mesh, ("Lagrange", 2))
        u, v, x = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.SpatialCoordinate(mesh)
        area = integral(1.0 * ufl.dx(mesh))
        c = dolfinx.fem.Constant(mesh, [integral(x[i] * ufl.dx) / area for i in range(2)])
        r = x - c
        M = np.array([[integral(r[i] * r[j] * ufl.dx) for j in range(2)] for i in range(2)])
        mesh.topology.create_connectivity(1, 2)
        edge = dolfinx.mesh.exterior_facet_indices(mesh.topology)
        rim = dolfinx.fem.locate_dofs_topological(V, 1, edge)
        zero = dolfinx.fem.dirichletbc(0.0, rim, V)
        one = dolfinx.fem.dirichletbc(0.0, rim[:1], V)
        options = {"ksp_type": "preonly", "pc_type": "lu"}

        def solution(load, bc):
            a = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
            problem = LinearProblem(
                a, load * ufl.dx, bcs=[bc], petsc_options=options, petsc_options_prefix="section"
            )
            return problem.solve()

        # Prandtl's stress function: another formulation of torsion, and a bound from below
        J = 2.0 * integral(solution(2.0 * v, zero) * ufl.dx)
        chi = [solution(r[i] * v, one) for i in range(2)]
        curl = r[0] * ufl.grad(v)[1] - r[1] * ufl.grad(v)[0]
        C = np.array([
            [integral(ufl.inner(ufl.grad(p), ufl.grad(q)) * ufl.dx) for q in chi] for p in chi
        ])  # fmt: skip
        inverse = np.linalg.inv(M)
        # the torque of the shear stresses of unit forces about the centroid
        torque = [
            integral(ufl.replace(curl, {v: chi[i]}) * ufl.dx) for i in range(2)
        ]  # fmt: skip
        along, across = inverse @ torque
        return {
            "area": area, "J": J, "factors": np.linalg.inv(inverse @ C @ inverse) / area,
            "centre": np.array([across, -along]),
        }  # fmt: skip

    return solve


def channel_outline(b, h, web, flange, r):
    y, z = web + r, flange + r
    outline = [
        (0, 0), (b, 0), (b, flange), (y, flange), (web, z), (web, h - z), (y, h - flange),
        (b, h - flange), (b, h), (0, h),
    ]  # fmt: skip
    return outline, {3: (y, z), 5: (y, h - z)}


def angle_outline(b, h, t, r):
    outline = [(0, 0), (b, 0), (b, t), (t + r, t), (t, t + r), (t, h), (0, h)]
    return outline, {3: (t + r, t + r)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["channel", "angle"])
def test_finite_elements_on_triangles_agree(name, triangles):
    if name == "channel":
        outline, arcs = channel_outline(0.055, 0.1, 0.0045, 0.0075, 0.01)
        size = 1.1e-3
    else:
        outline, arcs = angle_outline(0.1, 0.065, 0.008, 0.01)
        size = 1.5e-3
    shape, found = SHAPES[name].shape, triangles(outline, arcs, size)
    assert shape.area == pytest.approx(found["area"], rel=1e-6)
    # measured 3e-5, by the triangles; the thin-walled formula is off by 5 % and more
    assert shape.torsion_constant == pytest.approx(found["J"], rel=1e-4)
    k2, k3 = shape.shear_factors
    mine = np.array([[k2, shape.shear_coupling], [shape.shear_coupling, k3]])
    np.testing.assert_allclose(mine, found["factors"], atol=5e-6)
    # measured 4e-7 above, 1e-8 m here; the thin-walled formula is off by 2 mm
    np.testing.assert_allclose(shape.shear_centre, found["centre"], atol=1e-6)


def test_stresses_carry_the_resultants():
    """Shear stress of a channel by the formula of thin walls, where that is good."""
    section = SHAPES["channel"]
    stress, p = section.walls[0].stress, section.outline
    y = section.shape.shear_centre[0]
    through = np.array([0.0, 0.0, 1.0, y, 0.0, 0.0])  # a force along e3 through the shear centre
    web = np.flatnonzero(np.abs(p[:, 1]) < 1e-9)
    tau = stress[web, 1] @ through
    # the boundary runs up on one side of the web and down on the other one
    assert abs(tau[0] + tau[1]) < 1e-3 * abs(tau[0])
    # Q S/(I t) with the first moment S of the flange, half of the web and the fillet;
    # over the web's thickness it varies by a few per thousand
    half = 0.0075 * 0.055 * 0.04625 + 0.0045 * 0.0425**2 / 2 + 0.01**2 * (1 - pi / 4) * 0.0403
    expected = half / (section.shape.second_moments[0] * 0.0045)
    assert np.abs(tau) == pytest.approx(expected, rel=5e-3)
    # torsion: thickness over torsion constant in the middle of a flange
    flange = np.argmin(np.abs(p - [0.0157, -0.05]).sum(axis=1))
    constant = section.shape.torsion_constant
    assert stress[flange, 1, T] == pytest.approx(0.0075 / constant, rel=5e-3)


def test_bending_of_an_angle_couples(rng):
    section = SHAPES["angle"]
    strain = rng.normal(size=6) * 1e-4
    resultant = section.stiffness @ strain
    y, z = section.walls[0].points.T
    fibre = strain[0] + z * strain[4] - y * strain[5]
    # a wrong sign of the product of inertia is off by tens of per cent
    assert np.allclose(section.walls[0].stress[:, 0] @ resultant, 2.1e11 * fibre, rtol=1e-10)
    area, _, _, _ = integrals(section.outline)
    assert section.inertia[4, 5] == pytest.approx(-7850.0 * section.shape.product)
    assert area == pytest.approx(section.shape.area, rel=6e-3)
    turned = ff.Section.angle(0.065, 0.1, 0.008, STEEL, fillet=0.01)
    # the same profile seen in a mirror: e2 and e3 exchanged
    assert turned.shape.second_moments == pytest.approx(section.shape.second_moments[::-1])
    assert turned.shape.shear_centre == pytest.approx(section.shape.shear_centre[::-1])
    assert turned.shape.shear_factors == pytest.approx(section.shape.shear_factors[::-1])


def test_own_centres_and_factors():
    section = ff.Section.channel(
        0.055, 0.1, 0.0045, 0.0075, STEEL, shear_centre=(0.0, 0.0), shear_factor=(0.4, 0.3)
    )
    off = section.stiffness - np.diag(np.diag(section.stiffness))
    assert not off.any()
    np.testing.assert_allclose(
        np.diag(section.stiffness)[1:3], G * section.shape.area * np.array([0.4, 0.3])
    )
    own = ff.Section.channel(0.055, 0.1, 0.0045, 0.0075, STEEL)
    y = own.shape.shear_centre[0]
    force = np.array([0.0, 0.0, 1e3, y * 1e3, 0.0, 0.0])  # through the shear centre: no twist
    strain = np.linalg.solve(own.stiffness, force)
    assert abs(strain[3]) < 1e-12 * np.abs(strain).max()


REFUSED = [
    (lambda: ff.Section.i_section(0.05, 0.1, 0.0, 0.005, STEEL), "web must be positive, got 0.0"),
    (
        lambda: ff.Section.i_section(0.05, 0.1, 0.004, 0.005, STEEL, fillet=-1e-3),
        "fillet must not be negative, got -0.001",
    ),
    (
        lambda: ff.Section.i_section(0.05, 0.1, 0.06, 0.005, STEEL),
        "half of the web and the fillet must be less than half of the width 0.05, got 0.03",
    ),
    (
        lambda: ff.Section.i_section(0.05, 0.1, 0.004, 0.005, STEEL, fillet=0.046),
        "half of the web and the fillet must be less than half of the width 0.05, got 0.048",
    ),
    (
        lambda: ff.Section.channel(0.05, 0.1, 0.004, 0.05, STEEL),
        "flange and fillet must be less than half of the height 0.1, got 0.05",
    ),
    (
        lambda: ff.Section.angle(0.05, 0.1, 0.05, STEEL),
        "thickness and fillet must be less than the width 0.05, got 0.05",
    ),
    (lambda: ff.Section.t_section(0.05, 0.1, 0.004, 0.005, 7), "material must be a Material"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[text for _, text in REFUSED])
def test_shapes_that_cannot_be(make, message):
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        make()
    assert str(caught.value).startswith("Section: ")
    assert_on_page(str(caught.value))


def test_cantilevers_twist_and_bend_aside():
    """Small loads through the centroid against the theory of beams, with elements on SE(3)."""
    length, force = 1.0, 1.0
    lines = {"channel": [[0, 0, 0], [length, 0, 0]], "angle": [[0, 1, 0], [length, 1, 0]]}
    model = ff.Model("cantilevers", mesh=ff.LineMesh.straight(lines, 16))
    for name, (start, _) in lines.items():
        model.add(ff.Beam(name, SHAPES[name], group=name, orientation=(0, 1, 0)))
        model.add(ff.Rigid(f"wall_{name}", ff.Ground(start), ff.Marker(name, "start")))
        model.add(ff.PointForce(f"load_{name}", ff.Marker(name, "end"), (0, 0, force)))
        model.add(ff.PositionProbe(f"at_{name}", ff.Marker(name, "end")))
        turn = ff.Probe(
            f"turn_{name}", ff.Marker(name, "end"), [f"{name}_turn"],
            lambda t, end: [end.rotation[2, 1]],
        )  # fmt: skip
        model.add(turn)
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
    last = {key: column[-1] - column[0] for key, column in outcome.history.items()}
    shape = SHAPES["channel"].shape
    # the force has the torque -y F about the shear centre at y < 0, which twists
    twist = -shape.shear_centre[0] * force * length / (G * shape.torsion_constant)
    # exact in elements of constant twist; about the centroid there would be none
    assert last["channel_turn"] == pytest.approx(twist, rel=1e-4)
    shape = SHAPES["angle"].shape
    second = np.array(
        [[shape.second_moments[1], shape.product], [shape.product, shape.second_moments[0]]]
    )
    # u'' is the inverse of the second moments times the moments F (L - x) along e2 and e3
    aside, up = np.linalg.solve(second, [0.0, force]) * length**3 / (3 * 2.1e11)
    # the axis turns about the shear centre, too
    y, z = shape.shear_centre
    twist = -y * force * length / (G * shape.torsion_constant)
    # elements of constant curvature: 1/(4 n^2) = 1e-3 less, and shear some 1e-3 more; without the
    # product of inertia there would be no bending aside, without the twist 7 % more
    assert last["at_angle_y"] == pytest.approx(aside + twist * z, rel=1e-2)
    assert last["at_angle_z"] == pytest.approx(up - twist * y, rel=1e-2)
