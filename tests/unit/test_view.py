# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of result folders: what they hold is what the files hold, and nothing harmful."""

import base64
import html
import json
import re
import shutil
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.scene_file import SceneFile
from flexfem.io.tables.history import read_history
from flexfem.io.view.content import Choice, Content, gather
from flexfem.io.view.packing import MISSING
from flexfem.io.vtu.reader import read_index, read_pieces
from tests.unit.refusals import assert_on_page
from tests.unit.swing import EVIL, EVIL_COLUMN, mechanism

pytestmark = pytest.mark.serial


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results of ten steps."""
    folder = tmp_path_factory.mktemp("results") / "swing"
    options = ff.RunOptions(dt=0.02, t_end=0.2, every=1, quiet=True, output=folder)
    assert ff.simulate(mechanism(), options).status == "ok"
    return folder


@pytest.fixture
def copy(results: Path, tmp_path: Path) -> Path:
    """A copy of the folder, to damage."""
    return Path(shutil.copytree(results, tmp_path / "swing"))


class Unpacked:
    """The other side of packing, written from its description."""

    def __init__(self, content: Content) -> None:
        self.scene, self._data = content.scene, content.data
        self.layers = {layer["series"]: layer for layer in content.scene["layers"]}

    def array(self, reference: Mapping[str, Any]) -> np.ndarray:
        start = reference["at"]
        raw = zlib.decompress(self._data[start : start + reference["bytes"]])
        shape = reference["shape"]
        if "order" not in reference:
            return np.frombuffer(raw, reference["type"]).reshape(shape)
        low, high = np.frombuffer(raw, np.uint8).reshape(2, -1).astype(np.int64)
        folded = low + 256 * high
        values = np.where(folded % 2, -(folded + 1) // 2, folded // 2).reshape(shape)
        for _ in range(reference["order"]):
            values = np.cumsum(values, axis=0)
        return (values + 2**15) % 2**16 - 2**15

    def places(self, motion: Mapping[str, Any]) -> np.ndarray:
        return motion["middle"] + motion["half"] * self.array(motion["places"]) / 32767

    def turns(self, motion: Mapping[str, Any]) -> np.ndarray:
        """Rotations (instants, n, 3, 3), by the formula of Rodrigues."""
        q = self.array(motion["turns"]) / 32767
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
        v, w = q[..., :3], q[..., 3:]
        eye = np.eye(3)
        cross = np.stack([np.cross(v, e) for e in eye], axis=-1)
        return eye + 2 * (w[..., None] * cross + cross @ cross)

    def vertices(self, series: str) -> np.ndarray:
        """Places of the vertices of a surface in frames (instants, v, 3)."""
        layer = self.layers[series]
        frame, local = self.array(layer["frame"]), self.array(layer["local"])
        turned = np.einsum("tvij,vj->tvi", self.turns(layer["motion"])[:, frame], local)
        return self.places(layer["motion"])[:, frame] + turned

    def field(self, series: str, name: str) -> np.ndarray:
        (one,) = (f for f in self.layers[series]["fields"] if f["name"] == name)
        whole = self.array(one["values"])
        assert not np.any(whole == MISSING)
        return one["low"] + (whole + 32767) / 65534 * (one["high"] - one["low"])


@pytest.fixture(scope="session")
def unpacked(results: Path) -> Unpacked:
    return Unpacked(gather(results, Choice()))


def files(folder: Path, series: str) -> Iterator[Any]:
    for instant in read_index(folder / f"{series}.pvd", series):
        yield from read_pieces(instant.file)


def farthest(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of a point of one set to the other set."""
    return float(np.linalg.norm(one[:, None] - other, axis=2).min(axis=1).max())


# Half a step of 16 bits over this motion is 2e-5 m, that of rotations as much at the box. A wrong
# order of vertices, nodes or axes is off by the size of a section, 0.03 m, or more.
TOLERANCE = 1e-4


@pytest.mark.parametrize("pair", [("beams", "beam_surfaces"), ("rigid_bodies", "rigid_bodies")])
def test_surfaces_are_those_of_the_files(
    pair: tuple[str, str], results: Path, unpacked: Unpacked
) -> None:
    """Swept by the page from the lines, and written by the run point by point."""
    vertices = unpacked.vertices(pair[0])
    grids = list(files(results, pair[1]))
    assert len(grids) == len(vertices) == 11
    for found, grid in zip(vertices, grids, strict=True):
        assert farthest(found, grid.points) < TOLERANCE
        assert farthest(grid.points, found) < TOLERANCE
    assert np.ptp(vertices, axis=0).max() > 0.1  # it moves


def test_joints_are_those_of_the_files(results: Path, unpacked: Unpacked) -> None:
    found = unpacked.vertices("joints")
    rods = 8 * 2  # of two joints: boxes without length, which a page leaves out
    for vertices, grid in zip(found, files(results, "joints"), strict=True):
        assert farthest(grid.points[:-rods], vertices) < TOLERANCE
    assert unpacked.layers["joints"]["names"] == ["hinge", "weld"]
    assert unpacked.layers["joints"]["kinds"] == ["Revolute", "Rigid"]


def test_stresses_follow_from_resultants(results: Path, unpacked: Unpacked) -> None:
    """Factors at the vertices times resultants are the stresses that the run wrote there."""
    layer = unpacked.layers["beams"]
    names = ("N", "Q2", "Q3", "T", "M2", "M3")
    resultants = np.stack([unpacked.field("beams", name) for name in names], axis=-1)
    factors = unpacked.array(layer["stress"]["factors"]).reshape(-1, 2, 6)
    row, cell = unpacked.array(layer["stress"]["row"]), unpacked.array(layer["cell"])
    found = np.einsum("vij,tvj->tvi", factors[row], resultants[:, cell])
    for stress, vertices, grid in zip(
        found, unpacked.vertices("beams"), files(results, "beam_surfaces"), strict=True
    ):
        for axis, name in enumerate(("axial_stress", "shear_stress")):
            values = grid.point_data[name]
            # 16 bits of six resultants; a wrong sign or moment is wrong by the whole stress
            assert np.abs(stress[:, axis]).max() == pytest.approx(np.abs(values).max(), rel=1e-3)
        # elements have points of their own at a node: one of them has the stress of the vertex
        top = np.argmax(stress[:, 0])
        nearest = np.linalg.norm(grid.points - vertices[top], axis=1) < TOLERANCE
        expected = grid.point_data["axial_stress"][nearest]
        assert np.abs(expected - stress[top, 0]).min() <= 1e-3 * np.abs(expected).max()


def test_normals_are_outward(unpacked: Unpacked) -> None:
    """Faces and normals of the tube agree, and point away from the wall's middle."""
    layer = unpacked.layers["beams"]
    local, normal = unpacked.array(layer["local"]), unpacked.array(layer["normal"]) / 127.0
    triangles = unpacked.array(layer["triangles"])
    a, b, c = (unpacked.vertices("beams")[0][triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    turn = unpacked.turns(layer["motion"])[0][unpacked.array(layer["frame"])]
    mean = np.einsum("vij,vj->vi", turn, normal)[triangles].mean(axis=1)
    assert np.all(np.einsum("ti,ti->t", face, mean) > 0.0)
    radius = np.linalg.norm(local[:, 1:], axis=1)
    outward = np.einsum("vi,vi->v", local[:, 1:], normal[:, 1:])
    side = np.abs(normal[:, 0]) < 0.5
    assert np.array_equal(outward[side] > 0, radius[side] > 0.0125)


def test_histories_are_those_of_the_table(results: Path, unpacked: Unpacked) -> None:
    history = unpacked.scene["history"]
    columns = read_history(results / "history.csv")
    assert history["names"] == [name for name in columns if name != "t"]
    values = unpacked.array(history["values"])
    for name, row in zip(history["names"], values, strict=True):
        np.testing.assert_allclose(row, columns[name], rtol=1e-6)  # single precision


def test_names_are_kept_out_of_the_markup(copy: Path) -> None:
    """They are in JSON, whose text has no tag, nor anything that a page of HTML could end by."""
    assert cli.command(["view", str(copy)]) == 0
    text = (copy / "view.html").read_text()
    assert "window.caught" in text
    assert "<script>window" not in text
    assert "<img" not in text
    (scene,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)
    names = [
        layer["names"] for layer in json.loads(scene)["layers"] if layer["series"] == "rigid_bodies"
    ]
    assert names == [[EVIL]]
    assert json.loads(scene)["history"]["names"][0] == EVIL_COLUMN + "_x"


def test_page_asks_for_nothing(copy: Path) -> None:
    """No address of the network in what is loaded, and a policy that allows none."""
    assert cli.command(["view", str(copy)]) == 0
    text = (copy / "view.html").read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", text)
    library = re.search(r'id="library">([^<]*)<', text)
    assert library is not None
    assert b"Three.js Authors" in zlib.decompress(base64.b64decode(library[1]))


def test_frames_and_fields_can_be_chosen(results: Path) -> None:
    content = gather(results, Choice(frames=4, fields=["M2"]))
    found = Unpacked(content)
    times = found.array(content.scene["times"])
    assert len(times) == 4
    assert (times[0], times[-1]) == pytest.approx((0.0, 0.2))
    assert [field["name"] for field in found.layers["beams"]["fields"]] == ["M2"]
    assert any("4 of 11 instants" in note for note in content.notes)


def put_points(file: Path, points: np.ndarray) -> None:
    """Replace the first points of a piece."""
    data = bytearray(file.read_bytes())
    start = data.index(b"_", data.index(b'encoding="raw"')) + 1
    offset = int(re.findall(rb'Name="Points"[^>]*offset="(\d+)"', bytes(data))[0])
    raw = points.astype(np.float64).tobytes()
    data[start + offset + 8 : start + offset + 8 + len(raw)] = raw
    file.write_bytes(data)


def test_instants_without_finite_positions_are_left_out(copy: Path) -> None:
    put_points(copy / "beams" / "beams_000003_0.vtu", np.array([np.nan]))
    content = gather(copy, Choice())
    assert len(Unpacked(content).array(content.scene["times"])) == 10
    assert any("1 instants without finite positions" in note for note in content.notes)


def test_surfaces_that_are_not_rigid_are_kept_by_points(copy: Path) -> None:
    """A body of another shape at one instant: all of its points are kept, and are right."""
    target = copy / "rigid_bodies" / "rigid_bodies_000005_0.vtu"
    points = read_pieces(target)[0].points * [1.0, 1.0, 2.0]
    put_points(target, points)
    found = Unpacked(gather(copy, Choice()))
    layer = found.layers["rigid_bodies"]
    assert layer["kind"] == "points"
    assert farthest(points, found.places(layer["motion"])[5]) < 5 * TOLERANCE


def without_indices(folder: Path) -> None:
    for path in folder.glob("*.pvd"):
        path.unlink()


def cut(name: str, size: int) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[:size] if size > 0 else data[: len(data) + size])

    return damage


def put(name: str, old: bytes, new: bytes) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        data = (folder / name).read_bytes()
        assert old in data
        (folder / name).write_bytes(data.replace(old, new, 1))

    return damage


BEAMS = "beams/beams_000002_0.vtu"
DAMAGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "nothing there": (shutil.rmtree, "there is no such folder"),
    "no fields": (without_indices, "the run wrote no fields"),
    "cut short": (cut(BEAMS, -3000), "it is damaged"),
    "empty": (cut(BEAMS, 1), "it is damaged"),
    "gone": (lambda folder: (folder / BEAMS).unlink(), "No such file"),
    "size": (put(BEAMS, b'NumberOfCells="4"', b'NumberOfCells="9"'), "it is damaged"),
    "huge": (put(BEAMS, b'NumberOfPoints="5"', b'NumberOfPoints="999999999999"'), "it is damaged"),
    "offset": (put(BEAMS, b'offset="0"', b'offset="99999999"'), "it is damaged"),
    "entities": (put("beams.pvd", b"<Collection>", b"<!DOCTYPE a><Collection>"), "declarations"),
    "elsewhere": (put("beams.pvd", b'file="beams/', b'file="../../beams/'), "not a series of"),
    "time": (put("beams.pvd", b'timestep="0.0"', b'timestep="nan"'), "not a series of"),
    "names": (put("scene.json", b'"joints"', b'"points"'), "scene"),
    "nested": (lambda folder: (folder / "scene.json").write_text("[" * 10**5), "scene"),
    "history": (put("history.csv", b"0.0,", b"x,"), "history"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGES)
def test_damaged_folders_are_refused(
    name: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, and the page of before is left as it was."""
    page = copy / "view.html"
    page.write_text("before")
    damage, message = DAMAGES[name]
    damage(copy)
    assert cli.command(["view", str(copy)]) == 2
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err.startswith("error: ")
    assert found.err.count("\n") == 1
    assert message in found.err
    assert_on_page(found.err.removeprefix("error: ").rstrip())
    if copy.exists():
        assert page.read_text() == "before"
        assert not list(copy.glob(".*.tmp"))


WRONG = {
    "--frames 0": "frames must be from 1 to 100000, got 0",
    "--fields speed": "no field 'speed'",
}


@pytest.mark.parametrize("options", WRONG)
def test_wrong_options_are_refused(
    options: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["view", str(copy), *options.split()]) == 2
    text = capsys.readouterr().err
    assert WRONG[options] in text
    assert_on_page(text.removeprefix("error: ").rstrip())
    assert not (copy / "view.html").exists()


def test_scene_file_tells_names_and_sections(results: Path) -> None:
    scene = SceneFile.of(results)
    assert scene.bodies["beams"] == ["rod"]
    assert scene.body("rigid_bodies", 0) == EVIL
    assert scene.body("rigid_bodies", 7) == "rigid_bodies 7"
    assert scene.joint(1) == ("Rigid", "weld")
    (walls,) = scene.sections
    assert [np.linalg.norm(wall.points, axis=1).max() for wall in walls] == pytest.approx(
        [0.015, 0.01]
    )


def test_python_makes_the_same_page(copy: Path) -> None:
    """A frame in a notebook holds the page, whose text cannot end the attribute that it is in."""
    made = ff.view(copy, frames=3, fields=["N"])
    assert made.path == copy / "view.html"
    assert any("3 of 11 instants" in note for note in made.notes)
    text = made._repr_html_()
    found = re.fullmatch(r'<iframe title="flexfem" style="[^"]*" srcdoc="([^"]*)"></iframe>', text)
    assert found is not None
    assert html.unescape(found[1]) == made.path.read_text()


def test_outcomes_show_their_folder(tmp_path: Path) -> None:
    short = {"dt": 0.02, "t_end": 0.04, "every": 1, "quiet": True}
    outcome = ff.simulate(mechanism(), ff.RunOptions(**short, output=tmp_path / "swing"))
    assert outcome.folder == tmp_path / "swing"
    assert outcome.show().path == tmp_path / "swing" / "view.html"
    outcome = ff.simulate(mechanism(), ff.RunOptions(**short))
    with pytest.raises(ValueError, match="the run wrote no results") as raised:
        outcome.show()
    assert_on_page(str(raised.value))


def test_pictures_from_python(copy: Path) -> None:
    """Options are those of the command line, and so are the messages."""
    pytest.importorskip("matplotlib")
    picture = copy / "one.png"
    assert ff.plot(copy, columns=[EVIL_COLUMN + "_x"], output=picture) == [picture]
    assert picture.stat().st_size > 1000
    with pytest.raises(ValueError, match="no column 'speed'"):
        ff.plot(copy, columns=["speed"])
    with pytest.raises(ValueError, match="did you mean --colour"):
        ff.render(copy, colours="N")
