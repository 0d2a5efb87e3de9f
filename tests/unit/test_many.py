# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many objects in one declaration, and set-up that grows with their number."""

import dataclasses
import sys
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem import _checks
from flexfem.constraints.connect import all_ends
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.status import Status
from flexfem.inspection.check import check, findings_of_run
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import so3
from flexfem.simulation.dynamics import simulate
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen.interface import _write_pairs
from flexfem.solvers.linear.tangent import TangentSolver
from tests.unit.refusals import assert_on_page

INERTIA = (1e-3, 1.0 / 12.0, 1.0 / 12.0)
SECTION = ff.Section.circle(0.01, ff.Material(2.1e9, 0.3, 1000.0))
Y = (0.0, 1.0, 0.0)


def places(count: int) -> np.ndarray:
    """Centres of rods of 1 m in a row."""
    return np.column_stack([np.arange(count) + 0.5, np.zeros((count, 2))])


def declared_at_once(count: int) -> ff.Model:
    """A chain of rods of one metre, from which flexible cords hang."""
    cords = [f"cord_{i}" for i in range(count)]
    ends = [[(i + 1.0, 0.0, 0.0), (i + 1.0, 0.0, -0.5)] for i in range(count)]
    model = ff.Model("rods", mesh=ff.LineMesh.straight(dict(zip(cords, ends, strict=True)), 2))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    rods = model.add(ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, position=ff.each(places(count))))
    starts, tips = (rods.markers(offset=(x, 0.0, 0.0)) for x in (-0.5, 0.5))
    hung = ff.Many(ff.Beam, cords, SECTION, orientation=Y)
    model.add(
        ff.Many(ff.Revolute, "pin{}", ff.each([ff.Ground(), *tips[:-1]]), ff.each(starts), axis=Y),
        hung,
        ff.Many(ff.Spherical, "eye", ff.each(tips), ff.each(hung.markers("start"))),
        ff.Many(ff.PointForce, "push", ff.each(starts), ff.each(places(count) * 0.01)),
        ff.PositionProbe("tip", hung.markers("end")[-1]),
        ff.ReactionProbe("last", f"pin{count - 1}"),
    )
    return model


def declared_one_by_one(count: int) -> ff.Model:
    """The same."""
    cords = {f"cord_{i}": [(i + 1.0, 0.0, 0.0), (i + 1.0, 0.0, -0.5)] for i in range(count)}
    model = ff.Model("rods", mesh=ff.LineMesh.straight(cords, 2))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for i, place in enumerate(places(count)):
        model.add(ff.RigidBody(f"rod_{i}", 1.0, INERTIA, position=place))
    before: ff.Marker | ff.Ground = ff.Ground()
    for i in range(count):
        start = ff.Marker(f"rod_{i}", offset=(-0.5, 0.0, 0.0))
        model.add(ff.Revolute(f"pin{i}", before, start, axis=Y))
        before = ff.Marker(f"rod_{i}", offset=(0.5, 0.0, 0.0))
    for name in cords:
        model.add(ff.Beam(name, SECTION, orientation=Y))
    for i in range(count):
        tip = ff.Marker(f"rod_{i}", offset=(0.5, 0.0, 0.0))
        model.add(ff.Spherical(f"eye_{i}", tip, ff.Marker(f"cord_{i}", "start")))
    for i, place in enumerate(places(count)):
        start = ff.Marker(f"rod_{i}", offset=(-0.5, 0.0, 0.0))
        model.add(ff.PointForce(f"push_{i}", start, 0.01 * place))
    model.add(
        ff.PositionProbe("tip", ff.Marker(f"cord_{count - 1}", "end")),
        ff.ReactionProbe("last", f"pin{count - 1}"),
    )
    return model


def contents(thing: object) -> object:
    """All fields of a declaration."""
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        names = [field.name for field in dataclasses.fields(thing)]
        return type(thing), [contents(getattr(thing, name)) for name in names]
    if isinstance(thing, tuple):
        return [contents(part) for part in thing]
    return thing.tolist() if isinstance(thing, np.ndarray) else thing


@pytest.mark.serial
def test_they_are_the_single_ones() -> None:
    many, single = declared_at_once(5), declared_one_by_one(5)
    assert [thing.name for thing in many.things] == [thing.name for thing in single.things]
    for one, other in zip(many.things, single.things, strict=True):
        assert contents(one) == contents(other)
    assert many["rod_3"] is many.rigid_bodies[3]


def test_the_motion_is_the_same(tmp_path: Path) -> None:
    """Run on several ranks, too: not a bit may differ, as declarations are the same."""
    options = {"dt": 2e-3, "t_end": 8e-3, "quiet": True}
    histories = [
        simulate(make(4), ff.RunOptions(output=tmp_path / make.__name__, **options)).history
        for make in (declared_at_once, declared_one_by_one)
    ]
    assert sorted(histories[0]) == sorted(histories[1])
    for name, column in histories[0].items():
        np.testing.assert_array_equal(column, histories[1][name])


@pytest.mark.serial
def test_names_and_numbers() -> None:
    rods = ff.Many(ff.RigidBody, "bay {} rod", 1.0, INERTIA, count=3)
    assert rods.names == ("bay 0 rod", "bay 1 rod", "bay 2 rod")
    assert [rod.name for rod in rods] == list(rods.names)
    assert repr(rods) == "Many RigidBody 'bay {} rod' of 3"
    assert ff.Many(ff.RigidBody, {"a": 1, "b": 2}.keys(), 1.0, INERTIA).names == ("a", "b")
    assert rods[-1].name == "bay 2 rod"
    assert len(rods[:2]) == 2
    heavy = ff.Many(ff.RigidBody, ["a", "b"], mass=ff.each([1.0, 2.0]), inertia=(1.0, 1.0, 1.0))
    assert [body.mass for body in heavy] == [1.0, 2.0]


MASKED = np.ma.masked_array(np.zeros((3, 3)), mask=[[0, 0, 0], [1, 0, 0], [0, 0, 0]])
REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: ff.each(3.0), "each: values must be an array or a list, got 3.0"),
    (lambda: ff.each("abc"), "each: values must be an array or a list, got 'abc'"),
    (lambda: ff.each(np.array(1.0)), r"each: values must be an array or a list, got array\(1.\)"),
    (lambda: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA), "needs names, a count or values of each"),
    (
        lambda: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, position=ff.each(np.zeros((0, 3)))),
        "needs names, a count or values of each",
    ),
    (
        lambda: ff.Many(ff.RigidBody, ["a", "b"], ff.each([1.0] * 3), INERTIA),
        "numbers of objects differ, got {'argument 1': 3, 'names': 2}",
    ),
    (
        lambda: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, count=0),
        "count must be at least 1, got 0",
    ),
    (
        lambda: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, count=2**40),
        "Many RigidBody 'rod': 1099511627776 objects would need about .* reduce the number of obj",
    ),
    (
        lambda: ff.Many(ff.RigidBody, "rod", ff.each([1.0, -1.0]), INERTIA),
        'RigidBody "rod_1": mass must be positive, got -1.0',
    ),
    (
        lambda: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, position=ff.each(MASKED)),
        'RigidBody "rod_1": position must have no masked entries, got masked_array',
    ),
    (lambda: ff.Many("rod", "rod", count=1), "Many: kind must be a class, got 'rod'"),
    (lambda: ff.each(b"abc"), "each: values must be an array or a list, got b'abc'"),
    *(
        (partial(ff.Many, ff.RigidBody, names, 1.0, INERTIA), "names must be a text or a list, got")
        for names in (3, None, {"a", "b"}, np.array("a"), ff.each(["a", "b"]), b"ab")
    ),
    *(
        (
            partial(ff.Many, ff.RigidBody, names, 1.0, INERTIA, count=2),
            f"Many RigidBody '{names}': names must have one {{}} for the number at most",
        )
        for names in ("rod{:03d}", "rod{}{}")
    ),
    *(
        (
            lambda number=number: ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, count=3)[number],
            f"Many RigidBody 'rod': objects have numbers from 0 to 2, got {number!r}",
        )
        for number in (3, -4, "rod_1")
    ),
]  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_mistakes_are_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, TypeError, IndexError), match=message) as raised:
        make()
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


def calls_of_set_up(make: Callable[[int], ff.Model], count: int) -> int:
    """Calls of functions while a model is declared and set up."""
    calls = 0

    def note(*_: object) -> None:
        nonlocal calls
        calls += 1

    sys.setprofile(note)
    try:
        Simulation(make(count), ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True))
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.serial
def test_set_up_grows_with_the_number_of_bodies() -> None:
    """Twice the bodies take 1.97 times the calls; with a look at all bodies for each one 2.4."""
    calls_of_set_up(declared_at_once, 4)  # compiles
    few, many = (calls_of_set_up(declared_at_once, count) for count in (60, 120))
    assert many < 2.05 * few


@pytest.mark.serial
def test_rods_and_hinges_are_set_up_by_arrays() -> None:
    """753 calls and returns a rod with its hinge; 1096 where each joint makes its rows."""
    calls_of_set_up(rigid_chain, 4)  # compiles
    few, many = (calls_of_set_up(rigid_chain, count) for count in (100, 200))
    assert many - few < 900 * 100


def rigid_chain(count: int, joint: type[ff.AxisJoint] = ff.Revolute) -> ff.Model:
    """Rods that hang from the ground by hinges, one on the other."""
    model = ff.Model("chain")
    rods = model.add(ff.Many(ff.RigidBody, "rod", 1.0, INERTIA, position=ff.each(places(count))))
    starts, tips = (rods.markers(offset=(x, 0.0, 0.0)) for x in (-0.5, 0.5))
    pins = ff.Many(joint, "pin", ff.each([ff.Ground(), *tips[:-1]]), ff.each(starts), axis=Y)
    model.add(ff.Gravity((0.0, 0.0, -9.81)), pins)
    return model


def test_common_vectors_are_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only positions are different ones: one array a body, seven without shared vectors."""
    arrays, check = [], _checks.array
    monkeypatch.setattr(_checks, "array", lambda *given: arrays.append(given[1]) or check(*given))
    model = rigid_chain(50)
    assert len(arrays) < 2 * 50
    assert model["rod_3"].inertia is model["rod_4"].inertia
    other = ff.RigidBody("other", 1.0, (0.5, 0.5, 0.5))
    assert np.array_equal(other.inertia, 0.5 * np.eye(3))


@pytest.mark.serial
@pytest.mark.parametrize(("joint", "most"), [(ff.Cylindrical, 44), (ff.Revolute, 4)])
def test_rows_are_made_once_in_set_up(
    monkeypatch: pytest.MonkeyPatch, joint: type[ff.AxisJoint], most: int
) -> None:
    """By the system, once for all hinges; a second time where checks make those of all joints."""
    made, rows = [], PlacedJoint.rows
    monkeypatch.setattr(
        PlacedJoint, "rows", lambda self, t: made.append(self.index) or rows(self, t)
    )
    Simulation(rigid_chain(30, joint), ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True))
    assert len(made) <= most


class Hinge(ff.Revolute):
    """A joint of a script, whose rows might be others."""


@pytest.mark.parametrize("kind", [ff.Revolute, ff.Spherical, ff.Rigid])
def test_rows_of_many_joints_are_those_of_each(kind: type[ff.Joint]) -> None:
    """1e-14 is round-off of directions; exchanged or transposed ones are off by 1."""
    rng = np.random.default_rng(2)
    turns = so3.exp(rng.normal(size=(6, 2, 3)))
    frames = [[ff.Pose(rng.normal(size=3), turn) for turn in pair] for pair in turns]
    # among them axes along one of the inertial axes, beside which the other directions are chosen
    axes = [*np.eye(3)[:2], -2.0 * np.eye(3)[2], *rng.normal(size=(3, 3))]
    given = [{"axis": axis} if issubclass(kind, ff.AxisJoint) else {} for axis in axes]
    rod = ff.Marker("rod")
    joints = [kind(f"joint_{i}", ff.Ground(), rod, **own) for i, own in enumerate(given)]
    found = kind.directions(joints, np.array([[pose.rotation for pose in own] for own in frames]))
    for joint, poses, own in zip(joints, frames, found, strict=True):
        terms = [term.data for row in joint.rows(poses, 0.0) for term in row.terms]
        assert np.abs(own - terms).max() < 1e-14
    assert joints[0].alike
    assert not Hinge("hinge", ff.Ground(), rod).alike


def bent_chain(hinge: type[ff.Revolute]) -> ff.Model:
    """Rods that are turned against each other, with hinges about different axes."""
    model, last = ff.Model("bent"), ff.Marker("rod_0")
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for i in range(6):
        turn = so3.exp((0.3 * i, 0.2, -0.1 * i))
        place = (float(i), 0.0, 0.0)
        model.add(ff.RigidBody(f"rod_{i}", 1.0, INERTIA, position=place, rotation=turn))
        base = last if i else ff.Ground((-0.5, 0.0, 0.0))
        own = ff.Marker(f"rod_{i}", offset=turn.T @ (-0.5, 0.0, 0.0), rotation=turn.T)
        model.add(hinge(f"pin_{i}", base, own, axis=(i, 1.0, 0.2)))
        last = ff.Marker(f"rod_{i}", offset=turn.T @ (0.5, 0.0, 0.0))
    model.add(ff.PositionProbe("tip", last))
    return model


@pytest.mark.three_ranks
def test_hinges_of_a_script_move_as_others(tmp_path: Path) -> None:
    """Rows joint by joint differ by round-off, here less than 1e-11 m; other axes by 0.01 m."""
    options = {"dt": 2e-3, "t_end": 0.05, "quiet": True}
    first, second = (
        simulate(bent_chain(hinge), ff.RunOptions(output=tmp_path / hinge.__name__, **options))
        for hinge in (ff.Revolute, Hinge)
    )
    for name, column in first.history.items():
        np.testing.assert_allclose(column, second.history[name], rtol=0.0, atol=1e-11)


@pytest.mark.serial
def test_masses_at_the_start_couple_no_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """36 entries a body, and 180 with second derivatives of hinges, none kept by frozen factors."""
    entries, release = [], TangentSolver.release_masses

    def note(self: TangentSolver) -> None:
        start, _, _ = self.matrix.getNestSubMatrix(0, 0).getValuesCSR()
        entries.append(int(start[-1]))
        release(self)

    monkeypatch.setattr(TangentSolver, "release_masses", note)
    simulation = Simulation(rigid_chain(10), ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True))
    assert entries == [360]
    assert not hasattr(simulation.tangent, "matrix")
    assert simulation.advance(1e-3) is Status.OK


def test_pairs_of_rows_of_bodies() -> None:
    """Of bodies with one, two, no and one row: equally many are written together, each in place."""
    out = np.full((2, 6), -1, dtype=np.int32)
    _write_pairs(np.array([7, 3, 5, 9]), np.array([0, 1, 3, 3, 4]), out)
    assert out.tolist() == [[7, 3, 5, 3, 5, 9], [7, 3, 3, 5, 5, 9]]


@pytest.mark.serial
def test_memory_of_serial_data() -> None:
    """Data of all bodies on each rank, and checks of them: 5 kB a body; 13 with rows of all."""
    options, count = ff.RunOptions(dt=1e-3, t_end=1.0), 300

    def look(number: int) -> list[object]:
        serial = NumberedModel(rigid_chain(number))
        return [serial, all_ends(serial), findings_of_run(serial, options)]

    look(10)  # imports
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        look(count)
        assert tracemalloc.get_traced_memory()[1] - before < 8000 * count
    finally:
        tracemalloc.stop()


def test_falls_are_found_beyond_the_first_joints() -> None:
    """Nine sliders along the fall do not hold a model that the tenth joint holds."""

    def sliders(last: type[ff.Spherical] | None) -> list[str]:
        model = ff.Model("sliders")
        model.add(ff.Gravity((0.0, 0.0, -9.81)), ff.RigidBody("block", 1.0, INERTIA))
        model.add(
            *(
                ff.Prismatic(f"way_{i}", ff.Ground(), ff.Marker("block"), axis=(0.0, 0.0, 1.0))
                for i in range(9)
            )
        )
        if last is not None:
            model.add(last("hold", ff.Ground(), ff.Marker("block")))
        return [one.check for one in check(model, ff.RunOptions(dt=1e-3, t_end=1.0))]

    assert "unconnected" in sliders(None)
    assert "unconnected" not in sliders(ff.Spherical)


@pytest.mark.serial
def test_chains_are_eliminated_from_the_ground() -> None:
    """A chain of rods, each three times as heavy as the one above, keeps its factors.

    From the free end the last pivot is the mobility of all rods together, 3^-23 of the first one's,
    which counts as zero: each step then falls back on full Newton, with two factorisations.
    """
    masses = 3.0 ** np.arange(24)
    centres = places(24)[:, ::-1] * (0.0, 0.0, -1.0)
    model = ff.Model("chain")
    rods = model.add(
        ff.Many(
            ff.RigidBody, "rod", ff.each(masses), ff.each(np.outer(masses, INERTIA[::-1])),
            position=ff.each(centres),
        )
    )  # fmt: skip
    tops, ends = (rods.markers(offset=(0.0, 0.0, z)) for z in (0.5, -0.5))
    model.add(
        ff.Many(ff.Revolute, "pin", ff.each([ff.Ground(), *ends[:-1]]), ff.each(tops), axis=Y),
        ff.Gravity((0.0, 0.0, -9.81)), ff.ReactionProbe("pull", "pin_0"),
    )  # fmt: skip
    outcome = simulate(model, ff.RunOptions(dt=1e-3, t_end=3e-3, quiet=True))
    assert outcome.summary["fallbacks"] == outcome.summary["factorizations"] == 0
    # the weight of all; without the last rod a third of it, and 1e-6 by pivots of round-off
    pull = max(np.abs(outcome.history[f"pull_f{axis}"][-1]) for axis in "xyz")
    assert pull == pytest.approx(9.81 * masses.sum(), rel=1e-9)
