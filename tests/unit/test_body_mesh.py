# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of bodies from gmsh: groups by name, on all ranks, and clear refusals."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

import flexfem as ff

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
COARSE = {"size": 0.03}


def test_a_connecting_rod_and_its_bores() -> None:
    rod = ff.build_body_mesh("connecting_rod", length=0.4, **COARSE)
    assert {"rod", "big_end", "small_end"} == set(rod.groups)
    one = fem.Constant(rod.mesh, 1.0)
    volume = COMM.allreduce(fem.assemble_scalar(fem.form(one * ufl.dx(rod.mesh))))
    # eyes and shank less their overlap: chords of round faces lose some per cent
    eyes = np.pi * 0.03 * sum((r + 0.012) ** 2 - r**2 for r in (0.025, 0.015))
    shank = 0.03 * 0.03 * (0.4 - 0.037 - 0.027)
    assert volume == pytest.approx(eyes + shank, rel=0.1)
    for name, radius in (("big_end", 0.025), ("small_end", 0.015)):
        tags, tag = rod.facets(name)
        area = fem.form(one * ufl.Measure("ds", rod.mesh, tag, subdomain_data=tags))
        found = COMM.allreduce(fem.assemble_scalar(area))
        assert found == pytest.approx(2.0 * np.pi * radius * 0.03, rel=0.1)
    regions = {name: rod.facets(name) for name in ("big_end", "small_end")}
    body = ff.reduce_body(ff.solid_body(rod.mesh, STEEL, 1), regions, modes=1)
    # centroids of bores: coarse facets are not symmetric; the other eye is far away
    np.testing.assert_allclose(body.interfaces[0].position, np.zeros(3), atol=2e-3)
    np.testing.assert_allclose(body.interfaces[1].position, [0.4, 0, 0], atol=2e-3)
    assert body.mass == pytest.approx(7850.0 * volume, rel=1e-10)


@pytest.mark.serial
def test_a_band_around_the_middle_of_the_rod() -> None:
    rod = ff.build_body_mesh("connecting_rod", gauge=0.01, **COARSE)
    tags, tag = rod.facets("middle")
    x = ufl.SpatialCoordinate(rod.mesh)
    band = ufl.Measure("ds", rod.mesh, tag, subdomain_data=tags)
    area, place = (
        fem.assemble_scalar(fem.form(f * band)) for f in (fem.Constant(rod.mesh, 1.0), x[0])
    )
    # four sides; a face between the pieces would add 9e-4 m^2
    assert area == pytest.approx(4.0 * 0.03 * 0.01, rel=1e-9)
    assert place / area == pytest.approx(0.3, rel=1e-9)
    with pytest.raises(ValueError, match="gauge 0\\.6 is negative"):
        ff.build_body_mesh("connecting_rod", gauge=0.6)


@pytest.mark.serial
def test_a_flat_mesh_in_space_may_move_in_its_plane_only() -> None:
    plate = ff.build_body_mesh("plate_with_hole", size=0.1, hole_size=0.05)
    regions = {name: plate.facets(name) for name in ("left", "right")}
    body = ff.reduce_body(
        ff.plane_body(plate.mesh, 0.01, STEEL),
        regions,
        modes=1,
        ties=dict.fromkeys(regions, "average"),
    )
    assert body.held.reshape(2, 6).tolist() == [[False, False, True, True, True, False]] * 2
    solid = STEEL.youngs_modulus * 0.5 * 0.01 / 1.0
    # a hole in an infinite plate adds 3 pi a^2 / area to the compliance; sides at 2.5 radii some
    # more. Without the hole, or with all of it clamped, the ratio is 1 or more
    dilute = 1.0 / (1.0 + 3.0 * np.pi * 0.01 / 0.5)
    assert 0.95 * dilute < body.stiffness[0, 0] / solid < dilute
    # a polygon instead of the round hole: a few per cent of its area
    assert body.mass == pytest.approx(7850.0 * 0.01 * (0.5 - np.pi * 0.01), rel=5e-3)


@pytest.mark.serial
def test_wrong_meshes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="connecting_rod: no room for a shank"):
        ff.build_body_mesh("connecting_rod", length=0.05)
    with pytest.raises(ValueError, match='mesh "chain": no named group of solids or surfaces'):
        ff.build_body_mesh("chain")
    with pytest.raises(ValueError, match='has no parameter "bore"'):
        ff.build_body_mesh("connecting_rod", bore=0.1)
    with pytest.raises(ValueError, match=r'mesh file ".*none.msh" does not exist'):
        ff.read_body_mesh(tmp_path / "none.msh")
    rod = ff.build_body_mesh("connecting_rod", **COARSE)
    with pytest.raises(ValueError, match="no facet group 'eye'; there are big_end, small_end"):
        rod.facets("eye")


@pytest.mark.serial
def test_a_file_is_the_mesh_that_was_written(tmp_path: Path) -> None:
    import gmsh

    from flexfem.mesh.imported.gmsh_model import session
    from flexfem.mesh.library import checked_build

    path = tmp_path / "rod.msh"
    with session("test"):
        checked_build("connecting_rod", COARSE)(**COARSE)
        gmsh.write(str(path))
    read, built = ff.read_body_mesh(path), ff.build_body_mesh("connecting_rod", **COARSE)
    assert read.groups == built.groups
    assert len(read.mesh.geometry.x) == len(built.mesh.geometry.x)
    assert len(read.facets("big_end")[0].values) == len(built.facets("big_end")[0].values)
