# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions as glTF files, read by VTK: everything is where the series of the run have it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def test_folders_of_meshes_alone_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mpi4py import MPI

    series = VtuSeries(tmp_path, "shells", MPI.COMM_SELF)
    series.write(0.0, 0, np.eye(3), np.array([[0, 1, 2]]), "triangle")
    series.close()
    assert cli.command(["view", "--gltf", str(tmp_path)]) == 2
    text = capsys.readouterr().err
    assert "no beams, rigid bodies or joints" in text
    assert_on_page(text.removeprefix("error: ").rstrip())
    assert not (tmp_path / "view.glb").exists()
