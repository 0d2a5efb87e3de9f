# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid surfaces of contacts as pictures show them: where they are, and which side is shown."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.io.paraview.contact_surfaces import ContactSurfaceWriter, surface_of
from flexfem.lie import se3, so3
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.contact_motion import sheet
from tests.unit.test_io import pvd, read

COMM = MPI.COMM_WORLD
#: Coordinates are stored in single precision, of lengths up to 10 m.
SINGLE = 2e-6
TURN = so3.exp(np.array([0.3, -0.4, 0.5]))
CENTRE, RADIUS = np.array([0.1, 0.2, -0.3]), 5.0
#: A point of the plane, far from the model.
AWAY = TURN @ [40.0, 20.0, -2.0]


def model() -> tuple[ff.Model, ff.RigidPlane]:
    """Sheets above a tilted plane, a roller without end, a bowl on a body and two-sided plate."""
    sheets = [sheet(name, 3, 1.0, (0.0, 0.0, z)) for name, z in (("cloth", 1.0), ("net", 2.0))]
    made = ff.Model("obstacles", surface=ff.SurfaceMesh.join(sheets))
    section = ff.ShellSection.isotropic(1e-3, ff.Material(2e8, 0.3, 1000.0))
    made.add(*(ff.Shell(name, section) for name in ("cloth", "net")))
    made.add(ff.RigidBody("arm", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0)))
    plane = ff.RigidPlane(ff.Ground(AWAY, TURN))
    bowl = ff.RigidSphere(ff.Marker("arm", offset=CENTRE), RADIUS, inside=True)
    roller = ff.RigidCylinder(ff.Ground((2.0, 0.0, -9.0)), 0.1)
    plate = ff.RigidMesh(ff.Ground(), mesh=sheet("plate", 3, 0.5, (0, 0, 0)), two_sided=True)
    made.add(ff.Contact("first", "cloth", surfaces=(plane, bowl)))
    made.add(ff.Contact("second", "net", surfaces=(plane, roller, plate)))
    return made, plane


def normals(mesh, triangles) -> np.ndarray:
    a, b, c = np.asarray(mesh.points, dtype=float)[triangles].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


@pytest.mark.three_ranks
def test_surfaces_are_where_contact_finds_them(shared_tmp_path: Path) -> None:
    simulation = Simulation(model()[0], RunOptions(dt=1e-3, t_end=1.0), COMM)
    system = simulation.system
    writer = ContactSurfaceWriter(shared_tmp_path, system, simulation.serial)
    writer.write(0.0, 0)
    block = next(part.block for part in system.parts if not part.elements)
    shift, spin = np.array([0.2, -0.1, 0.7]), np.array([0.5, -2.0, 1.0])
    if block.owned:
        block.frames[0] = se3.frame(np.array([1.0, 0.0, 0.0]) + shift, TURN)
        block.velocity[0] = [1.0, 2.0, 3.0, *spin]
    writer.write(0.5, 1)
    writer.close()
    if COMM.rank:
        return
    files = pvd(shared_tmp_path / "contact_surfaces.pvd")
    before, mesh = (read(shared_tmp_path / file) for _, file in files)
    triangles = mesh.cells.reshape(-1, 4)[:, 1:]
    points, body = np.asarray(mesh.points, dtype=float), np.asarray(mesh["body"])
    # that of both contacts is drawn once
    assert sorted(set(body.tolist())) == [0, 1, 2, 3]
    normal = normals(mesh, triangles)

    plane = np.unique(triangles[body == 0])
    # in the plane, also where that is far from the model, which it is to lie under
    assert np.abs((points[plane] - AWAY) @ TURN[:, 2]).max() < 50 * SINGLE
    assert np.linalg.norm(points[plane].mean(axis=0)) < 4.0
    assert (normal[body == 0] @ TURN[:, 2] > 0.0).all()

    bowl = np.unique(triangles[body == 1])
    centre = np.array([1.0, 0.0, 0.0]) + shift + TURN @ CENTRE
    arm = points[bowl] - centre
    # the body's place instead of the marker's would be off by 0.37 m
    assert np.abs(np.linalg.norm(arm, axis=1) - RADIUS).max() < 2 * SINGLE
    middle = points[triangles[body == 1]].mean(axis=1) - centre
    assert (np.einsum("mi,mi->m", normal[body == 1], middle) < 0.0).all()  # seen from inside
    lever = points[bowl] - shift - [1.0, 0.0, 0.0]
    velocity = TURN @ [1.0, 2.0, 3.0] + np.cross(TURN @ spin, lever)
    assert np.abs(mesh["velocity"][bowl] - velocity).max() < 20 * SINGLE
    moved = points - np.asarray(before.points, dtype=float)
    assert np.abs(mesh["displacement"] - moved).max() < 5 * SINGLE
    assert np.abs(moved[bowl]).max() > 0.3
    assert not moved[plane].any()

    roller = points[np.unique(triangles[body == 2])]
    rim = np.linalg.norm(roller[:, :2] - [2.0, 0.0], axis=1)
    assert np.abs(rim[rim > 1e-6] - 0.1).max() < SINGLE
    assert roller[:, 2].min() < 0.0 < 1.0 < roller[:, 2].max()  # as far as the model reaches

    plate = normal[body == 3]
    assert len(plate) == 16
    assert (plate[:, 2] > 0.0).sum() == 8


@pytest.mark.serial
def test_obstacles_by_their_distance_are_closed_surfaces() -> None:
    def torus(x: np.ndarray) -> np.ndarray:
        return np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2]) - 0.3

    box = [(-1.4, -1.4, -0.4), (1.4, 1.4, 0.4)]
    ring = ff.RigidObstacle(ff.Ground(), torus, box)
    drawn = surface_of(ring, np.zeros((2, 3)), se3.exp(np.zeros(6)))
    assert np.abs(torus(drawn.points)).max() < 1e-14
    edges = np.sort(drawn.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    x = drawn.points[drawn.triangles]
    volume = np.einsum("ma,ma->", x[:, 0], np.cross(x[:, 1], x[:, 2])) / 6.0
    # normals outwards; chords of 40 cells take a quarter of a percent
    assert volume == pytest.approx(2.0 * np.pi**2 * 0.3**2, rel=5e-3)


@pytest.mark.serial
def test_picture_shows_obstacles_without_shrinking_what_moves(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    from flexfem.cli import command

    sizes = []
    for name, radius in (("none", 0.0), ("ball", 0.3), ("planet", 300.0)):
        made = ff.Model("drop", surface=sheet("cloth", 3, 1.0, (0.0, 0.0, 0.35), 0.1))
        made.add(ff.Shell("cloth", ff.ShellSection.isotropic(1e-3, ff.Material(2e8, 0.3, 1e3))))
        if radius:
            place = ff.Ground((0.0, 0.0, 0.3 - radius))
            made.add(ff.Contact("touch", "cloth", surfaces=ff.RigidSphere(place, radius)))
        folder = tmp_path / name
        settings = RunOptions(dt=1e-3, t_end=1e-3, output=folder, quiet=True)
        assert ff.simulate(made, settings).status == "ok"
        argv = ["render", str(folder), "--size", "240x160", "--time", "0", "--view", "0,-1,0.5"]
        assert command(argv) == 0
        import imageio.v3 as iio

        image = np.asarray(iio.imread(folder / "still.png"))[..., :3].astype(int)
        blue = (image[..., 2] - image[..., 0] > 40).any(axis=0).sum()  # columns of the sheet
        grey = ((np.ptp(image, axis=-1) < 30) & (image.sum(axis=-1) < 690))[30:, 40:200].sum()
        sizes.append((int(blue), int(grey)))
    # a ball below the sheet takes four thousand pixels; axes and text alone a hundred
    assert sizes[0][1] + 300 < sizes[1][1]
    # the camera goes a little further away, not to where a ball of 300 m is in view
    assert sizes[2][0] > 0.5 * sizes[0][0]
