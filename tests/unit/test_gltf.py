# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions as glTF files, read by VTK: everything is where the series of the run have it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.vtu.series import VtuSeries
from tests.unit.refusals import assert_on_page
from tests.unit.swing import EVIL, mechanism
from tests.unit.unpacked import farthest, files

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("gltf") / "swing"
    options = ff.RunOptions(dt=0.02, t_end=0.2, every=1, quiet=True, output=made)
    assert ff.simulate(mechanism(), options).status == "ok"
    assert cli.command(["view", "--gltf", str(made)]) == 0
    return made


def meshes(block: Any) -> Iterator[np.ndarray]:
    """Points of all meshes that VTK has read."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    for number in range(block.GetNumberOfBlocks()):
        inner = block.GetBlock(number)
        if inner is not None and inner.IsA("vtkMultiBlockDataSet"):
            yield from meshes(inner)
        elif inner is not None:
            yield vtk_to_numpy(inner.GetPoints().GetData())


def read(file: Path, time: float) -> list[np.ndarray]:
    """Points of all meshes at a time, with z upwards again."""
    reading = pytest.importorskip("vtkmodules.vtkIOGeometry")
    reader = reading.vtkGLTFReader()
    reader.SetFileName(str(file))
    reader.ApplyDeformationsToGeometryOn()
    reader.UpdateInformation()
    reader.EnableAnimation(0)
    reader.SetFrameRate(50)
    reader.UpdateInformation()
    reader.UpdateTimeStep(time)
    return [points[:, [0, 2, 1]] * [1.0, -1.0, 1.0] for points in meshes(reader.GetOutput())]


@pytest.mark.parametrize("number", [0, 4, 10])
def test_vtk_finds_everything_where_the_run_had_it(number: int, folder: Path) -> None:
    """Single precision over 1 m is 1e-7 m, which rotations of 1 m enlarge little."""
    found = read(folder / "view.glb", 0.02 * number)
    for series in ("rigid_bodies", "beam_surfaces"):
        points = list(files(folder, series))[number].points
        assert min(farthest(points, mesh) for mesh in found) < 2e-6
        assert min(farthest(mesh, points) for mesh in found) < 2e-6


def test_file_says_what_it_holds(folder: Path) -> None:
    data = (folder / "view.glb").read_bytes()
    assert data[:4] == b"glTF"
    version, total, size = np.frombuffer(data, "<u4", 3, 4)
    assert (version, total) == (2, len(data))
    scene = json.loads(data[20 : 20 + size])
    assert [mesh["name"] for mesh in scene["meshes"]] == [EVIL, "rod", "hinge", "weld"]
    for view in scene["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= scene["buffers"][0]["byteLength"]


@pytest.fixture(scope="module")
def soft(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sheet and a mass on a cable that fall, and a solid that is turned and stretched."""
    made = tmp_path_factory.mktemp("gltf") / "soft"
    sheet = ff.ShellSection.isotropic(0.002, ff.Material(2e9, 0.35, 1200.0))
    surface = ff.SurfaceMesh.rectangle("sheet", (0.4, 0.2), (4, 2))
    model = ff.Model("soft", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", sheet, edges={"sheet_left": "clamped"}),
        ff.RigidBody("bob", 1.0, (0.01, 0.01, 0.01), position=(1.0, 0.0, -1.0)),
        ff.Cable("stay", [ff.Ground((0.8, 0.0, 0.0)), ff.Marker("bob")], tension_only=False),
    )
    options = ff.RunOptions(dt=0.02, t_end=0.2, every=1, quiet=True, output=made)
    assert ff.simulate(model, options).status == "ok"
    solid = VtuSeries(made, "energy_solids", MPI.COMM_SELF)
    corners = np.vstack([np.zeros(3), np.eye(3), np.ones(3)]) + 100.0
    for step in range(11):
        turn = np.array(
            [(1.0, 0.1 * step, 0.0), (-0.1 * step, 1.0 + 0.02 * step**2, 0.0), (0, 0, 1)]
        )
        cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
        solid.write(0.02 * step, step, corners @ turn, cells, "tetra")
    solid.close()
    assert cli.command(["view", "--gltf", str(made)]) == 0
    return made


@pytest.mark.parametrize("number", [0, 4, 10])
def test_vtk_finds_what_deforms_where_the_run_had_it(number: int, soft: Path) -> None:
    """Single precision over 200 m; another instant is off by a centimetre."""
    found = read(soft / "view.glb", 0.02 * number)
    for series in ("shells", "cables", "energy_solids"):
        points = list(files(soft, series))[number].points
        assert min(max(farthest(points, mesh), farthest(mesh, points)) for mesh in found) < 3e-5


class Parsed:
    """The arrays of a file by its description."""

    def __init__(self, file: Path) -> None:
        data = file.read_bytes()
        (size,) = np.frombuffer(data, "<u4", 1, 12)
        self.scene, self._data = json.loads(data[20 : 20 + size]), data[28 + size :]

    def array(self, number: int) -> np.ndarray:
        one = self.scene["accessors"][number]
        view = self.scene["bufferViews"][one["bufferView"]]
        kind = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[one["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[one["type"]]
        values = np.frombuffer(self._data, kind, one["count"] * width, view["byteOffset"])
        return values.reshape(one["count"], width)

    def mesh(self, name: str) -> tuple[np.ndarray, dict, dict]:
        """Place of a mesh, its only primitive, and the channel that moves its targets."""
        meshes, nodes = self.scene["meshes"], self.scene["nodes"]
        at = next(k for k, n in enumerate(nodes) if n.get("name") == name and "mesh" in n)
        animation = self.scene["animations"][0]
        (channel,) = (c for c in animation["channels"] if c["target"].get("node") == at)
        sampler = animation["samplers"][channel["sampler"]]
        return (
            np.array(nodes[at]["translation"]),
            meshes[nodes[at]["mesh"]]["primitives"][0],
            sampler,
        )


@pytest.mark.parametrize(("series", "name"), [("shells", "sheet"), ("cables", "stay")])
def test_targets_and_normals_are_those_of_the_files(series: str, name: str, soft: Path) -> None:
    parsed = Parsed(soft / "view.glb")
    place, primitive, sampler = parsed.mesh(name)
    times, weights = parsed.array(sampler["input"])[:, 0], parsed.array(sampler["output"])
    np.testing.assert_allclose(times, 0.02 * np.arange(11), rtol=1e-6)
    weights = weights.reshape(11, 10)
    listed = primitive["targets"]
    targets = {key: np.array([parsed.array(one[key]) for one in listed]) for key in listed[0]}
    for number, grid in enumerate(files(soft, series)):
        found = {
            key: parsed.array(at) + np.tensordot(weights[number], targets[key], 1)
            for key, at in primitive["attributes"].items()
        }
        points = place + found["POSITION"]
        # single precision of a metre; another instant is off by a millimetre, the first by 1e-5
        assert farthest(points, grid.points) < 2e-7
        assert farthest(grid.points, points) < 2e-7
        if series == "shells":
            a, b, c = np.swapaxes(points[parsed.array(primitive["indices"]).reshape(-1, 3)], 0, 1)
            face = np.cross(b - a, c - a)
            face /= np.linalg.norm(face, axis=1)[:, None]
            of_corner = found["NORMAL"][parsed.array(primitive["indices"]).reshape(-1, 3)]
            # triangles differ from their mean by a few degrees; normals of the start by 60
            assert np.einsum("tkj,tj->tk", of_corner, face).min() > 0.9


def test_folders_of_arrows_alone_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    series = VtuSeries(tmp_path, "reactions", MPI.COMM_SELF)
    series.write(0.0, 0, np.eye(3), np.array([[0], [1], [2]]), "vertex")
    series.close()
    assert cli.command(["view", "--gltf", str(tmp_path)]) == 2
    text = capsys.readouterr().err
    assert "nothing but arrows" in text
    assert_on_page(text.removeprefix("error: ").rstrip())
    assert not (tmp_path / "view.glb").exists()
