# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constants of arbitrary sections against closed forms, tables, and solids in space."""

from collections.abc import Callable
from math import cos, pi, sin, sqrt

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

STEEL = ff.Material(210e9, 0.3, 7850.0)
PLY = ff.OrthotropicMaterial((40e9, 10e9, 9e9), (10e9, 8e9, 5e9), (0.25, 0.3, 0.35), 1600.0)


def rectangle(width: float, height: float) -> list[list[float]]:
    y, z = 0.5 * width, 0.5 * height
    return [[-y, -z], [y, -z], [y, z], [-y, z]]


def grid(width: float, height: float, columns: int, rows: int) -> ff.SectionMesh:
    """Quadrilaterals of a rectangle, the lower half of them "low", the upper "high"."""
    y, z = np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.5, 0.5, rows + 1)
    points = np.array([[width * a, height * b] for b in z for a in y])
    first = np.array([i + j * (columns + 1) for j in range(rows) for i in range(columns)])
    cells = first[:, None] + [0, 1, columns + 2, columns + 1]
    half = columns * (rows // 2)
    number = np.arange(len(cells))
    return ff.SectionMesh(points, cells, {"low": number[:half], "high": number[half:]})


def round_points(y: float, z: float, count: int) -> np.ndarray:
    """Vertices of an ellipse, as a polygon of the same area."""
    angle = 2.0 * pi * np.arange(count) / count
    swell = sqrt(2.0 * pi / count / sin(2.0 * pi / count))
    return swell * np.column_stack([y * np.cos(angle), z * np.sin(angle)])


def torsion(outline: object, holes: object = (), *, size: float, degree: int = 2) -> float:
    mesh = ff.SectionMesh.of_outlines(outline, holes, size=size)
    found = ff.section_properties(mesh, STEEL, degree=degree)
    return float(1.0 / np.linalg.inv(found.stiffness)[3, 3] / STEEL.shear_modulus)


# --- torsion -------------------------------------------------------------------------------------


@pytest.mark.serial
def test_torsion_of_the_square() -> None:
    """Timoshenko, Goodier (1970), section 109."""
    assert torsion(rectangle(0.1, 0.1), size=0.015) == pytest.approx(0.140577e-4, rel=5e-4)


@pytest.mark.serial
def test_torsion_of_an_equilateral_triangle() -> None:
    """Saint-Venant: sqrt(3) a^4 / 80, with a cubic warping."""
    outline = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.5 * sqrt(3.0)]]
    assert torsion(outline, size=0.2, degree=3) == pytest.approx(sqrt(3.0) / 80.0, rel=1e-9)


@pytest.mark.serial
def test_torsion_of_an_ellipse() -> None:
    """Pi a^3 b^3 / (a^2 + b^2)."""
    found = torsion(round_points(2.0, 1.0, 160), size=0.2)
    assert found == pytest.approx(pi * 8.0 / 5.0, rel=1e-3)


@pytest.mark.serial
def test_torsion_of_a_thick_tube() -> None:
    """The polar moment."""
    found = torsion(round_points(1.0, 1.0, 120), [round_points(0.6, 0.6, 120)], size=0.08)
    assert found == pytest.approx(0.5 * pi * (1.0 - 0.6**4), rel=2e-3)


@pytest.mark.serial
def test_torsion_of_a_thin_box_and_of_a_slit_one() -> None:
    """Bredt's closed wall, and the open one that is weaker by (t/a)^2."""
    wall, middle = 0.02, 1.0
    outer, inner = middle + wall, middle - wall
    closed = torsion(rectangle(outer, outer), [rectangle(inner, inner)], size=0.05)
    assert closed == pytest.approx(middle**3 * wall, rel=0.03)
    slit = 1e-3
    half, low = 0.5 * inner, 0.5 * outer
    outline = [
        [slit, -low], [low, -low], [low, low], [-low, low], [-low, -low], [-slit, -low],
        [-slit, -half], [-half, -half], [-half, half], [half, half], [half, -half], [slit, -half],
    ]  # fmt: skip
    opened = torsion(outline, size=0.05)
    assert opened == pytest.approx(4.0 * middle * wall**3 / 3.0, rel=0.03)


# --- shear ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("depth", "nu", "factor"),
    [
        (2.0, 0.0, 0.8333), (1.0, 0.0, 0.8333), (2.0, 0.25, 0.8331), (1.0, 0.25, 0.8295),
        (0.5, 0.25, 0.7961), (0.25, 0.25, 0.6308), (1.0, 0.49999, 0.8228), (0.5, 0.49999, 0.7375),
    ],
)  # fmt: skip
@pytest.mark.serial
def test_shear_factors_of_rectangles(depth: float, nu: float, factor: float) -> None:
    """Gruttmann, Wagner (2001), table of rectangles by ratio of depth to breadth."""
    material = ff.Material(1.0, nu, 1.0)
    found = ff.section_properties(grid(1.0, depth, 12, 12), material, degree=3)
    ours = found.stiffness[2, 2] / (material.shear_modulus * depth)
    assert ours == pytest.approx(factor, abs=1e-4)


@pytest.mark.serial
def test_shear_factor_of_a_circle() -> None:
    """The energy of the exact stresses (Timoshenko, Goodier 1970, section 121)."""
    mesh = ff.SectionMesh.of_outlines(round_points(1.0, 1.0, 100), size=0.15)
    found = ff.section_properties(mesh, STEEL)
    ours = found.stiffness[1, 1] / (STEEL.shear_modulus * pi)
    nu, second = 0.3, pi / 4.0
    radius, weight = np.polynomial.legendre.leggauss(8)
    r, w = 0.5 * (radius + 1.0), 0.5 * weight
    angle = 2.0 * pi * np.arange(16) / 16
    y, z = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    along = (3 + 2 * nu) / (8 * (1 + nu)) * (1 - y**2 - (1 - 2 * nu) / (3 + 2 * nu) * z**2)
    across = -(1 + 2 * nu) / (4 * (1 + nu)) * y * z
    area_weights = (w * r)[:, None] * 2.0 * pi / 16
    energy = ((along**2 + across**2) * area_weights).sum() / second**2
    assert ours == pytest.approx(1.0 / (pi * energy), rel=1e-3)


@pytest.mark.serial
def test_a_channel_is_that_of_the_other_solver() -> None:
    """Saint-Venant's problem by polynomials on a half (`Section.channel`), and by elements here."""
    width, height, web, flange = 0.08, 0.2, 0.01, 0.012
    known = ff.Section.channel(width, height, web, flange, STEEL)
    assert known.shape is not None
    mesh = ff.SectionMesh.of_outlines(known.shape.outline, size=0.005)
    found = ff.section_properties(mesh, STEEL)
    assert found.shear_centre == pytest.approx(known.shape.shear_centre, abs=2e-5)
    assert found.tension_centre == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.diagonal(found.stiffness) == pytest.approx(np.diagonal(known.stiffness), rel=5e-3)
    assert found.inertia == pytest.approx(known.inertia, rel=1e-9, abs=1e-9 * known.inertia.max())


# --- published composite sections ----------------------------------------------------------------


def ring(outer: np.ndarray, inner: np.ndarray, layers: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and quadrilaterals between two loops, layer after layer from the outer one."""
    count = len(outer)
    depth = np.linspace(0.0, 1.0, layers + 1)[:, None, None]
    points = (outer + depth * (inner - outer)).reshape(-1, 2)
    first = np.arange(count)
    after = (first + 1) % count
    rows = [[first, after, after + count, first + count] for _ in range(layers)]
    shifted = [np.array(row).T + count * layer for layer, row in enumerate(rows)]
    return points, np.concatenate(shifted)


def couplings(stiffness: np.ndarray) -> list[float]:
    """S11, S22, S33, S14, S25, S36, S44, S55, S66: all that a section of two equal halves has."""
    rows, columns = [0, 1, 2, 0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5, 3, 4, 5]
    return list(stiffness[rows, columns])


@pytest.mark.serial
def test_a_box_whose_fibres_wind_around_it() -> None:
    """Yu, Hodges, Ho (2012, doi:10.1016/j.ijengsci.2012.03.006), in inches and pounds.

    The tolerance is that of their mesh, on which the walls' joints at the corners matter most:
    fibres rotated by half a degree more change S11 by 1.6 % and S22 by 2.5 %.
    """
    a, b, wall = 0.4765, 0.265, 0.03
    ply = ff.OrthotropicMaterial(
        (20.59e6, 1.42e6, 1.42e6), (0.87e6, 0.87e6, 0.696e6), (0.30, 0.30, 0.34), 1.353e-4
    )

    def loop(inset: float) -> np.ndarray:
        y, z = a - inset, b - inset
        corners = np.array([[-y, -z], [y, -z], [y, z], [-y, z]])
        sides = zip(corners, np.roll(corners, -1, axis=0), (16, 8, 16, 8), strict=True)
        return np.concatenate(
            [start + np.arange(n)[:, None] / n * (end - start) for start, end, n in sides]
        )

    def around(points: np.ndarray) -> np.ndarray:
        y, z = points.T
        level = b - np.abs(z) < a - np.abs(y)
        flat, upright = np.where(z < 0.0, 0.0, pi), np.where(y > 0.0, 0.5 * pi, -0.5 * pi)
        return np.where(level, flat, upright)

    mesh = ff.SectionMesh(*ring(loop(0.0), loop(wall), 3))
    found = ff.section_properties(mesh, ff.OrientedMaterial(ply, pi / 12.0, around))
    assert couplings(found.stiffness) == pytest.approx(
        [1.437e6, 9.027e4, 3.943e4, 1.074e5, -5.201e4, -5.635e4, 1.679e4, 6.621e4, 1.725e5],
        rel=1e-3,
    )
    rest = found.stiffness.copy()
    rest[[0, 1, 2, 0, 1, 2, 3, 4, 5, 3, 4, 5], [0, 1, 2, 3, 4, 5, 3, 4, 5, 0, 1, 2]] = 0.0
    assert np.abs(rest).max() < 1e-6 * 1.437e6


@pytest.mark.serial
def test_a_pipe_of_two_layers() -> None:
    """Two flat walls, two half circles, two layers (Yu, Volovoi, Hodges, Hong 2005).

    The values are those that the manual of PreVABS quotes, in inches and pounds. Ours differ by up
    to 0.6 % on this mesh and 0.4 % on one twice as fine; exchanged layers change the couplings'
    signs, angles of 40 degrees S11 by 4 %.
    """
    ply = ff.OrthotropicMaterial(
        (20.59e6, 1.42e6, 1.42e6), (0.87e6,) * 3, (0.42,) * 3, 0.057
    )  # fmt: skip
    straight, bent, layers = 20, 20, 4

    def loop(radius: float) -> np.ndarray:
        y = -1.0 + 2.0 * np.arange(straight) / straight
        angle = pi * (np.arange(bent) / bent - 0.5)
        half = np.vstack(
            [
                np.column_stack([y, np.full(straight, -radius)]),
                np.column_stack([1.0 + radius * np.cos(angle), radius * np.sin(angle)]),
            ]
        )
        return np.vstack([half, -half])

    def around(points: np.ndarray) -> np.ndarray:
        y, z = points.T
        return np.arctan2(z, y - np.clip(y, -1.0, 1.0)) + 0.5 * pi

    points, cells = ring(loop(0.5), loop(0.3), layers)
    number = np.arange(len(cells))
    outer = number < len(cells) // 2
    flat = number % (straight + bent) < straight
    parts = {"flat_out": flat & outer, "flat_in": flat & ~outer}
    parts |= {"bent_out": ~flat & outer, "bent_in": ~flat & ~outer}
    angles = {"flat_out": 0.0, "flat_in": 0.5 * pi, "bent_out": 0.25 * pi, "bent_in": -0.25 * pi}
    found = ff.section_properties(
        ff.SectionMesh(points, cells, {name: number[part] for name, part in parts.items()}),
        {name: ff.OrientedMaterial(ply, angle, around) for name, angle in angles.items()},
    )
    assert couplings(found.stiffness) == pytest.approx(
        [
            1.03890e7, 7.84299e5, 3.29002e5, 9.82878e4, -8.18782e3, -5.18541e4,
            6.86973e5, 1.88236e6, 5.38972e6,
        ],
        rel=8e-3,
    )  # fmt: skip


# --- several and anisotropic materials -----------------------------------------------------------


@pytest.mark.serial
def test_two_materials_of_one_poisson_ratio() -> None:
    """Extension and bending of composite beams; the tension centre lies in the stiff half."""
    soft, hard = ff.Material(1e9, 0.3, 1000.0), ff.Material(3e9, 0.3, 2000.0)
    mesh = grid(0.1, 0.2, 4, 8)
    found = ff.section_properties(mesh, {"low": soft, "high": hard})
    assert found.stiffness[0, 0] == pytest.approx(4e9 * 0.01, rel=1e-9)
    assert found.tension_centre == pytest.approx([0.0, 0.025], abs=1e-9)
    bending = 4e9 * 0.1 * 0.1**3 / 12 + 4e9 * 0.01 * 0.05**2 - 4e9 * 0.01 * 0.025**2
    stiff, angle = found.principal_bending
    assert max(stiff) == pytest.approx(bending, rel=1e-9)
    assert angle == pytest.approx(0.0, abs=1e-6)
    assert found.mass_centre == pytest.approx([0.0, 0.05 / 3.0], abs=1e-12)


@pytest.mark.serial
def test_fibres_at_an_angle_couple_bending_and_twist() -> None:
    """Lekhnitskii's anisotropic bar: curvature s11 M / I, twist s16 M / (2 I), shear s16 N / A."""
    fibre, width, height = 0.5, 0.1, 0.2
    found = ff.section_properties(
        grid(width, height, 6, 6), ff.OrientedMaterial(PLY, fibre), degree=3
    )
    c, s = cos(fibre), sin(fibre)
    e1, e2, g12, nu12 = 40e9, 10e9, 10e9, 0.25
    s11 = c**4 / e1 + s**4 / e2 + (1 / g12 - 2 * nu12 / e1) * c * c * s * s
    s16 = (2 / e1 + 2 * nu12 / e1 - 1 / g12) * c**3 * s - (
        2 / e2 + 2 * nu12 / e1 - 1 / g12
    ) * c * s**3
    flexibility = np.linalg.inv(found.stiffness)
    area, i22 = width * height, width * height**3 / 12
    assert flexibility[0, 0] == pytest.approx(s11 / area, rel=1e-8)
    assert flexibility[1, 0] == pytest.approx(s16 / area, rel=1e-8)
    assert flexibility[4, 4] == pytest.approx(s11 / i22, rel=1e-8)
    assert abs(flexibility[3, 4]) == pytest.approx(abs(s16) / (2 * i22), rel=1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_flexibility_is_that_of_a_solid() -> None:
    """The energy in the middle of a solid cantilever of two anisotropic halves, six loads."""
    width, height, length, count = 1.0, 0.8, 9.0, 27
    low, high = ff.OrientedMaterial(PLY, 0.5), ff.OrientedMaterial(PLY, -0.3, 0.4)
    mesh = grid(width, height, 2, 2)
    found = ff.section_properties(mesh, {"low": low, "high": high})
    ours = np.linalg.inv(found.stiffness)
    theirs = solid_flexibility(mesh, {"low": low, "high": high}, length, count)
    size = np.sqrt(np.outer(np.diagonal(ours), np.diagonal(ours)))
    assert np.abs((theirs - ours) / size).max() < 2e-3
    assert np.abs(ours / size - np.eye(6)).max() > 0.1  # it couples


def solid_flexibility(
    mesh: ff.SectionMesh, materials: dict[str, ff.OrientedMaterial], length: float, count: int
) -> np.ndarray:
    """Flexibility from the strain energy of the middle third of a solid cantilever."""
    import basix.ufl
    import ufl
    from dolfinx import fem
    from dolfinx.mesh import create_mesh, locate_entities_boundary, meshtags
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    from flexfem.sections.section_material import elastic_matrices

    n, x = len(mesh.points), np.linspace(0.0, length, count + 1)
    points = np.column_stack([np.repeat(x, n), np.tile(mesh.points, (count + 1, 1))])
    quads = mesh.cells[:, [0, 1, 3, 2]]
    hexes = np.vstack([np.hstack([quads + i * n, quads + (i + 1) * n]) for i in range(count)])
    domain = create_mesh(
        MPI.COMM_SELF, hexes, basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,)), points
    )
    original = domain.topology.original_cell_index
    elastic = np.empty((len(quads), 6, 6))
    for name, rows in mesh.parts.items():
        elastic[rows] = elastic_matrices(materials[name], mesh.centres[rows])
    field = fem.Function(fem.functionspace(domain, ("DG", 0, (6, 6))))
    field.x.array[:] = np.tile(elastic, (count, 1, 1))[original].ravel()
    space = fem.functionspace(domain, ("Lagrange", 2, (3,)))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)

    def strain(w: object) -> object:
        e = ufl.sym(ufl.grad(w))
        shears = [2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]]
        return ufl.as_vector([e[0, 0], e[1, 1], e[2, 2], *shears])

    middle = np.flatnonzero((original // len(quads) >= count // 3) & (
        original // len(quads) < 2 * count // 3
    )).astype(np.int32)  # fmt: skip
    tags = meshtags(domain, 3, middle, np.ones(len(middle), dtype=np.int32))
    dx = ufl.Measure("dx", domain, subdomain_data=tags)
    energy = ufl.inner(strain(v), field * strain(u))
    stiff = fem.assemble_matrix(fem.form(energy * ufl.dx)).to_scipy().tocsr()
    part = fem.assemble_matrix(fem.form(energy * dx(1))).to_scipy().tocsr()
    # tractions of six unit resultants about the middle of the beam
    end = locate_entities_boundary(domain, 2, lambda p: np.isclose(p[0], length))
    ds = ufl.Measure("ds", domain, subdomain_data=meshtags(domain, 2, end, np.ones_like(end)))
    at = ufl.SpatialCoordinate(domain)
    arms = [ufl.as_vector(row) for row in np.eye(3).tolist()]
    arms += [
        ufl.as_vector([0, -at[2], at[1]]), ufl.as_vector([at[2], 0, 0]),
        ufl.as_vector([-at[1], 0, 0]),
    ]  # fmt: skip
    gram = np.array(
        [[fem.assemble_scalar(fem.form(ufl.inner(a, b) * ds(1))) for b in arms] for a in arms]
    )
    vectors = np.column_stack(
        [fem.assemble_vector(fem.form(ufl.inner(v, a) * ds(1))).array for a in arms]
    )
    along = np.zeros((6, 6))
    along[4, 2], along[5, 1] = 1.0, -1.0
    loads = vectors @ np.linalg.solve(gram, np.eye(6) + 0.5 * length * along)
    held = fem.locate_dofs_geometrical(space, lambda p: np.isclose(p[0], 0.0))
    fixed = (3 * held[:, None] + np.arange(3)).ravel()
    free = np.setdiff1d(np.arange(stiff.shape[0]), fixed)
    moves = np.zeros_like(loads)
    moves[free] = splu(csc_array(stiff[free][:, free])).solve(loads[free])
    total = moves.T @ (part @ moves)
    third = length / 3.0
    # total = third (F + third^2/12 T^T F T); T T = 0, so the correction needs only F's moments
    whole = total / third
    return whole - third**2 / 12.0 * along.T @ whole @ along


# --- axes, stresses, meshes ----------------------------------------------------------------------


@pytest.mark.serial
def test_axes_may_be_moved_and_turned() -> None:
    mesh = grid(0.1, 0.2, 4, 6)
    materials = {"low": ff.OrientedMaterial(PLY, 0.4, 0.2), "high": STEEL}
    first = ff.section_properties(mesh, materials)
    angle, shift = 0.7, np.array([3.0, -2.0])
    turn = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
    turned = ff.SectionMesh(mesh.points @ turn.T + shift, mesh.cells, mesh.parts)
    materials["low"] = ff.OrientedMaterial(PLY, 0.4, 0.2 + angle)
    second = ff.section_properties(turned, materials, reference=shift)
    rotation = np.eye(6)
    rotation[1:3, 1:3] = rotation[4:, 4:] = turn
    for name in ("stiffness", "inertia"):
        expected = rotation @ getattr(first, name) @ rotation.T
        scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
        assert np.abs((getattr(second, name) - expected) / scale).max() < 1e-9
    moved = ff.section_properties(mesh, materials | {"low": STEEL}, reference=(0.02, 0.05))
    assert moved.shear_centre == pytest.approx([-0.02, -0.05], abs=1e-9)
    assert moved.tension_centre == pytest.approx([-0.02, -0.05], abs=1e-9)
    # a force at the reference and moments that take it to (-0.02, -0.05): z N = -0.05
    stress = moved.stress([1.0, 0.0, 0.0, 0.0, -0.05, 0.02])
    assert stress[:, 0] == pytest.approx(np.full(len(mesh.cells), 50.0), rel=1e-9)


@pytest.mark.serial
def test_stresses_of_bending_and_tension() -> None:
    """Linear in the section, with no other components."""
    mesh = grid(0.1, 0.2, 4, 8)
    found = ff.section_properties(mesh, STEEL)
    stress = found.stress([100.0, 0.0, 0.0, 0.0, 2.0, 3.0])
    y, z = mesh.centres.T
    i22, i33 = 0.1 * 0.2**3 / 12, 0.2 * 0.1**3 / 12
    expected = 100.0 / 0.02 + 2.0 * z / i22 - 3.0 * y / i33
    assert stress[:, 0] == pytest.approx(expected, rel=1e-8, abs=1e-4)
    assert np.abs(stress[:, 1:]).max() < 1e-6 * np.abs(expected).max()
    assert found.warping([0, 0, 0, 1, 0, 0]).shape == (*found.nodes.shape[:1], 3)


@pytest.mark.serial
def test_torsion_converges_from_above() -> None:
    """Displacements of degree two: fourth order, and too stiff."""
    exact = ff.Section.rectangle(0.2, 0.1, STEEL).stiffness[3, 3]
    errors = [
        ff.section_properties(grid(0.2, 0.1, 2 * n, n), STEEL).stiffness[3, 3] / exact - 1.0
        for n in (2, 4, 8)
    ]
    assert errors[0] > errors[1] > errors[2] > 0.0
    assert errors[1] / errors[2] > 9.0


def test_all_ranks_have_the_same() -> None:
    found = ff.section_properties(grid(0.1, 0.2, 4, 4), ff.OrientedMaterial(PLY, 0.3)).stiffness
    for other in MPI.COMM_WORLD.allgather(found):
        assert (other == found).all()


@pytest.mark.serial
def test_a_beam_takes_the_section() -> None:
    found = ff.section_properties(grid(0.1, 0.2, 4, 4), STEEL)
    assert found.section.mass_per_length == pytest.approx(7850.0 * 0.02)


@pytest.mark.serial
def test_a_surface_mesh_is_a_section() -> None:
    surface = ff.SurfaceMesh.grid("plate", np.linspace(0, 0.1, 4), np.linspace(0, 0.2, 5))
    mesh = ff.SectionMesh.of_surface(surface)
    assert list(mesh.parts) == ["plate"]
    assert mesh.areas.sum() == pytest.approx(0.02)


def bad_mesh(points: object, cells: object, parts: object = None) -> Callable[[], object]:
    return lambda: ff.SectionMesh(points, cells, parts)


CORNERS = rectangle(1.0, 1.0)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("node 4 belongs to no cell", bad_mesh([*CORNERS, [9.0, 9.0]], [[0, 1, 2, 3]])),
        (
            "cells overlap at the edge",
            bad_mesh([*CORNERS, [0.0, 0.1]], [[0, 1, 2], [0, 1, 3], [1, 2, 4]]),
        ),
        (
            "2 pieces are apart",
            bad_mesh(
                [*CORNERS, [5.0, 0.0], [6.0, 0.0], [5.0, 1.0]], [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
            ),
        ),
        ("must be convex and have an area", bad_mesh([[0, 0], [1, 0], [2, 0]], [[0, 1, 2]])),
        ("cell 0 must be in one part, is in 0", bad_mesh(CORNERS, [[0, 1, 2, 3]], {})),
        (
            "sides of outline and holes must not cross",
            lambda: ff.SectionMesh.of_outlines([[0, 0], [1, 0], [0, 1], [1, 1]], size=0.1),
        ),
        (
            "holes must lie within",
            lambda: ff.SectionMesh.of_outlines(
                CORNERS, [[[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]]], size=0.2
            ),
        ),
        (
            "nodes must be in the plane",
            lambda: ff.SectionMesh.of_surface(
                ff.SurfaceMesh.grid("a", [0, 1], [0, 1], lambda p: np.column_stack([p, p[:, 0]]))
            ),
        ),
        (
            'part "low" has no material',
            lambda: ff.section_properties(grid(1, 1, 2, 2), {"high": STEEL}),
        ),
        (
            "no part 'spar'",
            lambda: ff.section_properties(
                grid(1, 1, 2, 2), {"low": STEEL, "high": STEEL, "spar": STEEL}
            ),
        ),
        (
            "must be less than 0.5",
            lambda: ff.section_properties(grid(1, 1, 2, 2), ff.Material(1e9, 0.5, 1.0)),
        ),
        (
            "degree must be 1, 2 or 3",
            lambda: ff.section_properties(grid(1, 1, 2, 2), STEEL, degree=4),
        ),
        (
            "at least one material must have a density",
            lambda: ff.section_properties(grid(1, 1, 2, 2), ff.Material(1e9, 0.3, 0.0)),
        ),
        (
            "leave the stiffness positive definite",
            lambda: ff.OrthotropicMaterial((1e9,) * 3, (1e9,) * 3, (0.9, 0.9, 0.9), 1.0),
        ),
        (
            "youngs_moduli must be positive",
            lambda: ff.OrthotropicMaterial((1e9, -1e9, 1e9), (1e9,) * 3, (0.3,) * 3, 1.0),
        ),
    ],
)
def test_bad_input_is_refused(message: str, make: Callable[[], object]) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert_on_page(str(caught.value))
