# SPDX-License-Identifier: LGPL-3.0-or-later
"""What gradients refuse: in one line, which is on the page of errors."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli.command import command
from flexfem.families.shell_director.elements import DirectorShells
from tests.contract.gradient_examples import NUMBERS, body, damped_shell
from tests.contract.test_gradient_forces import propped
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

OPTIONS = ff.RunOptions(dt=1e-3, t_end=3e-3)


def _model(*more) -> ff.Model:
    model = body("se3", **NUMBERS)
    model.add(*more)
    return model


def _refused(
    text: str, *, model=None, of="final:tip_z", wrt=("bob.mass",), options=OPTIONS, **more
):
    with pytest.raises((ValueError, TypeError)) as raised:
        ff.gradient(_model() if model is None else model, of, wrt, options, **more)
    message = str(raised.value)
    assert "\n" not in message
    assert text in message
    assert_on_page(message)


BOB = ff.Marker("bob")
WRONG = [
    ("'last:tip_z' is not of the form", {"of": "last:tip_z"}),
    ("ks:tip_z needs a positive ks_rho, got None", {"of": "ks:tip_z"}),
    ("ks:tip_z needs a positive ks_rho, got -1.0", {"of": "ks:tip_z", "ks_rho": -1.0}),
    ("nothing to derive, name functionals", {"of": []}),
    ("nothing to derive by, name parameters", {"wrt": []}),
    # results by name keep one of both, and steps of one parameter are undone by the other's value
    ('"final:tip_z" is given twice', {"of": ["final:tip_z", " final:tip_z"]}),
    ('"bob.mass" is given twice', {"wrt": ["bob.mass", "bob.mass"]}),
    ('"gravity[2]" and "gravity.acceleration[2]" name the same',
     {"wrt": ["gravity[2]", "gravity.acceleration[2]"]}),
    ('there is no column "tip_w", did you mean', {"of": "final:tip_w"}),
    ('"bob.mas" leads nowhere at mas', {"wrt": ["bob.mas"]}),
    ('"bob.position[7]" leads nowhere at [7]', {"wrt": ["bob.position[7]"]}),
    ('"bob.position[x]" must have whole numbers in brackets', {"wrt": ["bob.position[x]"]}),
    ('"bob.position" is no real number, got array', {"wrt": ["bob.position"]}),
    ('"bob.name" is no real number', {"wrt": ["bob.name"]}),
    ("integrator must be 'generalized_alpha' or 'energy_momentum' or 'stabilized_index2', got 'i", {
        "options": ff.RunOptions(dt=1e-3, t_end=3e-3, integrator="independent_coordinates")}),
    ("4 states of the motion need", {"memory": 10.0}),
    ("memory must be a number of bytes, got nan", {"memory": np.nan}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "given"), WRONG, ids=[text[:24] for text, _ in WRONG])
def test_wrong_arguments(text, given):
    _refused(text, **given)


def _unsupported():
    yield (
        'Event "stop" has an action function, which has no derivatives yet',
        [ff.Event("stop", BOB, lambda t, bob: bob.position[2] + 9.0, lambda mechanism: None)],
    )
    yield (
        "there are no derivatives of stops that stay closed yet",
        [ff.LimitStop("end", ff.Ground(), BOB, axis=(1, 0, 0), upper=-5.0, stiffness=10.0)],
    )


def _counted(t, y, calls=[0]):  # noqa: B006
    calls[0] += 1
    return 0.1 * calls[0] + y[0]


class _Hidden:
    """A law that does not keep all its memory in its state."""

    state = np.zeros(1)

    def __init__(self):
        self.total = 0.0

    def update(self, t, y):
        self.total += y[0]
        return self.total


@pytest.mark.parametrize(
    ("law", "input", "text"),
    [
        (_Hidden(), "tip_z", 'Controller "servo": law does not return the same again at t ='),
        (_counted, "tip_z", 'Controller "servo": law does not return the same again at t ='),
        (lambda t, y: np.sin(1e12 * y[0]), "tip_z", "law has a kink or jumps at t ="),
        (lambda t, y: y[0], "energy_dissipation", 'column "energy_dissipation" of EnergyProbe'),
    ],
)
def test_controllers_without_derivatives(law, input, text):
    """A memory that is not carried would leave out its part of the gradient."""
    push = ff.PointForce("push", BOB, (0.0, 1.0, 0.0))
    servo = ff.Controller("servo", [input], ["push"], law, sample_time=OPTIONS.dt)
    _refused(text, model=_model(push, ff.EnergyProbe(), servo))


@pytest.mark.slow
def test_internal_variables_in_plane_stress():
    """They change the thickness, which acts on the forces in turn."""
    law = ff.laws.Viscoelastic(ff.laws.NeoHookean(2e6, 4e6), [1e6], [0.01])
    square = ff.SolidMesh.box((1, 1), (1, 1), "quadrilateral")
    model = ff.Model("sheet")
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Solid("sheet", law, square, density=1e3, plane="stress", degree=1),
        ff.PositionProbe("tip", ff.Marker("sheet", (1.0, 1.0, 0.0))),
    )
    _refused("derivatives of internal variables in plane stress", model=model, wrt=["gravity[1]"])


@pytest.mark.parametrize("number", range(2))
def test_unsupported_parts(number):
    text, things = list(_unsupported())[number]
    _refused(text, model=_model(*things))


def _with_corrections():
    stop = ff.Event("stop", BOB, lambda t, bob: bob.position[2] + 9.0, ff.ReleaseJoint("hinge"))
    yield "events", [stop]
    plane = ff.RigidPlane(ff.Ground((0.0, 0.0, -9.0)))
    yield "contacts", [ff.Contact("floor", "rod", surfaces=plane, radius=0.01, law="barrier")]
    end = ff.LimitStop("end", ff.Ground(), BOB, axis=(1, 0, 0), upper=9.0, stiffness=10.0)
    yield "stops and slack joints", [end]
    push = ff.PointForce("push", BOB, (0.0, 1.0, 0.0))
    servo = ff.Controller("servo", ["tip_z"], ["push"], lambda t, y: y[0], sample_time=OPTIONS.dt)
    yield "controllers", [push, servo]


@pytest.mark.parametrize("number", range(4))
def test_steps_with_corrections_of_positions(number):
    name, things = list(_with_corrections())[number]
    options = replace(OPTIONS, integrator="stabilized_index2")
    text = f"there are no derivatives of {name} with the integrator stabilized_index2 yet"
    _refused(text, model=_model(*things), options=options)


def test_shells_whose_damping_newtons_method_approximates():
    """Their corrections satisfy an equation with other matrices than the exact ones."""
    options = replace(OPTIONS, integrator="stabilized_index2")
    model = damped_shell("director", gravity=9.81, damping=0.02)
    text = "there are no derivatives of damping of shells with the integrator stabilized_index2"
    _refused(text, model=model, options=options, wrt=["gravity[2]"])


def _of_other_steps():
    stop = ff.Event("stop", BOB, lambda t, bob: bob.position[2] + 9.0, ff.ReleaseJoint("hinge"))
    yield "events with the integrator energy_momentum and rho_inf below 1", [stop], {}
    reaction = ff.ReactionProbe("reaction", "hinge", axes="b")
    plane = ff.RigidPlane(ff.Ground((0.0, 0.0, -9.0)))
    yield (
        "derivatives of forces of joints with contacts with the integrator energy_momentum",
        [reaction, ff.Contact("floor", "rod", surfaces=plane, radius=0.01, law="barrier")],
        {"of": "final:reaction_fx"},
    )


@pytest.mark.parametrize("number", range(2))
def test_steps_that_depend_on_both_ends(number):
    """Their adjoint knows neither these parts nor forces that are means over a step."""
    text, things, given = list(_of_other_steps())[number]
    options = replace(OPTIONS, integrator="energy_momentum", rho_inf=0.8)
    _refused(text, model=_model(*things), options=options, **given)


def _without_turning_rates(monkeypatch):
    """Let shells leave out how rotations change their strain rates."""
    monkeypatch.setattr(
        DirectorShells, "rate_changes", lambda self, block, shifts, scale: np.zeros((2, 1))
    )


def test_approximate_tangents(monkeypatch):
    """Their gradients would be off by 4e-8 to 0.2, and nothing would show."""
    _without_turning_rates(monkeypatch)
    _refused(
        'the linearised equations of Shell "rod", or of a body of its kind, are not exact',
        model=damped_shell("director", gravity=9.81, damping=5e-3),
        wrt=["gravity[2]"], of="final:tip_z", options=replace(OPTIONS, dt=5e-3, t_end=0.05),
    )  # fmt: skip


def test_fits_with_approximate_tangents(monkeypatch):
    _without_turning_rates(monkeypatch)
    build = partial(damped_shell, "director", gravity=9.81)
    with pytest.raises(ValueError, match="are not exact"):
        ff.identify(
            build, {"tip_z": np.zeros(11)}, {"damping": 5e-3},
            replace(OPTIONS, dt=5e-3, t_end=0.05),
        )  # fmt: skip


def test_columns_without_derivatives():
    probe = ff.Probe("noise", BOB, ("noise",), lambda t, bob: (np.sin(1e12 * bob.position[2]),))
    _refused(
        'a column of Probe "noise" has a kink or jumps at t =', model=_model(probe),
        of="final:noise",
    )  # fmt: skip


def test_meshes_that_jump():
    """Nodes inside move by some 1e-9 with each change of the parameter."""

    def build(length):
        random = np.random.default_rng(int(1e12 * length) % 2**32)
        mesh = ff.SolidMesh.box((length, 0.03, 0.02), (4, 2, 2))
        inside = (mesh.points[:, 0] > 1e-3) & (mesh.points[:, 0] < length - 1e-3)
        points = mesh.points + 1e-5 * inside[:, np.newaxis] * random.standard_normal((1, 3))
        mesh = replace(mesh, points=points).with_surfaces(left=lambda x: x[:, 0] == 0.0)
        law = ff.laws.NeoHookean(2e6, 4e6)
        model = ff.Model("bar")
        model.add(
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.Solid("rod", law, mesh, density=1100.0, degree=1, fixed={"left": "xyz"}),
            ff.PositionProbe("tip", ff.Marker("rod", (length, 0.03, 0.02))),
        )
        return model

    _refused('the equations jump where "length" changes by', model=build, wrt={"length": 0.5})


def test_columns_that_are_measured():
    _refused(
        'column "all_work" of EnergyProbe "all" has no derivatives yet',
        model=_model(ff.EnergyProbe("all")), of="final:all_work",
    )  # fmt: skip
    stairs = ff.AggregateProbe("stairs", "rod", lambda e, n, x: 1e15 * e[:, 4] % 1.0)
    _refused(
        'AggregateProbe "stairs" has a kink or jumps at a state', model=_model(stairs),
        of="final:stairs",
    )  # fmt: skip


def test_energies():
    whole = ff.SurfaceMesh.rectangle("strip", (0.4, 0.1), (4, 2))
    left, right = np.array_split(whole.bodies["strip"], 2)
    mesh = ff.SurfaceMesh(whole.points, whole.triangles, {"left": left, "right": right})
    section = ff.ShellSection.isotropic(0.01, ff.Material(5e6, 0.3, 1100.0))
    model = ff.Model("two", surface=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -0.1)), ff.Shell("left", section), ff.Shell("right", section),
        ff.EnergyProbe("one", ["left"]), ff.EnergyProbe("all"),
    )  # fmt: skip
    _refused(
        'EnergyProbe "one" of these bodies has no derivatives yet', model=model,
        of="final:one_kinetic", wrt=["gravity[2]"],
    )  # fmt: skip
    _refused(
        'column "all_gravity" of EnergyProbe "all" has no derivatives in equilibria yet',
        model=propped(youngs=5e6, push=2.0, stiffness=0.5, more=[ff.EnergyProbe("all")]),
        of="final:all_gravity", wrt=["rod.section.stiffness[4][4]"],
        options=ff.StaticOptions(load_steps=1),
    )  # fmt: skip


def _without_forces():
    """What forces of joints have no derivatives with."""
    hinge = ff.Revolute("axle", ff.Ground((0.55, 0.0, 0.0)), BOB, axis=(0.0, 1.0, 0.0))
    yield "friction", [hinge, ff.JointFriction("rub", hinge, coefficient=0.1, radius=0.1)]
    pushed = ff.Force("pushed", [BOB], lambda t, ends, z: -ends.velocities)
    yield "force elements", [pushed]
    touching = ff.LimitStop("end", ff.Ground(), BOB, axis=(1, 0, 0), upper=9.0, stiffness=10.0)
    yield "impulses of contacts, stops or slack springs", [touching]


@pytest.mark.parametrize(("what", "more"), [*_without_forces()], ids=["rub", "law", "slack"])
def test_forces_of_joints(what, more):
    """Another column of the same model has derivatives."""
    model = _model(*more, ff.ReactionProbe("force", "spring"))
    _refused(
        f"there are no derivatives of forces of joints with {what} yet", model=model,
        of="final:force_fz",
    )  # fmt: skip
    ff.gradient(model, "final:tip_z", ["bob.mass"], OPTIONS)


def test_controllers_of_forces():
    control = ff.Controller(
        "grip", ["force_fz"], ["load"], lambda t, y: 0.1 * y[0], sample_time=1e-3
    )
    model = _model(
        ff.ReactionProbe("force", "spring"),
        ff.PointForce("load", BOB, (0.0, 0.0, 1.0)),
        control,
    )
    _refused('Controller "grip" measures "force_fz", a force of a joint', model=model)


def test_functions():
    build = partial(body, "se3")
    _refused("wrt must be values by name", model=build, wrt=["mass"])
    _refused("the function returned 3, not a Model", model=lambda mass: 3, wrt={"mass": 1.0})
    _refused("give a Model or a function that builds one, got 5", model=5)
    _refused("mass must have two axes at most", model=build, wrt={"mass": np.ones((2, 2, 2))})
    _refused("mass must be finite", model=build, wrt={**NUMBERS, "mass": np.nan})


def test_parameters_that_make_another_model():
    def build(length):
        count = 4 if length > 0.5 else 3
        x = np.linspace(0.0, length, count + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
        cells = np.array([[i, i + 1] for i in range(count)])
        model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(count)}))
        rubber = ff.Material(5e6, 0.3, 1100.0)
        model.add(
            ff.Beam("rod", ff.Section.rectangle(0.03, 0.02, rubber)),
            ff.PositionProbe("tip", ff.Marker("rod", "end")),
        )
        return model

    _refused("changes the number of nodes, joints or states", model=build, wrt={"length": 0.5})


def test_parameters_that_change_the_states_of_a_force():
    def build(mass):
        count = 2 if mass > 1.0 else 1

        def law(t, ends, z):
            return np.array([[0.0, 0.0, -z[0]]]), None, np.array(ends.velocities[0, :count])

        model = ff.Model("disc")
        model.add(
            ff.RigidBody("bob", mass, (0.5, 0.5, 0.5)),
            ff.Force("pull", [BOB], law, states=count, initial=(0.0,) * count),
            ff.PositionProbe("tip", BOB),
        )
        return model

    _refused("changes the number of nodes, joints or states", model=build, wrt={"mass": 1.0})


@pytest.mark.parametrize("law", ["penalty", "barrier"])
def test_parameters_that_change_contacts(law):
    """The only one is not there on one side of the value, or another one is."""

    def build(other, density):
        u = np.linspace(-0.1, 0.1, 3)
        mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, np.full(len(p), 0.1)])
        section = ff.ShellSection.isotropic(1e-3, ff.Material(2e8, 0.3, density))
        model, name = ff.Model("sheet", surface=mesh), "light" if density <= 1000.0 else other
        model.add(
            ff.Shell("sheet", section),
            ff.PositionProbe("tip", ff.Marker("sheet", (-0.1, -0.1, 0.1))),
        )
        if name:
            model.add(ff.Contact(name, "sheet", surfaces=ff.RigidPlane(ff.Ground()), law=law))
        return model

    for other in (None, "heavy"):
        _refused(
            'gradient: "density" changes which contacts there are', model=partial(build, other),
            wrt={"density": 1000.0},
        )  # fmt: skip


@pytest.mark.parametrize(
    ("what", "analysis"),
    [
        ("probes", "motion"), ("controllers", "motion"), ("events", "motion"),
        ("probes", "statics"), ("probes", "response"),
    ],
)  # fmt: skip
def test_parameters_that_change_what_is_known_by_its_number(what, analysis):
    """Columns of another probe were taken for those of the one at its place, without a word."""

    def build(mass):
        model, above = ff.Model("disc"), mass > 1.0
        tip = ff.PositionProbe("tip", BOB)
        square = ff.Probe("square", BOB, ["z2"], lambda t, bob: [bob.position[2] ** 2])
        model.add(
            ff.RigidBody("bob", mass, (0.5, 0.5, 0.5)),
            ff.Prismatic("rail", ff.Ground(), BOB, axis=(0.0, 0.0, 1.0)),
            ff.SpringDamper("spring", ff.Ground((0.0, 0.0, 1.0)), BOB, stiffness=100.0),
            ff.PointForce("push", BOB, (0.0, 0.0, 1.0)),
            *((square, tip) if above and what == "probes" else (tip, square)),
        )
        if above and what == "controllers":
            model.add(ff.Controller("servo", ["tip_z"], ["push"], lambda t, y: 1.0 - y[0]))
        if above and what == "events":
            model.add(ff.Event("stop", BOB, lambda t, bob: t - 1.5e-3, ff.Stop()))
        return model

    given = {
        "motion": {},
        "statics": {"options": ff.StaticOptions(quiet=True)},
        "response": {"options": ff.LinearOptions(quiet=True), "of": "gain:tip_z/push@2"},
    }[analysis]
    text = f'gradient: "mass" changes which {what} there are, or their order; keep them'
    _refused(text, model=build, wrt={"mass": 1.0}, **given)


def test_parameters_at_the_end_of_their_range():
    def build(inertia):
        model = ff.Model("disc")
        model.add(ff.RigidBody("bob", 1.0, (0.5, 0.5, inertia)), ff.PositionProbe("path", BOB))
        return model

    text = 'the model with a slightly different "inertia" is refused: RigidBody "bob": inertia'
    _refused(text, model=build, of="final:path_z", wrt={"inertia": 1.0})


def _falling(*actions):
    return [
        ff.Event(f"event {k}", BOB, lambda t, bob: t - 1.5e-3, action)
        for k, action in enumerate(actions)
    ]


def test_events():
    release = ff.ReleaseJoint("pin"), ff.ReleaseJoint("spring")
    _refused("several events happen at the same time", model=_model(*_falling(*release)))
    _refused("has an action function, which", model=_model(*_falling(lambda mechanism: None)))
    force = ff.PointForce("p", BOB, (0, 9, 0), amplitude=lambda t: abs(t - 1.5e-3))
    _refused("at a kink of a load or drive", model=_model(force, *_falling(release[0])))
    bent = ff.Probe("bent", BOB, ("bent",), lambda t, bob: (abs(t - 1.5e-3),))
    _refused("at a kink of a column", model=_model(*_falling(ff.Stop()), bent), of="final:bent")
    holding = _model(*_falling(ff.LockJoint("spring")))
    _refused("an event holds a joint with a force law", model=holding)


def test_jumps_while_bodies_touch():
    """Forces of contacts are no part of accelerations that are computed again."""
    force = ff.TimeFunction(lambda t: float(t < 0.0015), [0.0015])
    model = _model(
        ff.PointForce("push", BOB, (0.0, 1.0, 0.0), amplitude=force),
        ff.RigidBody("ball", 1.0, (0.1,) * 3, position=(0.0, 0.0, -0.949), shape=ff.Sphere(0.05)),
        ff.Contact(
            "landing", "ball", reach=0.002, surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -1.0)))
        ),
    )  # fmt: skip
    _refused("which has no derivatives with contacts or stops that are closed yet", model=model)


def test_impacts_behind_an_event():
    stop = ff.LimitStop("end", ff.Ground(), BOB, axis=(0, 0, 1), upper=4e-6, stiffness=1e3)
    model = _model(stop, *_falling(ff.ReleaseJoint("spring")))
    _refused("behind an event, which has no derivatives yet", model=model)


def test_events_with_states_of_laws():
    """States depend on the sizes of steps, which an event changes."""

    def law(t, ends, z, numbers):
        return np.zeros((2, 3)), None, -100.0 * z

    model = _model(
        *_falling(ff.ReleaseJoint("spring"))[:1],
        ff.Force("late", [ff.Ground(), BOB], law, states=1, initial=[0.1]),
    )
    _refused("which has no derivatives with states of Force yet", model=model)


def test_times_of_kinks():
    def build(time):
        model = _model()
        force = ff.Table([0.0, time, 1.0], [0.0, 1.0, 1.0])
        model.add(ff.PointForce("push", BOB, (0.0, 1.0, 0.0), amplitude=force))
        return model

    # that of a kink at the end of a step, too
    for time in (0.0015, 0.002):
        _refused(
            '"time" moves the time of a jump or kink', model=build, wrt={"time": time}
        )  # fmt: skip


def test_equations_that_jump():
    def build(mass):
        stiffness = 40.0 if mass > 0.3 else 41.0
        return body("se3", **{**NUMBERS, "mass": mass, "stiffness": stiffness})

    _refused("the equations jump where", model=build, wrt={"mass": 0.3})


def two_rows_of(mass: float) -> ff.Model:
    """A falling body whose rows change places beside a mass of 1, where they have no forces."""
    sides = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    model, bob = ff.Model("guided"), ff.Marker("bob")
    model.add(ff.RigidBody("bob", mass, (0.1, 0.2, 0.3)), ff.Gravity((0.0, 0.0, -9.81)))
    for name, axis in zip("ab", sides if mass == 1.0 else sides[::-1], strict=True):
        model.add(ff.PointOnPlane(name, ff.Ground(), bob, axis=axis))
    model.add(ff.PositionProbe("tip", bob))
    return model


def test_rows_that_change_places():
    options = ff.RunOptions(dt=1e-3, t_end=3e-3)
    _refused("the equations jump where", model=two_rows_of, wrt={"mass": 1.0}, options=options)


def test_the_command(command_folder, capsys):
    """The table, the file, and one line with exit code 2 for a name that is none."""
    line = ["gradient", "tutorial_1_pendulum", "--t-end", "0.01", "--elements", "2"]
    assert command([*line, "--of", "final:path_z", "--wrt", "gravity,rod.velocity[0]"]) == 0
    printed = capsys.readouterr().out
    assert "final:path_z" in printed
    assert "with 0 factorisations; adjoint and tangent agree to" in printed
    assert (command_folder / "results/tutorial_1_pendulum_gradient/gradient.json").is_file()
    for names, text in (
        ("gravit", "did you mean gravity"), ("gravity,gravity", '"gravity" is given twice'),
    ):  # fmt: skip
        assert command([*line, "--of", "final:path_z", "--wrt", names]) == 2
        error = capsys.readouterr().err.strip()
        assert text in error
        assert_on_page(error.removeprefix("error: "))
