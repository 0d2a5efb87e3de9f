# SPDX-License-Identifier: LGPL-3.0-or-later
"""Commands that draw and plot, the script for ParaView: from files alone, one line on mistakes."""

import ast
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import command
from flexfem.cli.postprocessing import script
from flexfem.io import BeamFields, BeamWriter, JointFields, JointWriter
from flexfem.io.paraview.paraview_state import write_paraview_state
from tests.unit.test_ufl_bodies import bar, line

pytestmark = pytest.mark.serial

SMALL = ("--size", "240x160")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A beam of two cells that swings, on a joint with a force, at three times."""
    folder = tmp_path_factory.mktemp("swing")
    beams = BeamWriter(folder, MPI.COMM_SELF, [[[-0.05, -0.05], [0.05, -0.05], [0.0, 0.05]]])
    joints = JointWriter(folder, MPI.COMM_SELF, ["Revolute"], 0.1)
    cells, none = np.array([[0, 1], [1, 2]]), np.zeros(2, dtype=np.int64)
    start = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]])
    axes, turn = np.broadcast_to(np.eye(3), (3, 3, 3)), np.broadcast_to(np.eye(3), (2, 2, 3, 3))
    zero = np.zeros((1, 3))
    for step in range(3):
        x = start + [0.0, 0.1 * step, 0.0] * start[:, :1]
        values = np.full((2, 6), 1.0 + step)
        beams.write(
            0.1 * step, step,
            BeamFields(x, x - start, axes, x, x, cells, none, values, values, none, turn),
        )  # fmt: skip
        force = np.array([[0.0, 10.0 * step, 0.0]])
        joints.write(
            0.1 * step, step, JointFields(zero, zero, zero, force, zero, np.array([0]), zero)
        )
    for name, slope in (("", 1.0), ("other", 2.0)):
        (folder / name).mkdir(exist_ok=True)
        rows = [f"{t},{slope * t},{slope}" for t in (0.0, 0.1, 0.2)]
        (folder / name / "history.csv").write_text("\n".join(["t,tip_x,tip_y", *rows, ""]))
    return folder


def pixels(path: Path) -> np.ndarray:
    import imageio.v3 as iio

    return np.asarray(iio.imread(path))[..., :3].astype(int)


def test_render_draws_pictures_and_films(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pyvista")
    iio = pytest.importorskip("imageio.v3")
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    for ending in ("gif", "mp4"):
        argv = ["render", str(results), *SMALL, "--format", ending, "--output", str(tmp_path)]
        assert command(argv) == 0
        assert capsys.readouterr().out.split() == [
            str(tmp_path / "motion.png"), str(tmp_path / f"motion.{ending}"),
        ]  # fmt: skip
        assert pixels(tmp_path / "motion.png").shape == (160, 240, 3)
    assert np.shape(iio.imread(tmp_path / "motion.gif")) == (3, 160, 240, 3)
    assert ffmpeg.count_frames_and_secs(tmp_path / "motion.mp4")[0] == 3
    assert not list(results.glob("*.png"))


def test_render_shows_what_options_ask_for(results: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    still = [str(results), *SMALL, "--output", str(tmp_path)]
    shown = {}
    for name, options in {
        "plain": ["--time", "0.2"],
        "arrows": ["--time", "0.2", "--arrows", "force"],
        "first": ["--time", "0"],
        "undeformed": ["--time", "0.2", "--scale-deformation", "0"],
        "side": ["--time", "0.2", "--view=-y"],
    }.items():
        assert command(["render", *still, *options]) == 0
        shown[name] = pixels(tmp_path / "still.png")
    body = (slice(20, None), slice(0, 200))  # without title and scalar bar
    # violet is no colour of fields: less green than red, and less red than blue, by far
    violet = {
        name: np.all(np.diff(picture[body][..., [1, 0, 2]], axis=2) > 25, axis=2).sum()
        for name, picture in shown.items()
    }
    assert violet["arrows"] > 5
    assert violet["plain"] == 0
    for other in ("first", "side"):
        assert not np.array_equal(shown["plain"][body], shown[other][body])
    # displacements times nought give the place of the start: same camera, same silhouette
    background = shown["first"][100, 5]
    silhouettes = [(shown[k][body] != background).any(axis=2) for k in ("first", "undeformed")]
    assert np.mean(silhouettes[0] != silhouettes[1]) < 0.005  # of one pixel at the edges
    swung = (shown["plain"][body] != background).any(axis=2)
    assert np.mean(silhouettes[0] != swung) > 0.005


def test_bodies_with_an_energy_are_drawn_in_the_colours_of_its_density(tmp_path: Path) -> None:
    """A bar that falls and is held at one end: a wave of stress has gone half its length."""
    pytest.importorskip("pyvista")
    model = ff.Model("falling")
    model.add(
        ff.UFLBody("body", line(), bar, density=2.0, parameters={"EA": 50.0}),
        ff.Spherical("pin", ff.Ground(), ff.Marker("body", "start")),
        ff.Gravity((9.81, 0.0, 0.0)),
    )
    results = tmp_path / "results"
    ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.1, quiet=True, output=results))
    still = ["render", str(results), *SMALL, "--output", str(tmp_path), "--time", "last"]
    assert command(still) == 0
    shown = pixels(tmp_path / "still.png")[40:120, :200]  # without title and axes
    red, green, blue = np.moveaxis(shown, -1, 0)
    assert ((red - blue > 100) & (red - green > 100)).sum() > 5  # most energy at the pin
    assert ((blue - red > 80) & (blue - green > 50)).sum() > 5  # none beyond the wave


def test_render_puts_instants_side_by_side(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In rows, each as it is alone; colours stand for the values that are given."""
    pytest.importorskip("pyvista")
    argv = ["render", str(results), *SMALL, "--output", str(tmp_path)]
    assert command([*argv, "--time", "0,0.2,last"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "instants.png")]
    both = pixels(tmp_path / "instants.png")
    assert both.shape == (320, 480, 3)
    assert np.array_equal(both[:160, 240:], both[160:, :240])  # at 0.2 s the run ends
    assert np.ptp(both[160:, 240:], axis=(0, 1)).max() == 0  # an empty place
    assert not np.array_equal(both[:160, :240], both[:160, 240:])
    for name in ("1e6,2e6", "-2e6,-1e6"):  # all in the first colour, blue, or the last, red
        assert command([*argv, "--time", "last", "--range", name]) == 0
        picture = pixels(tmp_path / "still.png")[20:, :190]
        more = picture[..., 0] - picture[..., 2]
        warm, cold = (more > 60).sum(), (more < -60).sum()
        assert bool(warm > cold) is name.startswith("-")


def test_plot_of_one_run_and_of_several(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    a, b, out = str(results), str(results / "other"), str(tmp_path / "p.png")
    for argv in (
        [a, "--columns", "tip_x"],
        [a, "--columns", "t", "--x", "tip_x"],
        [a, "--path", "tip", "--planes", "xy"],
        [a, b, "--columns", "tip_x,tip_y", "--after", "0.1"],
        [a, b, "--columns", "t,tip_y", "--x", "tip_x", "--across", "2"],
        [a, b, "--path", "tip", "--planes", "xy"],
    ):
        assert command(["plot", *argv, "--output", out]) == 0
        assert capsys.readouterr().out.strip() == out
        assert Path(out).read_bytes()[:4] == b"\x89PNG"
        Path(out).unlink()


def write_sheet(folder: Path, triangles: np.ndarray) -> None:
    """A round sheet of 4 folds in 24 sectors about its middle."""
    pv = pytest.importorskip("pyvista")
    angles = np.arange(24) * np.pi / 12.0
    radii = 1.0 + 0.2 * np.cos(4.0 * angles)
    x = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), 0.1 * radii])
    cells = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    points = np.vstack([x, np.zeros(3)])
    grid = pv.UnstructuredGrid(cells, np.full(len(triangles), 5), points)
    folder.mkdir()
    grid.save(folder / "sheet.vtu")
    (folder / "shells.pvd").write_text(
        '<VTKFile><Collection><DataSet timestep="0" file="sheet.vtu"/></Collection></VTKFile>'
    )


def test_outline_counts_folds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    nodes = np.arange(24)
    sectors = np.column_stack([nodes, (nodes + 1) % 24, np.full(24, 24)])
    write_sheet(tmp_path / "sheet", sectors)
    picture, table = tmp_path / "sheet/outline.png", tmp_path / "sheet/outline.csv"
    assert command(["plot", str(picture.parent), "--outline"]) == 0
    assert capsys.readouterr().out.split() == [str(picture), str(table)]
    edge = np.loadtxt(table, delimiter=",", skiprows=1)
    told = script("outline").numbers(edge).split()
    # the middle node is not of the outline; half and quarter turns map it onto itself
    assert len(edge) == 24
    assert told[:2] == ["folds", "4,"]
    assert [float(word.strip(",")) for word in (told[-5], told[-3], told[-1])] == [0.0, 0.0, 0.0]
    write_sheet(tmp_path / "two", sectors[::2])  # twelve sheets that meet in a point
    assert command(["plot", str(tmp_path / "two"), "--outline"]) == 2
    assert "must have one boundary" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        (["render", "{}/other"], "no series to draw"),
        (["render", "{}", "--colour", "nonsense"], "no field 'nonsense'"),
        (["render", "{}", "--time", "3"], "nothing from t = 3 to 0.2 s"),
        (["render", "{}", "--from", "0.3"], "nothing from t = 0.3 to 0.2 s"),
        (["render", "{}", "--arrows", "moment"], "no moment at joints"),
        (["render", "{}", "--view", "top"], "'top' is none of x, y, z"),
        (["render", "{}", "--range", "2,1"], "'2,1' is not A,B with A below B"),
        (["render", "{}", "--time", "0,3"], "nothing from t = 3 to 0.2 s"),
        (["render", "{}", "--size", "9"], "'9' is not WIDTHxHEIGHT"),
        (["render"], "RESULTS_DIR"),
        (["plot", "{}/nowhere"], "no history table"),
        (["plot", "{}", "--columns", "tip_q"], "no column 'tip_q'"),
        (["plot", "{}", "--campbell"], "no modes over the speed"),
        (["plot", "{}", "{}/other", "--path", "tip"], "no column 'tip_z'"),
        (["plot", "{}", "{}/other", "--outline"], "--outline: takes one RESULTS_DIR, got 2"),
        (["plot", "{}", "--outline"], "no series of shells"),
        (["plot", "{}", "--time", "0.1"], "--time: needs --outline"),
        (
            ["plot", "{}", "{}/other", "--clip", "--path", "tip"],
            "--clip: changes nothing with --path",
        ),
        (
            ["plot", "{}", "{}/other", "--clip", "--x", "tip_x"],
            "--clip: columns are clipped over t",
        ),
        (["plot", "{}", "{}/other", "--across", "2", "--path", "tip"], "--across: changes nothing"),
        (["plot", "{}", "--path", "tip", "--columns", "tip_x"], "--columns: changes nothing with"),
        (["plot", "{}", "--outline", "--path", "tip"], "--path: changes nothing with --outline"),
        (["plot", "{}", "--campbell", "--x", "tip_x"], "--x: changes nothing with --campbell"),
        (["plot", "{}", "--planes", "xy"], "--planes: needs --path"),
        (["plot", "{}", "--orders", "4"], "--orders: needs --campbell"),
        (["plot", "{}", "--after", "1"], "--after: takes several RESULTS_DIR"),
    ],
)
def test_mistakes_are_one_line(
    results: Path, argv: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pyvista")
    before = sorted(results.rglob("*"))
    assert command([text.format(results) for text in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("error: ")
    assert told in captured.err
    assert sorted(results.rglob("*")) == before


@pytest.mark.parametrize(("name", "missing"), [("render", "pyvista"), ("plot", "matplotlib")])
def test_missing_libraries_are_named(results: Path, name: str, missing: str) -> None:
    code = (
        f"import sys; sys.modules['{missing}'] = None\n"
        "from flexfem.cli import command\n"
        f"sys.exit(command(['{name}', r'{results}']))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == (
        f"error: this command needs {missing}, which is not installed: "
        "pip install 'flexfem[post]'\n"
    )


def test_help_loads_no_library_for_pictures() -> None:
    code = (
        "import sys\nfrom flexfem.cli import command\n"
        "for name in ('render', 'plot'):\n"
        "    try:\n        command([name, '--help'])\n    except SystemExit:\n        pass\n"
        "heavy = {'pyvista', 'vtk', 'vtkmodules', 'matplotlib', 'imageio'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.endswith("\n[]\n")
    assert "--arrows" in ended.stdout
    assert "--campbell" in ended.stdout


def test_script_for_paraview_is_written_once_and_runs_there(tmp_path: Path) -> None:
    folder = tmp_path / "it's"
    folder.mkdir()
    write_paraview_state(folder, MPI.COMM_SELF)
    assert [file.name for file in folder.iterdir()] == ["open_in_paraview.py"]
    text = (folder / "open_in_paraview.py").read_text()
    tree = ast.parse(text, feature_version=(3, 9))  # that of ParaView 5.11
    told = [
        node.value for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "FOLDER"
    ]  # fmt: skip
    assert [ast.literal_eval(value) for value in told] == [str(folder)]
    assert len(text) < 12000
