# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions: every family and joint against the tangent and differences of motions."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.gradients.motion.functionals import parse
from tests.contract.gradient_examples import (
    KINDS,
    NET,
    NUMBERS,
    PARTS,
    RUBBING,
    STRIP,
    body,
    damped_shell,
    jointed,
    mechanism,
    netted,
    rubbing,
    strip,
)
from tests.contract.joint_examples import EXAMPLES
from tests.histories import columns

THROWN = {"mass": 1.3, "gravity": 9.81, "kick": 0.4}
#: Joints of all kinds of rows in the ordinary tests: drives, laws, functions, several markers.
SOME = ("Universal", "PrescribedRotation", "Bushing-functions", "Pulley")
#: Joints that are refused, closed at the start, and those that have bodies of their own.
REFUSED = ("LimitStop", "Cam-flat")
OTHERS = [
    name
    for name, example in EXAMPLES.items()
    if example.make is None and not name.startswith(REFUSED) and name not in SOME
]


def moved_values(build, numbers, of, options):
    """Values of functionals of the motion with other numbers, (functionals,)."""
    history = columns(ff.simulate(build(**numbers), options))
    return np.array([parse(one).value(history) for one in of])


def difference(build, numbers, along, of, options, step=1e-3):
    """Central difference of fourth order of whole motions, (functionals,).

    ``along`` has the change of each number over its value.
    """
    found = np.zeros(len(of))
    for part, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
        changed = {
            name: value * (1.0 + part * step * by)
            for (name, value), by in zip(numbers.items(), along, strict=True)
        }
        found += weight / step * moved_values(build, changed, of, options)
    return found


def errors(gradient, build, numbers, of, options, step=1e-3):
    """Errors (functionals,) along one direction of all numbers, over the largest share of one.

    Four motions tell as much as four for each number: shares of the numbers, each of which changes
    by a half to all of its size, do not cancel but by chance.
    """
    random, values = np.random.default_rng(7), np.array(list(numbers.values()))
    along = random.choice([-1.0, 1.0], len(values)) * random.uniform(0.5, 1.0, len(values))
    shares = np.array([[by[name] for name in numbers] for by in gradient.values()]) * values
    expected = difference(build, numbers, along, of, options, step)
    return np.abs(shares @ along - expected) / np.abs(shares).max(axis=1)


def compare(build, numbers, of, options, accuracy, step=1e-3):
    found = ff.gradient(build, of, numbers, options, accuracy=1e-12, check=True)
    # the adjoint is the transposed tangent: a transposition that is missing gives 1e-6 and more
    assert max(found.check.values()) < 1e-9
    assert found.factorizations_backward == 0
    # a term that is missing in the linearised scheme gives 1e-5 and more
    assert errors(found.gradient, build, numbers, of, options, step).max() < accuracy


def agree_on_ranks(build, numbers, of, options, accuracy=1e-12):
    """Gradients by all ranks together are those of each alone, to the largest share of a number."""
    together, alone = (
        ff.gradient(build, of, numbers, options, accuracy=accuracy, comm=comm).gradient
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    for one in of:
        size = max(abs(alone[one][name] * numbers[name]) for name in numbers)
        for name, value in numbers.items():
            # a share that is missing, or counted twice, is a tenth and more
            assert abs((together[one][name] - alone[one][name]) * value) < 1e-9 * size, (one, name)


@pytest.mark.serial
@pytest.mark.parametrize("kind", KINDS)
def test_families(kind):
    """Differences have noise of 1e-9: motions end with Newton steps of 1e-13 m or rad."""
    options = ff.RunOptions(dt=1e-3, t_end=8e-3, tolerance=1e-13)
    compare(partial(body, kind), NUMBERS, ["final:tip_z", "mean:speed"], options, 2e-7)


@pytest.mark.slow
@pytest.mark.serial
def test_directors_that_turn_far():
    """They turn about themselves by what others leave: without it errors of 1e-5."""
    build = partial(body, "director", **{k: NUMBERS[k] for k in ("youngs", "density", "mass")})
    options, of = ff.RunOptions(dt=5e-3, t_end=0.1, tolerance=1e-13), ["final:tip_y", "mean:speed"]
    compare(build, {"gravity": 9.81, "stiffness": 40.0}, of, options, 1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("how", ["shell", "law"])
@pytest.mark.parametrize("element", ["director", "rotation_free"])
def test_damped_shells(element, how):
    """Rates of strain that change with rotations alone: 1e-4 and more without that."""
    options = ff.RunOptions(dt=5e-3, t_end=0.05, tolerance=1e-13)
    build = partial(damped_shell, element, how)
    compare(build, {"gravity": 9.81, "damping": 5e-3}, ["final:tip_y", "mean:tip_z"], options, 1e-8)


@pytest.mark.serial
def test_nets_of_cables():
    """Cables become slack and taut: a damper that is left out there gives 1e-3."""
    options = ff.RunOptions(dt=5e-3, t_end=0.06, rho_inf=0.8, tolerance=1e-13)
    compare(netted, NET, ["final:at_z", "mean:at_x"], options, 1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_damped_modes_of_directors():
    """Their forces turn with directors about themselves as well: 1e-7 and more without that."""
    options = ff.RunOptions(dt=5e-3, t_end=0.1, tolerance=1e-13)
    build = partial(damped_shell, "director", "modes", damping=5e-3)
    compare(build, {"gravity": 9.81}, ["final:tip_y", "final:tip_z"], options, 1e-8)


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize(
    ("element", "accuracy"), [("solid", 2e-6), ("director", 5e-8), ("rotation_free", 2e-6)]
)
def test_shapes_that_move_fixed_nodes(element, accuracy):
    """A clamped edge that stayed where it was would stretch: wrong by the whole derivative."""
    options = ff.RunOptions(dt=1e-3, t_end=8e-3, tolerance=1e-13)
    of = ["final:tip_x", "final:tip_y", "final:tip_z", "mean:root_y"]
    compare(partial(strip, element), STRIP, of, options, accuracy)


@pytest.mark.serial
def test_accelerations_of_rods_turned_at_the_start():
    """They do not depend on the direction of the rod."""

    def build(angle):
        along, aluminium = (
            np.array([np.cos(angle), np.sin(angle), 0.0]),
            ff.Material(7e10, 0.3, 2.7e3),
        )
        mesh = ff.LineMesh.straight({"rod": [0.3 * along, 0.55 * along]}, elements=2)
        model = ff.Model("rod", mesh=mesh)
        root, tip = (ff.Marker("rod", end) for end in ("start", "end"))
        model.add(
            ff.Beam("rod", ff.Section.rectangle(0.005, 0.008, aluminium)),
            ff.Revolute("hinge", ff.Ground(0.3 * along), root, axis=(0.0, 0.0, 1.0)),
            ff.PointMoment("torque", tip, (0.0, 0.0, 1e-3)),
            ff.Probe("tip", tip, ("turning",), lambda t, end: (end.angular_acceleration[2],)),
        )
        return model

    options = ff.RunOptions(dt=2.5e-4, t_end=5e-4, quiet=True)
    found = ff.tangent_motion(build, {"angle": 0.7}, {"angle": 1.0}, options)
    assert found.history["turning"][0] > 7e4
    # rounding of strains over the difference of the angle, 1e-5, gave -66 rad/s^2, and now -0.2
    assert np.abs(found.derivative["turning"]).max() < 5.0


@pytest.mark.serial
def test_columns_near_a_kink():
    """A deflection of 1e-5 m: with differences of 1e-3 m its derivative is a tenth of it."""

    def build(pull):
        model = mechanism(**{**PARTS, "sideways": pull})
        model.add(
            ff.Probe(
                "aside", ff.Marker("second"), ("aside",),
                lambda t, body: (float(np.linalg.norm(body.position - (1.2, 0.0, 0.0))),),
            )
        )  # fmt: skip
        return model

    options = ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-13)
    compare(build, {"pull": 0.4}, ["final:aside"], options, 1e-6)


@pytest.mark.serial
def test_numbers_of_all_parts():
    """Those of springs, drives, loads, arms, masses and of the start."""
    options = ff.RunOptions(dt=2e-3, t_end=0.012, tolerance=1e-13)
    compare(mechanism, PARTS, ["final:p_x", "final:p_z", "mean:own"], options, 2e-8)


@pytest.mark.serial
def test_friction_by_the_force_in_a_joint():
    options = ff.RunOptions(dt=2e-3, t_end=0.02, tolerance=1e-13)
    compare(rubbing, RUBBING, ["final:tip_x", "final:tip_z"], options, 1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("name", SOME)
def test_joints(name):
    options = ff.RunOptions(dt=2e-3, t_end=0.01, tolerance=1e-13)
    compare(partial(jointed, name), THROWN, ["final:p0_x", "mean:p1_z"], options, 1e-7)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_axes_of_joints(axis):
    """About coordinate axes, too, the rows' directions are smooth functions of the axis."""
    first, second = np.roll(axis, 1), np.roll(axis, 2)

    def build(by_first, by_second):
        tilted = axis + (by_first - 1.0) * first + (by_second - 1.0) * second
        bob = ff.Marker("bob")
        model = ff.Model("tilted")
        model.add(
            ff.Gravity((3.0, -4.0, -8.0)),
            ff.RigidBody("bob", 1.0, (0.1, 0.2, 0.3), position=(0.2, 0.3, 0.4)),
            ff.Revolute("hinge", ff.Ground(), ff.Marker("bob", offset=(-0.2, -0.3, -0.4)), tilted),
            ff.PositionProbe("end", bob),
        )
        return model

    options = ff.RunOptions(dt=5e-3, t_end=0.1, tolerance=1e-13)
    of = [f"final:end_{name}" for name in "xyz"]
    # rows that change places beside a coordinate axis give 0.1 and more
    compare(build, {"by_first": 1.0, "by_second": 1.0}, of, options, 1e-7)


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("name", OTHERS)
def test_other_joints(name):
    test_joints(name)


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    "kind",
    [
        "se3",
        *(pytest.param(k, marks=pytest.mark.three_ranks) for k in ("solid", "rubbing", "director")),
    ],
)
def test_ranks_agree(kind):
    """All ranks together find what each finds by itself; there may be ranks without bodies."""
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-12, split_above=1)
    build, numbers = partial(body, kind), NUMBERS
    if kind == "rubbing":
        build, numbers = rubbing, RUBBING
    if kind == "director":
        build = partial(damped_shell, kind)
        numbers = {"gravity": 9.81, "damping": 5e-3}
    alone, together = (
        ff.gradient(build, "final:tip_z", numbers, options, accuracy=1e-13, comm=comm)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for name, value in alone.gradient["final:tip_z"].items():
        # a share that is missing, or counted twice, is a tenth and more
        assert together.gradient["final:tip_z"][name] == pytest.approx(value, rel=1e-9)


def _rod(density, heights=(), moduli=()):
    count = len(heights) or len(moduli)
    x = np.linspace(0.0, 0.5, count + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.array([[i, i + 1] for i in range(count)])
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(count)}))
    if not len(heights):
        heights = np.full(count, 0.02)
    if not len(moduli):
        moduli = np.full(count, 5e6)
    sections = [
        ff.Section.rectangle(0.03, height, ff.Material(modulus, 0.3, density))
        for height, modulus in zip(heights, moduli, strict=True)
    ]

    def section(s):
        return sections[min(int(s / 0.5 * count), count - 1)]

    model.add(
        ff.Gravity((0.0, 0.0, -9.81)), ff.Beam("rod", section),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )  # fmt: skip
    return model


@pytest.mark.parametrize(
    ("name", "size", "models"),
    [("heights", 0.02, 10), pytest.param("moduli", 5e6, 8, marks=pytest.mark.slow_on_ranks)],
)
def test_arrays_of_elements_take_few_models(name, size, models):
    """One number for each element, against the tangent with models of each entry."""
    count = 7
    numbers = size * (1.0 + 0.3 * np.sin(np.arange(count)))
    options = ff.RunOptions(dt=1e-3, t_end=0.01, tolerance=1e-12)
    values, built = {name: numbers, "density": 1100.0}, []

    def build(**given):
        built.append(0)
        return _rod(**given)

    found = ff.gradient(build, "final:tip_z", values, options, accuracy=1e-12)
    # the motion, a pair for the density, 2 for each of two groups of the array, 1 with all of them,
    # and 2 more where they are not linear; 14 with a pair for each entry
    assert len(built) == models
    along = {name: numbers * np.cos(np.arange(count)), "density": 50.0}
    tangent = ff.tangent_motion(_rod, values, along, options, accuracy=1e-12)
    own = found.gradient["final:tip_z"]
    sums = own[name] @ along[name] + 50.0 * own["density"]
    expected = MPI.COMM_WORLD.bcast(tangent.derivative.get("tip_z"))[-1]
    # an entry given to its neighbour changes the sum by a tenth
    assert sums == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow_on_ranks
def test_entries_that_do_not_meet_are_one_group():
    """Masses of bodies, each on a spring of its own: as many as nodes, but no two at one."""
    built = []

    def build(masses):
        built.append(0)
        model = ff.Model("row")
        for k, mass in enumerate(masses):
            body, place = ff.Marker(f"body_{k}"), (0.5 * k, 0.0, 0.0)
            model.add(
                ff.RigidBody(
                    f"body_{k}", mass, (0.1, 0.1, 0.1), position=(0.5 * k + 1.2, 0.0, 0.0)
                ),
                ff.SpringDamper(
                    f"spring_{k}", ff.Ground(place), body, stiffness=400.0, damping=1.0,
                    rest_length=1.0,
                ),
            )  # fmt: skip
        chosen = [ff.Marker(f"body_{k}") for k in range(len(masses))]
        model.add(
            ff.Probe("sum", chosen, ("x",), lambda t, *s: (sum(one.position[0] for one in s),))
        )
        return model

    masses = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
    options = ff.RunOptions(dt=1e-2, t_end=0.1, tolerance=1e-12)
    found = ff.gradient(build, "final:x", {"masses": masses}, options, accuracy=1e-12)
    # the motion, 2 for each of two groups, 1 with more of all and 1 far away; 11 with pairs
    assert len(built) == 7
    tangent = ff.tangent_motion(build, {"masses": masses}, {"masses": masses}, options)
    expected = MPI.COMM_WORLD.bcast(tangent.derivative.get("x"))[-1]
    # an entry given to another body changes the sum by a tenth
    assert found.gradient["final:x"]["masses"] @ masses == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@pytest.mark.serial
def test_arrays_that_act_at_other_times():
    """Knots of a force, which act one after the other, and forces, one of which acts later."""

    def build(knots, late):
        model = mechanism(**PARTS)
        ramp = ff.Table([0.0, 4e-3, 8e-3, 1.0], [0.0, 0.0, 1.0, 1.0])
        model.add(
            ff.PointForce(
                "early", ff.Marker("first"), (0.0, 0.0, 1.0),
                amplitude=ff.Table(np.append(np.arange(len(knots)) * 2e-3, 1.0), [*knots, 0.0]),
            ),
            *(ff.PointForce(f"late_{k}", ff.Marker(name), (0.0, 0.0, one), amplitude=ramp)
              for k, (name, one) in enumerate(zip(3 * ["first", "second"], late, strict=True))),
        )  # fmt: skip
        return model

    values = {"knots": np.linspace(1.0, 2.0, 7), "late": np.linspace(2.0, 1.0, 6)}
    options = ff.RunOptions(dt=1e-3, t_end=0.012, tolerance=1e-13)
    found = ff.gradient(build, "final:p_z", values, options, accuracy=1e-12)
    for name, given in values.items():
        for k in range(len(given)):

            def one(value, name=name, k=k):
                moved = values[name].copy()
                moved[k] = value
                return build(**{**values, name: moved})

            expected = difference(one, {"value": given[k]}, [1.0], ["final:p_z"], options)[0]
            own = found.gradient["final:p_z"][name][k] * given[k]
            # of equations at the start alone all but the first knot's are zero
            assert own == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("element", ["solid", "director", "rotation_free"])
def test_fixed_corners_move_as_their_edge_grows(element):
    """The corner of a clamped edge that begins at y = 0 is at y = width, on any rank."""
    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-12)
    found = ff.gradient(partial(strip, element), "final:root_y", STRIP, options).gradient
    assert found["final:root_y"]["width"] == pytest.approx(1.0, abs=1e-9)
    assert found["final:root_y"]["length"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow_on_ranks
def test_states_that_do_not_fit_are_computed_again_or_on_disk(shared_tmp_path):
    options = ff.RunOptions(dt=1e-3, t_end=0.012, tolerance=1e-13)
    build = partial(body, "se3")
    whole, parts, few, stored = (
        ff.gradient(build, "mean:tip_z", NUMBERS, options, accuracy=1e-12, **storage)
        for storage in (
            {}, {"memory": 2.4e4}, {"memory": 1e4}, {"memory": 5e3, "scratch": shared_tmp_path}
        )
    )  # fmt: skip
    for name, value in whole.gradient["mean:tip_z"].items():
        # a state of another step gives 1e-3 and more
        assert parts.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-9)
        assert few.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-9)
        assert stored.gradient["mean:tip_z"][name] == value
    assert whole.steps_repeated == stored.steps_repeated == 0 < parts.steps_repeated
    assert parts.steps_repeated < few.steps_repeated
    assert not list(shared_tmp_path.iterdir())
    with pytest.raises(ValueError, match=r"scratch folder .*missing cannot be written: No such"):
        ff.gradient(build, "mean:tip_z", NUMBERS, options, scratch=shared_tmp_path / "missing")
    with pytest.raises(ValueError, match=r"4 states of the motion need .* GB of memory on a"):
        ff.gradient(build, "mean:tip_z", NUMBERS, options, memory=1e3)


@pytest.mark.serial
def test_functionals_are_the_derivatives_of_their_values():
    t, x = np.linspace(0.0, 1.0, 6), np.array([0.3, 0.7, -0.4, 0.9, 0.2, 0.5])
    for text in ("final:x", "mean:x", "integral:x", "rms:x", "max:x", "min:x", "ks:x"):
        one = parse(text, ks_rho=3.0)
        (own,) = one.derivative({"t": t, "x": x})
        for k in range(len(x)):
            moved = [one.value({"t": t, "x": x + e * np.eye(1, 6, k)[0]}) for e in (1e-6, -1e-6)]
            # a wrong weight is a tenth
            assert own[k] == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-8)


@pytest.mark.serial
def test_inaccurate_gradients_warn():
    options = ff.RunOptions(dt=1e-2, t_end=0.1, iteration_matrix="frozen")
    found = ff.gradient(
        partial(body, "se3"), "final:tip_z", NUMBERS, options, accuracy=0.5, check=True
    )
    # solutions that are off by a tenth of what one solve with old factors gives
    assert found.check["final:tip_z"] > 1e-4
    assert found.warnings[0].startswith('adjoint and tangent of "final:tip_z" differ by ')
