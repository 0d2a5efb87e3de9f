# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks among themselves: threads and cores that they take, and models that differ."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem import launch
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.fingerprint import checksum

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
COUNT = (
    "from threadpoolctl import threadpool_info\n"
    "print({library['num_threads'] for library in threadpool_info()})"
)


@pytest.mark.serial
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core has one thread anyway")
@pytest.mark.parametrize("first", ["import numpy, flexfem", "import flexfem, numpy"])
@pytest.mark.parametrize(
    ("given", "one"),
    [
        ({}, False),
        ({"PMI_SIZE": "2"}, True),
        ({"PMI_SIZE": "2", "OMP_NUM_THREADS": ""}, True),
        ({"PMI_SIZE": "2", "OMP_NUM_THREADS": "2"}, False),
        ({"PMI_SIZE": "2", "OPENBLAS_NUM_THREADS": "2"}, False),
    ],
    ids=["alone", "ranks", "ranks, empty", "OpenMP asked", "BLAS asked"],
)
def test_ranks_take_one_thread_unless_asked(first: str, given: dict[str, str], one: bool) -> None:
    """As many threads as cores on each rank made a step of 7320 unknowns ten times as long."""
    kept = {name: value for name, value in os.environ.items() if name not in THREADS}
    kept["PYTHONPATH"] = str(Path(ff.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", f"{first}\n{COUNT}"], env=kept | given, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert (done.stdout.strip() == "{1}") is one


@pytest.mark.serial
@pytest.mark.parametrize(
    ("here", "given", "found"),
    [(3, None, "1"), (2, None, None), (3, "0", "0")],
    ids=["more than cores", "as many", "the user's"],
)
def test_ranks_sleep_while_they_wait_where_cores_are_few(
    here: int, given: str | None, found: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three ranks that poll on two cores took three times as long."""
    name = "MPIR_CVAR_ENABLE_HEAVY_YIELD"
    monkeypatch.setenv(name, given or "")
    if given is None:
        monkeypatch.delenv(name)
    monkeypatch.setenv("MPI_LOCALNRANKS", str(here))
    monkeypatch.setattr(launch, "cores", lambda: {0, 1})
    launch.sleep_while_waiting()
    assert os.environ.get(name) == found
    monkeypatch.delenv(name, raising=False)


def top() -> ff.Model:
    """One rigid body on a joint: at most one rank has something to do."""
    model = ff.Model("top")
    model.add(ff.RigidBody("body", 1.0, (0.1, 0.1, 0.2)), ff.Gravity((0.0, 0.0, -9.81)))
    model.add(
        ff.Spherical("foot", ff.Ground((0.0, 0.0, -1.0)), ff.Marker("body", offset=(0, 0, -1)))
    )
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("quiet", [False, True])
def test_ranks_in_vain_are_told_once(
    quiet: bool, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ranks without bodies, and more ranks than cores, by the first rank, and in the summary."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    expected = [] if comm.size == 1 else [
        f"{comm.size - 1} of {comm.size} ranks have no bodies",
        f"{comm.size} ranks share 1 cores",
    ]  # fmt: skip
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
    outcome = ff.simulate(top(), ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=quiet))
    told = [line for line in outcome.summary["warnings"] if "ranks" in line]
    assert [line.split(":")[0].split(" and")[0] for line in told] == expected
    said = capfd.readouterr().err
    for line in told:
        assert said.count(f"warning: {line}\n") == int(comm.rank == 0 and not quiet)


def differing(what: str, rank: int) -> ff.Model:
    """A model of which one thing is another one on other ranks than the first."""

    def value(of: str) -> float:
        return 1.5 if of == what and rank > 0 else 1.0

    enclosed = value("amplitude")
    waves = [lambda t: enclosed * np.sin(t), lambda t: enclosed * np.cos(t)]
    model = top()
    for name in ("b", "a") if value("order") > 1.0 else ("a", "b"):
        inertia = 2.0, 2.0, 2.0 * value("body")
        model.add(ff.RigidBody(name, 1.0, inertia, position=(5.0, 0.0, 0.0)))
    foot = ff.Ground((0.0, 0.0, value("joint")))
    model.add(
        ff.SpringDamper("rope", foot, ff.Marker("a"), stiffness=10.0),
        ff.PointForce(
            "wind", ff.Marker("a"), (1.0, 0.0, 0.0), amplitude=waves[value("function") > 1.0]
        ),
    )
    if value("mistake") > 1.0:
        model.add(ff.Spherical("hook", ff.Ground(), ff.Marker("nobody")))
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("body", 'RigidBody "a" differs between ranks 0'),
        ("order", 'RigidBody "a" of rank 0 is RigidBody "b" on rank'),
        ("joint", 'SpringDamper "rope" differs between ranks 0'),
        ("amplitude", 'PointForce "wind" differs between ranks 0'),
        ("function", 'PointForce "wind" differs between ranks 0'),
        ("mistake", "nobody"),
    ],
)
def test_models_that_differ_between_ranks_are_refused(what: str, words: str) -> None:
    """Each would have one rank wait for ever, or pull at another model than the others."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    model, options = differing(what, comm.rank), ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True)
    if comm.size == 1:
        assert ff.simulate(model, options).status == "ok"
        return
    with pytest.raises(ValueError, match="a model must be the same on every rank") as refused:
        ff.simulate(model, options)
    assert words in str(refused.value)
    assert len(set(comm.allgather(str(refused.value)))) == 1
    assert ff.simulate(differing("nothing", comm.rank), options).status == "ok"


@pytest.mark.serial
@pytest.mark.parametrize("what", ["body", "order", "joint", "amplitude", "function"])
def test_one_checksum_tells_whether_models_differ(what: str) -> None:
    """Ranks that it finds alike do not look at single objects."""
    first, same, other = (
        checksum(NumberedModel(differing(what, rank))) for rank in (0, 0, 1)
    )  # fmt: skip
    assert first == same != other


@pytest.mark.serial
@pytest.mark.parametrize(("change", "equal"), [(1e-12, True), (1e-8, False)])
def test_checksums_of_many_bodies_by_arrays(change: float, equal: bool) -> None:
    """Last digits do not count; 220 calls and returns a rod with its hinge, 1725 one by one."""

    def found(move: float, count: int) -> tuple[str, int]:
        """Checksum of a chain of rods, the third of which is moved, and calls for it."""
        model = ff.Model("chain")
        places = np.arange(3.0 * count).reshape(count, 3)
        places[2, 1] += move
        rods = model.add(
            ff.Many(ff.RigidBody, "rod", 1.0, (1e-3, 1.0, 1.0), position=ff.each(places))
        )
        ends = ff.each([ff.Ground(), *rods.markers()[:-1]])
        model.add(ff.Many(ff.Spherical, "pin", ends, ff.each(rods.markers())))
        serial, calls = NumberedModel(model), [0]

        def note(*_: object) -> None:
            calls[0] += 1

        sys.setprofile(note)
        try:
            return checksum(serial), calls[0]
        finally:
            sys.setprofile(None)

    assert (found(0.0, 40)[0] == found(change, 40)[0]) is equal
    assert found(0.0, 80)[1] - found(0.0, 40)[1] < 40 * 300


def apart(t: float) -> float:
    """Nothing at the start, afterwards the number of the rank: what no fingerprint tells."""
    from mpi4py import MPI

    return float(MPI.COMM_WORLD.rank * (t > 0.0))


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("load", 'PointForce "wind": gives 1 on one rank and'),
        ("output", 'Controller "law": gives 1 on one rank and'),
        ("event", 'Event "knock": gives -1 on one rank and'),
    ],
)
def test_functions_that_differ_between_ranks_end_the_run(
    what: str, words: str, shared_tmp_path: Path
) -> None:
    """All ranks end with the same line: an event that one of them saw would leave it alone."""
    from mpi4py import MPI

    comm, at, model = MPI.COMM_WORLD, ff.Marker("body"), top()
    model.add(
        ff.PointForce(
            "wind", at, (1.0, 0.0, 0.0), amplitude=lambda t: 1.0 + apart(t) * (what == "load")
        ),
        ff.PointForce("push", at, (1.0, 0.0, 0.0)),
        ff.PositionProbe("place", at),
        ff.Controller(
            "law", ["place"], ["push"], lambda t, y: [1.0 + apart(t) * (what == "output")]
        ),
        ff.Event("knock", at, lambda t, state: apart(t) * (what == "event") - 1.0, ff.Stop()),
    )
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, output=shared_tmp_path, quiet=True)
    if comm.size == 1:
        assert ff.simulate(model, options).status == "ok"
        return
    with pytest.raises(RuntimeError, match="on another") as ended:
        ff.simulate(model, options)
    assert words in str(ended.value)
    assert "(test_ranks.py, line" in str(ended.value)
    assert len(set(comm.allgather(str(ended.value)))) == 1
    assert (shared_tmp_path / "summary.json").exists()


def three_beams(what: str) -> ff.Model:
    """A cantilever of three beams; two or three ranks share the joint that is driven."""
    points = np.column_stack([np.arange(15) - np.arange(15) // 5, np.zeros(15), np.zeros(15)])
    cells = np.array([[5 * k + i, 5 * k + i + 1] for k in range(3) for i in range(4)])
    groups = {name: np.arange(4 * k, 4 * k + 4) for k, name in enumerate("abc")}
    model = ff.Model("arm", mesh=ff.LineMesh(points.astype(float), cells, groups))
    section = ff.Section.circle(0.05, ff.Material(210e9, 0.3, 7850.0))
    model.add(*(ff.Beam(name, section) for name in "abc"))
    knee = ff.Marker("b", "end"), ff.Marker("c", "start")

    def turn(t: float) -> float:
        return 0.1 * t * (1.0 - t) + 0.01 * apart(t) * (what == "drive")

    def pull(t: float) -> float:
        return 1.0 + apart(t) * (what == "load")

    model.add(
        ff.Rigid("wall", ff.Ground(), ff.Marker("a", "start")),
        ff.Revolute("knee", *knee, axis=(0.0, 1.0, 0.0)),
        ff.PrescribedAngle("turn", *knee, axis=(0.0, 1.0, 0.0), angle=turn),
        ff.Rigid("joint", ff.Marker("a", "end"), ff.Marker("b", "start")),
        ff.PointForce("wind", ff.Marker("c", "end"), (0.0, 0.0, 1.0), amplitude=pull),
    )
    return model


@pytest.mark.parametrize(
    ("analysis", "what"),
    [
        pytest.param("motion", "drive", marks=pytest.mark.three_ranks),
        pytest.param("motion", "nothing", marks=pytest.mark.three_ranks),
        ("statics", "drive"),
        ("linear", "load"),
        ("relaxation", "load"),
    ],
)
def test_loads_and_drives_are_compared_by_all_analyses(analysis: str, what: str) -> None:
    """A joint that two ranks hold was driven by either to its own angle; nobody said so."""
    from mpi4py import MPI

    comm, model = MPI.COMM_WORLD, three_beams(what)

    def run() -> ff.Outcome:
        if analysis == "motion":
            return ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=3e-2, quiet=True))
        if analysis == "relaxation":
            return ff.relax(model, ff.RelaxationOptions(at_time=1.0, max_iterations=3, quiet=True))
        options = ff.StaticOptions(load_steps=1, linear=analysis == "linear", quiet=True)
        return ff.solve_static(model, options)

    if comm.size == 1 or what == "nothing":
        outcome = run()
        assert outcome.status == "ok" or analysis == "relaxation"
        assert comm.size == 1 or outcome.summary["shared_rows"] > 0
        return
    name = {"drive": 'PrescribedAngle "turn"', "load": 'PointForce "wind"'}[what]
    with pytest.raises(RuntimeError, match=f"{name}: gives .* on one rank and .*") as ended:
        run()
    assert "(test_ranks.py, line" in str(ended.value)
    assert len(set(comm.allgather(str(ended.value)))) == 1


def test_options_that_differ_between_ranks_are_refused() -> None:
    """Steps of other lengths would end in messages that do not fit, or in wrong results."""
    model = ff.Model("top")
    model.add(ff.RigidBody("body", 1.0, (0.1, 0.1, 0.2)))
    rank = ff.launch.rank()
    options = ff.RunOptions(dt=1e-3 * (1 + rank), t_end=2e-3, quiet=rank > 0)
    if ff.launch.ranks() == 1:
        assert ff.simulate(model, options).status == "ok"
        return
    words = "^RunOptions: dt of rank 0 is 0.001, of rank 1 0.002; give all ranks the same options$"
    with pytest.raises(ValueError, match=words):
        ff.simulate(model, options)
