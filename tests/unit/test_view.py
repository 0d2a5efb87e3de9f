# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of result folders: what they hold is what the files hold, and nothing harmful."""

import base64
import html
import json
import re
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.scene_file import SceneFile
from flexfem.io.tables.history import read_history
from flexfem.io.view.content import gather
from flexfem.io.view.reading import Choice
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_writer import BeamWriter
from flexfem.io.vtu.reader import read_pieces
from flexfem.lie import so3
from flexfem.materials.section_wall import SectionWall
from tests.unit.refusals import assert_on_page
from tests.unit.swing import EVIL, EVIL_COLUMN, mechanism
from tests.unit.unpacked import Unpacked, farthest, files

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


@pytest.fixture(scope="session")
def unpacked(results: Path) -> Unpacked:
    return Unpacked(gather(results, Choice()))


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


@pytest.mark.parametrize("taper", [1.0, 0.5])
def test_sections_rotated_against_nodes(
    taper: float, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Elements that meet at an angle have section axes of their own at a node, and may taper."""
    outline = np.array([[-0.1, -0.2], [0.1, -0.2], [0.1, 0.3], [-0.1, 0.2]])
    ends = tuple((SectionWall(scale * outline),) for scale in (1.0, taper))
    writer = BeamWriter(tmp_path, MPI.COMM_SELF, [ends])
    turn = so3.exp(rng.normal(size=(2, 2, 3)))
    for step in range(3):
        v, number = rng.normal(size=(3, 3)), np.zeros(2, dtype=np.int64)
        frames, cells = so3.exp(rng.normal(size=(3, 3))), np.array([[0, 1], [1, 2]])
        s = rng.normal(size=(2, 6))
        writer.write(
            0.1 * step, step, BeamFields(v, v, frames, v, v, cells, number, s, s, number, turn)
        )
    writer.close()
    SceneFile({"beams": ["rod"]}, [], [ends]).write(tmp_path)
    found = Unpacked(gather(tmp_path, Choice())).vertices("beams")
    for vertices, grid in zip(found, files(tmp_path, "beam_surfaces"), strict=True):
        assert farthest(grid.points, vertices) < TOLERANCE
        assert farthest(vertices, grid.points) < TOLERANCE


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
    ((walls,),) = scene.sections
    assert [np.linalg.norm(wall.points, axis=1).max() for wall in walls] == pytest.approx(
        [0.015, 0.01]
    )


@pytest.mark.parametrize("fields", ["none", "resultant"])
def test_runs_that_write_few_fields_have_pages(fields: str, tmp_path: Path) -> None:
    """Sections are swept without surfaces in the files; resultants are enough for stresses."""
    options = ff.RunOptions(
        dt=0.02, t_end=0.1, every=1, quiet=True, output=tmp_path, fields=fields
    )  # fmt: skip
    assert ff.simulate(mechanism(), options).status == "ok"
    layer = Unpacked(gather(tmp_path, Choice())).layers["beams"]
    assert layer["triangles"]["shape"][0] > 100
    assert (layer["stress"] is None) == (fields == "none")
    assert len(layer["fields"]) == (0 if fields == "none" else 6)


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


def test_gallery_links_pages(copy: Path, tmp_path: Path) -> None:
    """Relative links that lead to the pages, pictures inside, names as text."""
    other = tmp_path / "a <b> & c"
    shutil.copytree(copy, other)
    (other / "motion.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (copy / "motion.png").write_bytes(b"no picture")
    index = tmp_path / "index.html"
    assert cli.command(["view", str(copy), str(other), "--gallery", str(index)]) == 0
    text = index.read_text()
    links = re.findall(r'<a href="([^"]*)">', text)
    assert [tmp_path / unquote(link) for link in links] == [
        copy / "view.html", other / "view.html"
    ]  # fmt: skip
    assert text.count("<img ") == 1
    assert "a &lt;b&gt; &amp; c" in text
    assert "<b>" not in text
