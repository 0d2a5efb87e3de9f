# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models on imported meshes against the same ones on the library's own, and closed forms."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
STEEL = ff.Material(210e9, 0.3, 7850.0)


def written(folder: Path, name: str, lines: list[str]) -> Path:
    """A file that the first rank writes and all may read."""
    if COMM.rank == 0:
        (folder / name).write_text("\n".join(lines) + "\n")
    COMM.Barrier()
    return folder / name


def solved(model: ff.Model) -> dict[str, np.ndarray]:
    """Columns of a static history (collective)."""
    outcome = ff.solve_static(model, ff.StaticOptions())
    assert outcome.status == "ok"
    return {key: np.asarray(values) for key, values in outcome.history.items()}


def cantilever(mesh: ff.LineMesh, tip: str) -> ff.Model:
    """A rod of 1 m along x with 10 N down at its end."""
    model = ff.Model("cantilever", mesh=mesh)
    end = ff.Marker("rod", tip)
    model.add(
        ff.Beam("rod", ff.Section.circle(0.02, STEEL), group="ROD"),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", 0.0)),
        ff.PointForce("load", end, (0.0, 0.0, -10.0)),
        ff.Probe("tip", end, ("z",), lambda t, at: [at.position[2]]),
    )
    return model


def test_beam_of_a_nastran_file_in_millimetres(shared_tmp_path) -> None:
    x = np.linspace(0.0, 1000.0, 9)
    lines = ["BEGIN BULK", *(f"GRID,{i + 1},,{v:.1f},0.,0." for i, v in enumerate(x))]
    lines += [f"CBAR,{i},1,{i},{i + 1},0.,1.,0." for i in range(1, 9)]
    lines += ["SET1,1,9", "PBAR,1,1", "ENDDATA"]
    path = written(shared_tmp_path, "rod.bdf", lines)
    read = ff.read_mesh(path, scale=1e-3)
    mesh = ff.LineMesh(read.points, read.cells, {"ROD": read.line_groups["property_1"]},
                       read.point_groups)  # fmt: skip
    imported = solved(cantilever(mesh, "set_1"))
    native = solved(cantilever(ff.LineMesh.straight({"ROD": [[0, 0, 0], [1, 0, 0]]}, 8), "end"))
    if COMM.rank == 0:
        # the same equations: round-off only; a factor of 1000 in lengths is one of 1e9 here
        np.testing.assert_allclose(imported["z"], native["z"], rtol=1e-9)
        bending = 10.0 / (3.0 * 210e9 * np.pi * 0.02**4 / 64.0)
        # two-node elements are too soft or stiff by 1/(4 n^2) = 0.4 %, shear adds 0.03 %
        assert -imported["z"][-1] == pytest.approx(bending, rel=6e-3)


FRAME = """*NODE
1, 0, 0, 0
2, 0, 0, 500
3, 0, 0, 1000
4, 400, 0, 1000
5, 800, 0, 1000
6, 0, 600, 1000
*ELEMENT, TYPE=B31, ELSET=MAST
1, 1, 2
2, 2, 3
*ELEMENT, TYPE=B31, ELSET=ARM
3, 3, 4
4, 4, 5
*ELEMENT, TYPE=B31, ELSET=STAY
5, 3, 6
*NSET, NSET=FOOT
1
*NSET, NSET=HOOK
5
*ELSET, ELSET=FRAME
1, 2, 3, 4, 5"""


def test_beams_that_share_nodes_in_the_file_are_welded(shared_tmp_path) -> None:
    path = written(shared_tmp_path, "frame.inp", FRAME.split("\n"))

    def frame(mesh: ff.LineMesh, groups: list[str], hook: str) -> ff.Model:
        tube = ff.Section.tube(0.02, 0.03, STEEL)
        model = ff.Model("frame", mesh=mesh)
        beams = [ff.Beam(name.lower(), tube, group=name) for name in groups]
        end = ff.Marker(hook, "HOOK")
        model.add(
            *beams,
            *ff.weld(mesh, beams),
            ff.Rigid("clamp", ff.Ground(), ff.Marker(groups[0].lower(), "FOOT")),
            ff.PointForce("load", end, (0.0, 50.0, -100.0)),
            ff.Probe("hook", end, ("x", "y", "z"), lambda t, at: at.position.tolist()),
        )
        return model

    groups = ["MAST", "ARM", "STAY"]
    apart = ff.read_mesh(path, scale=1e-3, lines=groups, separate=True)
    assert len(apart.points) == 8
    places = {name: apart.points[node].tolist() for name, node in apart.point_groups.items()}
    corner = [0.0, 0.0, 1.0]
    assert places == {
        "FOOT": [0.0, 0.0, 0.0],
        "HOOK": [0.8, 0.0, 1.0],
        **{f"{name}_seam_1": corner for name in groups},
    }
    model = frame(apart, groups, "arm")
    assert [joint.name for joint in model.joints] == ["mast_arm", "mast_stay", "clamp"]
    welded = solved(model)
    whole = solved(frame(ff.read_mesh(path, scale=1e-3, lines=["FRAME"]), ["FRAME"], "frame"))
    if COMM.rank == 0:
        for axis in "xyz":  # a hinge instead of a weld has no equilibrium at all
            np.testing.assert_allclose(welded[axis], whole[axis], rtol=1e-8, atol=1e-10)
        # mast and arm as cantilevers in small displacements: load L_arm (L_mast + L_arm / 3)
        bending = 210e9 * np.pi * (0.03**4 - 0.02**4) / 64.0
        sag = 100.0 * 0.8**2 * (1.0 + 0.8 / 3.0) / bending
        # finite displacements 2 %, elements of half the length 1/(4 n^2) = 6 %
        assert 1.0 - welded["z"][-1] == pytest.approx(sag, rel=0.1)


def plate(mesh: ff.SurfaceMesh, edge: str, corner: str) -> ff.Model:
    """A plate of 1 m x 0.5 m that is clamped on the left and has a force at a corner."""
    model = ff.Model("plate", surface=mesh)
    section = ff.ShellSection.isotropic(0.01, STEEL)
    point = ff.Marker("plate", corner)
    model.add(
        ff.Shell("plate", section, body="plate", edges={edge: "clamped"}),
        ff.PointForce("load", point, (0.0, 0.0, 50.0)),
        ff.Probe("corner", point, ("z",), lambda t, at: [at.position[2]]),
    )
    return model


def test_shell_of_quadrilaterals_in_millimetres(shared_tmp_path) -> None:
    nx, ny = 6, 4
    rows = [(i, j) for j in range(ny + 1) for i in range(nx + 1)]
    lines = ["*NODE"]
    lines += [f"{k + 1}, {i / nx * 1e3!r}, {j / ny * 500.0!r}, 0" for k, (i, j) in enumerate(rows)]
    lines += ["*ELEMENT, TYPE=S4R, ELSET=plate"]
    for j in range(ny):
        for i in range(nx):
            a = 1 + i + (nx + 1) * j
            lines.append(f"{1 + i + nx * j}, {a}, {a + 1}, {a + nx + 2}, {a + nx + 1}")
    lines += ["*NSET, NSET=CLAMPED, GENERATE", f"1, {1 + (nx + 1) * ny}, {nx + 1}"]
    lines += ["*NSET, NSET=LOADED", f"{(nx + 1) * (ny + 1)}"]
    path = written(shared_tmp_path, "plate.inp", lines)
    imported = solved(plate(ff.read_surface_mesh(path, scale=1e-3), "CLAMPED", "LOADED"))
    own = ff.SurfaceMesh.rectangle("plate", (1.0, 0.5), (nx, ny))
    native = solved(plate(own, "plate_left", "plate_top_right"))
    if COMM.rank == 0:
        # the same equations: the clamp at another edge or diagonals the other way change a per cent
        np.testing.assert_allclose(imported["z"], native["z"], rtol=1e-9)
        assert imported["z"][-1] > 1e-3


def test_solid_of_an_abaqus_file_in_millimetres(shared_tmp_path) -> None:
    from dolfinx import mesh

    n = (6, 2, 2)
    size = (0.6, 0.05, 0.04)
    counts = [k + 1 for k in n]

    def number(i: int, j: int, k: int) -> int:
        return 1 + i + counts[0] * (j + counts[1] * k)

    lines = ["*NODE"]
    for k, j, i in np.ndindex(*counts[::-1]):
        x, y, z = (1e3 * s * a / m for s, a, m in zip(size, (i, j, k), n, strict=True))
        lines.append(f"{number(i, j, k)}, {x!r}, {y!r}, {z!r}")
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=BAR")
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for count, (k, j, i) in enumerate(np.ndindex(*n[::-1]), 1):
        nodes = [number(i + a, j + b, k + c) for c in (0, 1) for a, b in around]
        lines.append(f"{count}, {', '.join(map(str, nodes))}")
    lines.append("*NSET, NSET=LEFT")
    lines += [f"{number(0, j, k)}" for k in range(counts[2]) for j in range(counts[1])]
    right = [1 + (n[0] - 1) + n[0] * m for m in range(n[1] * n[2])]
    lines += ["*ELSET, ELSET=_right, INTERNAL", ", ".join(map(str, right))]
    lines += ["*SURFACE, NAME=RIGHT", "_right, S4"]
    path = written(shared_tmp_path, "bar.inp", lines)

    read = ff.read_body_mesh(path, scale=1e-3)
    assert set(read.groups) == {"BAR", "LEFT", "RIGHT"}
    own = mesh.create_box(COMM, [[0.0] * 3, size], n, mesh.CellType.hexahedron)
    regions = {"LEFT": lambda x: x[0] < 1e-9, "RIGHT": lambda x: x[0] > size[0] - 1e-9}
    found = [
        ff.reduce_body(ff.solid_body(domain, STEEL, 1), ends, modes=2, recovery=False)
        for domain, ends in ((read.mesh, {k: read.facets(k) for k in regions}), (own, regions))
    ]
    imported, native = found
    assert imported.mass == pytest.approx(7850.0 * np.prod(size), rel=1e-12)
    # two numberings of one mesh: what eigensolvers leave; one facet missing changes a per cent
    np.testing.assert_allclose(imported.frequencies, native.frequencies, rtol=1e-7)
    scale = abs(native.stiffness[:12, :12]).max()
    np.testing.assert_allclose(
        imported.stiffness[:12, :12], native.stiffness[:12, :12], atol=1e-9 * scale
    )
    for one, other in zip(imported.interfaces, native.interfaces, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-12)
