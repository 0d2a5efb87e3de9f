# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams with laws of the user: exact derivatives, groups of cells, shared code, bad laws."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem.forms.beam import beam_forms
from flexfem.forms.beam_law import interval_mesh, law_expressions, law_form
from flexfem.layout.numbered_model import NumberedModel
from flexfem.mesh.line_mesh import LineMesh
from flexfem.system.build import build
from tests.unit.linear_law import linear_law

ROOT = Path(__file__).parents[2]
INERTIA = (2.0, 2.0, 2.0, 0.3, 0.2, 0.1)
VALUES = {
    "EA": 90.0, "b": 2.0, "GA": 40.0, "GJ": 20.0, "EI": 10.0, "k0": 2.5, "s": 1.0, "c": 6.0,
    "eta": 3.0, "r0": 1.5,
}  # fmt: skip
CORNERS = [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.6, 0], [1, 0.6, 0.7], [1, 1.2, 0.7]]
S = np.linspace(0.0, 3.0, 6)
SHAPES = {
    "straight": np.linspace([0.1, 0.2, -0.1], [1.3, 0.9, 0.8], 6),
    "helix": np.stack([np.cos(S), np.sin(S), 0.4 * S], axis=1),
    "corner": np.array(CORNERS, dtype=float),
}


def energy(strain, p):
    """Stiffening extension, softening (s = 1) or stiffening (s = -1) bending, couplings."""
    g1, g2, g3, k1, k2, k3 = strain
    bending = p.s * p.EI * p.k0**2 * (ufl.sqrt(1 + p.s * (k2**2 + k3**2) / p.k0**2) - 1)
    stretching = p.EA * (g1**2 / 2 + p.b * g1**4 / 4)
    return (
        stretching
        + p.GA * (g2**2 + g3**2) / 2
        + p.GJ * k1**2 / 2
        + bending
        + p.c * (g1 * k1 + g2 * k3**2)
    )


def dissipation(strain, rate, p):
    """Thinning in the rate, thickening in the strain."""
    thinning = p.r0**2 * (ufl.sqrt(1 + ufl.inner(rate, rate) / p.r0**2) - 1)
    return p.eta * (1 + ufl.dot(strain, strain)) * thinning


def resultants(strain, p):
    """Derivative of the energy by hand."""
    g1, g2, g3, k1, k2, k3 = strain.T
    bend = p["EI"] / np.sqrt(1 + p["s"] * (k2**2 + k3**2) / p["k0"] ** 2)
    return np.stack(
        [
            p["EA"] * (g1 + p["b"] * g1**3) + p["c"] * k1,
            p["GA"] * g2 + p["c"] * k3**2,
            p["GA"] * g3,
            p["GJ"] * k1 + p["c"] * g1,
            bend * k2,
            bend * k3 + 2.0 * p["c"] * g2 * k3,
        ],
        axis=1,
    )


LAW = ff.BeamLaw(energy, dissipation=dissipation, parameters=VALUES)
SECTION = ff.Section.general(law=LAW, inertia=INERTIA)


# --- derivatives ---------------------------------------------------------------------------------


@pytest.mark.serial
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("moving", [True, False], ids=["moving", "stiffness"])
def test_tangent_and_action_are_the_derivative_of_the_residual(one_beam, shape, moving, rng):
    beam = one_beam(SHAPES[shape], SECTION, inertial=True)
    shifts = beam.shifts if moving else np.array([0.0, 0.0, 1.0])
    beam.gravity = np.array([3.0, -7.0, 2.0])
    beam.disturb(rng)
    state, eps = beam.state(), 2e-6
    for _ in range(2):
        step, sides = beam.random(rng, 1.0), []
        for sign in (1.0, -1.0):
            beam.move(state, sign * eps * step, shifts)
            sides.append(beam.residual(0.3))
        beam.move(state, 0.0 * step, shifts)
        expected = (sides[0] - sides[1]) / (2.0 * eps)
        # differences are good to 1e-9; the viscous stress kept constant, or one of its two
        # dependences (strain, rate) forgotten, is off by 1e-2 and more
        bound = 1e-7 * beam.largest(expected)
        assert beam.largest(beam.product(step, shifts, 0.3) - expected) <= bound
        assert beam.largest(beam.action(step, shifts, 0.3) - expected) <= bound


@pytest.mark.parametrize("shape", SHAPES)
def test_internal_force_is_the_gradient_of_the_summed_energy(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SECTION)
    beam.disturb(rng)
    beam.block.velocity[:], beam.block.acceleration[:] = 0.0, 0.0
    state, step, eps, energies = beam.state(), beam.random(rng, 1.0), 1e-5, []
    for sign in (1.0, -1.0):
        beam.move(state, sign * eps * step, np.zeros(3))
        energies.append(beam.energy())
    beam.move(state, 0.0 * step, np.zeros(3))
    power = beam.total((beam.residual() * step[: beam.block.owned]).ravel())
    # a factor L or a stress of another strain is wrong by its own size
    assert power == pytest.approx((energies[0] - energies[1]) / (2.0 * eps), rel=1e-7)


def test_resultants_are_those_of_the_law(one_beam, rng):
    beam = one_beam(SHAPES["corner"], SECTION)
    beam.disturb(rng)
    strain, found = beam.beams.resultants(beam.block.frames)
    expected = resultants(strain, VALUES)
    # the linear part alone is off by a tenth
    assert beam.largest(found - expected) <= 1e-13 * beam.largest(expected)


def test_viscous_power_is_that_of_the_potential(one_beam, rng):
    """Motion in which only the rates matter: force times velocity = stress times strain rate."""
    beam = one_beam(SHAPES["straight"], SECTION)
    beam.block.velocity[:] = beam.random(rng, 0.8)
    beam.block.acceleration[:] = 0.0
    moving = beam.residual()
    plain = one_beam(SHAPES["straight"], ff.Section.general(law=LAW.with_parameters(eta=0.0),
                                                          inertia=INERTIA))  # fmt: skip
    plain.block.velocity[:] = beam.block.velocity
    plain.block.acceleration[:] = 0.0
    owned = beam.block.velocity[: beam.block.owned]
    power = beam.total(((moving - plain.residual()) * owned).ravel())
    h, state = 1e-6, beam.state()
    ends = []
    for sign in (1.0, -1.0):
        beam.move(state, sign * h * state.velocity, np.zeros(3))
        ends.append(beam.strain())
    rate = (ends[0] - ends[1]) / (2.0 * h)
    size = np.einsum("mi,mi->m", rate, rate)
    expected = VALUES["eta"] * size / np.sqrt(1.0 + size / VALUES["r0"] ** 2)
    # the potential itself in place of its derivative would give about half
    assert power == pytest.approx(beam.total(expected * beam.beams.lengths), rel=1e-7)


# --- the linear law ------------------------------------------------------------------------------


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_linear_law_reproduces_the_section(one_beam, rng):
    root = rng.normal(size=(6, 6))
    D = root @ root.T + 6.0 * np.eye(6)
    section = ff.Section.general(D, INERTIA)
    own = section.with_law(linear_law(D, 0.02))
    beams = [one_beam(SHAPES["corner"], section, 0.02), one_beam(SHAPES["corner"], own)]
    results = []
    for beam in beams:
        beam.gravity = np.array([3.0, -7.0, 2.0])
        beam.disturb(np.random.default_rng(3))
        step = beam.random(np.random.default_rng(4), 1.0)
        results.append(
            (
                beam.residual(),
                beam.beams.tangent(beam.block, beam.gravity, beam.shifts, 0.3),
                beam.action(step, beam.shifts, 0.3),
                *beam.beams.resultants(beam.block.frames),
                beam.beams.energies(beam.block.frames),
            )
        )
    for linear, own in zip(*results, strict=True):
        # the same numbers in another order of operations; any other physics is off by 1e-3
        assert beams[0].largest(own - linear) <= 1e-12 * beams[0].largest(linear)


# --- several laws --------------------------------------------------------------------------------

MIXTURE = {
    "linear": ff.Section.general((1e3, 400.0, 300.0, 20.0, 10.0, 5.0), INERTIA),
    "soft": SECTION,
    "stiff": ff.Section.general(
        law=LAW.with_parameters(s=-1.0, k0=9.0), inertia=(3.0, 3.0, 3.0, 0.2, 0.1, 0.1)
    ),
    "linear_2": ff.Section.general((2e3, 800.0, 700.0, 30.0, 15.0, 6.0), INERTIA),
}


def _mixture(names: list[str], split_above: int):
    """Part of the beams of a model in which beams with the given sections lie side by side."""
    from mpi4py import MPI

    n = 4
    line = np.linspace([0.0, 0.0, 0.0], [1.2, 0.3, 0.1], n + 1)
    along = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    shifts = [[0.0, 2.0 * list(MIXTURE).index(name), 0.0] for name in names]
    points = np.concatenate([line + np.array(shift) for shift in shifts])
    cells = np.concatenate([along + (n + 1) * k for k in range(len(names))])
    groups = {name: np.arange(n * k, n * (k + 1)) for k, name in enumerate(names)}
    model = ff.Model("mixture", mesh=LineMesh(points, cells, groups))
    model.add(*(ff.Beam(name, MIXTURE[name]) for name in names))
    model.validate()
    return build(NumberedModel(model), MPI.COMM_WORLD, split_above).parts[0], MPI.COMM_WORLD


def _answers(names: list[str], split_above: int) -> dict[str, list[np.ndarray]]:
    """Residual, action and energy of each beam, in a deformed and moving state."""
    from flexfem.lie import se3

    part, comm = _mixture(names, split_above)
    block, nodes = part.block, len(names) * 5
    rng = np.random.default_rng(5)
    draws = rng.normal(size=(4, len(MIXTURE), 5, 6))
    own = draws[:, [list(MIXTURE).index(n) for n in names]].reshape(4, nodes, 6)[:, block.node_ids]
    block.increment[:] = 0.1 * own[0]
    block.frames[:] = se3.retract(block.start_frames, block.increment)
    block.velocity[:], block.acceleration[:], block.step[:] = own[1:]
    shifts, results = np.array([12.0, 70.0, 1.0]), []
    matrices = part.elements.tangent(block, np.zeros(3), shifts, 1.0)
    cells = part.elements.data.cells
    products = np.einsum("mij,mj->mi", matrices, block.step[cells].reshape(-1, 12))
    for add in (
        lambda: part.elements.add_residual(block, np.zeros(3), 1.0),
        lambda: part.elements.add_action(block, np.zeros(3), shifts, 1.0),
        lambda: np.add.at(block.residual, cells, products.reshape(-1, 2, 6)),
    ):
        block.residual[:] = 0.0
        add()
        block.add_ghosts()
        out = np.zeros((nodes, 6))
        out[block.node_ids[: block.owned]] = block.owned_residual
        results.append(comm.allreduce(out).reshape(len(names), 5, 6))
    energies = np.bincount(
        part.elements.data.body, part.elements.energies(block.frames), minlength=len(names)
    )
    results.append(comm.allreduce(energies))
    return {name: [r[k] for r in results] for k, name in enumerate(names)}


@pytest.mark.parametrize("split_above", [1, 4000])
def test_each_beam_of_a_mixture_is_what_it_is_alone(split_above):
    together = _answers(["stiff", "linear", "soft", "linear_2"], split_above)
    for name in MIXTURE:
        alone = _answers([name], 4000)[name]
        for found, expected in zip(together[name], alone, strict=True):
            # cells in the wrong group or parameters of the wrong section differ by a tenth
            size = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, atol=1e-12 * size)


# --- shared code ---------------------------------------------------------------------------------


def test_laws_that_say_the_same_share_their_forms():
    def again(strain, p):
        return energy(strain, p)

    other = ff.BeamLaw(again, dissipation=dissipation, parameters={**VALUES, "EA": 1.0, "k0": 7.0})
    assert law_expressions(other) == law_expressions(LAW)
    # another object would be another compilation of the beam's kernels
    assert beam_forms(False, law_expressions(other)) is beam_forms(False, law_expressions(LAW))
    assert law_expressions(ff.BeamLaw(energy, parameters=VALUES)) != law_expressions(LAW)


SIGNATURES = """\
import test_beam_law as t
import flexfem as ff
from flexfem.forms.beam import beam_forms
from flexfem.forms.beam_law import law_expressions, law_form
# other forms, built before, use up UFL's numbers
beam_forms(False, law_expressions(ff.BeamLaw(lambda e, p: e[0]**2 * p.x, parameters={"x": 1.0})))
law = law_expressions(t.LAW)
forms = beam_forms(False, law)
for form in (forms.residual, forms.stiffness, forms.inertia, forms.action, law_form(law).form):
    print(form.signature())
"""


@pytest.mark.slow
@pytest.mark.serial
def test_second_process_finds_the_compiled_code():
    """FFCx files its code by these signatures."""
    law = law_expressions(LAW)
    forms = beam_forms(False, law)
    own = [f.signature() for f in (forms.residual, forms.stiffness, forms.inertia, forms.action)]
    own.append(law_form(law).form.signature())
    paths = f"{ROOT}{os.pathsep}{Path(__file__).parent}"
    ended = subprocess.run(
        [sys.executable, "-c", SIGNATURES],
        capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": paths, "PYTHONHASHSEED": "2"},
    )  # fmt: skip
    # a counter or an address in a signature would differ, and compile for seconds in every run
    assert ended.stdout.split() == own


# --- bad laws ------------------------------------------------------------------------------------


def linear(strain, p):
    """Energy of a linear law with one stiffness for everything."""
    return 0.5 * p.k * ufl.dot(strain, strain)


def _law(function, **arguments):
    arguments.setdefault("parameters", {"k": 1.0})
    return lambda: ff.BeamLaw(function, **arguments)


def _foreign(strain, p):
    return linear(strain, p) + ufl.Constant(interval_mesh())


def _position(strain, p):
    return linear(strain, p) * ufl.SpatialCoordinate(interval_mesh())[0]


NAN = float("nan")
CONSTRUCTORS = [
    (_law("quadratic"), "BeamLaw: energy must be a function of strain .*, got 'quadratic'"),
    (_law(linear, dissipation=3.0), 'BeamLaw "linear": dissipation must be a function .*, got 3.0'),
    (
        _law(linear, parameters={"k": NAN}),
        'BeamLaw "linear": parameter "k" must be finite, got nan',
    ),
    (_law(linear, parameters={"k": "1"}), "parameter \"k\" must be a number, got '1'"),
    (_law(linear, parameters=[1.0]), r"parameters must map names to numbers, got \[1.0\]"),
    (_law(linear, parameters={"my k": 1.0}), "plain Python identifier, got 'my k'"),
    (_law(linear, parameters={"lambda": 1.0}), "plain Python identifier, got 'lambda'"),
    (_law(linear, allow_unstable=1), "allow_unstable must be a bool, got 1"),
    (lambda: _law(linear)().with_parameters(q=1.0), 'no parameter "q", known are k'),
    (
        lambda: ff.Section(np.eye(6), np.eye(6), law=_law(linear)()),
        'Section: give a stiffness or the BeamLaw "linear", not both',
    ),
    (lambda: ff.Section.general(law=linear, inertia=INERTIA), "Section: law must be a BeamLaw"),
    (lambda: ff.Section.general(law=_law(linear)()), "Section: inertia must hold 6 x 6 numbers"),
    (lambda: ff.Section.general(inertia=INERTIA), "Section: stiffness must hold 6 x 6 numbers"),
]


@pytest.mark.serial
@pytest.mark.parametrize(("create", "message"), CONSTRUCTORS)
def test_bad_arguments(create, message):
    with pytest.raises((TypeError, ValueError), match=message) as caught:
        create()
    assert "\n" not in str(caught.value)


def _scaled(**factors):
    """Quadratic energy with other factors on some strains."""

    def scaled(strain, p):
        return 0.5 * p.k * sum(factors.get(f"s{i}", 1.0) * strain[i] ** 2 for i in range(6))

    return scaled


BAD = {
    "shape": (_law(lambda e, p: p.k * e), "energy must return a UFL scalar, got"),
    "none": (_law(lambda e, p: None), "energy must return a UFL scalar, got None"),
    "text": (_law(lambda e, p: "e"), "energy must return a UFL scalar, got 'e'"),
    "constant": (_law(lambda e, p: p.k), "energy does not depend on the strain"),
    "number": (_law(lambda e, p: 3.0), "energy does not depend on the strain"),
    "missing": (_law(lambda e, p: p.EA * e[0] ** 2), 'energy uses the parameter "EA", given are k'),
    "raises": (_law(lambda e, p: 1 / 0), "energy fails with ZeroDivisionError: division by zero"),
    "numpy": (_law(lambda e, p: np.tanh(e[0])), "energy fails with TypeError: "),
    "index": (_law(lambda e, p: e[6] ** 2), "energy fails with "),
    "arguments": (_law(lambda e: e[0] ** 2), "energy fails with TypeError: .*positional argument"),
    "foreign": (_law(_foreign), "energy may depend on its arguments and numbers only, but has"),
    "position": (_law(_position), "energy may depend on its arguments and numbers only, but has"),
    "singular": (
        _law(lambda e, p: p.k * ufl.sqrt(ufl.dot(e, e))),
        "stress at zero strain must be finite, got nan",
    ),
    "infinite": (
        _law(lambda e, p: linear(e, p) + p.k / ufl.dot(e, e)),
        "energy at zero strain must be finite, got inf",
    ),
    "unstable": (
        _law(_scaled(s4=-2.0)),
        r"stiffness at zero strain .* positive definite, but entry \(5, 5\) is -2",
    ),
    "no twist": (
        _law(_scaled(s3=0.0)),
        r"stiffness at zero strain .* positive definite, but entry \(4, 4\) is 0",
    ),
    "coupled": (
        _law(lambda e, p: linear(e, p) + 2.0 * p.k * e[0] * e[3]),
        "stiffness at zero strain .* smallest eigenvalue .* is -1",
    ),
    "gains": (
        _law(linear, dissipation=lambda e, r, p: -p.k * ufl.dot(r, r)),
        r"viscosity at zero .* positive semidefinite, but entry \(1, 1\) is -2",
    ),
    "at rest": (
        _law(linear, dissipation=lambda e, r, p: p.k * (ufl.dot(r, r) + r[0])),
        r"the viscous stress at zero strain rate must be zero, got \[1.0, ",
    ),
    "dry": (
        _law(linear, dissipation=lambda e, r, p: p.k * ufl.sqrt(ufl.dot(r, r))),
        "viscous stress and viscosity at zero strain and rate must be finite, got",
    ),
    "no rate": (
        _law(linear, dissipation=lambda e, r, p: p.k * ufl.dot(e, e)),
        "dissipation does not depend on the strain rate",
    ),
    "missing viscosity": (
        _law(linear, dissipation=lambda e, r, p: p.eta * ufl.dot(r, r)),
        'dissipation uses the parameter "eta", given are k',
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_law_is_refused_in_one_line(one_beam, what):
    create, message = BAD[what]
    with pytest.raises(ValueError, match=f'^Beam "beam": BeamLaw ".*": {message}') as caught:
        one_beam(SHAPES["straight"], ff.Section.general(law=create(), inertia=INERTIA))
    assert "\n" not in str(caught.value)


def test_damping_of_a_beam_with_a_law_is_refused(one_beam):
    with pytest.raises(ValueError, match=r'Beam "beam": damping 0\.1 s .* BeamLaw "energy"'):
        one_beam(SHAPES["straight"], SECTION, damping=0.1)


def test_unstable_law_on_purpose():
    from mpi4py import MPI

    from flexfem.families.common.section_groups import LawMaterial, grouped

    create, _ = BAD["unstable"]
    law = ff.BeamLaw(create().energy, parameters={"k": 1.0}, allow_unstable=True)
    section = ff.Section.general(law=law, inertia=INERTIA)
    (expressions,) = grouped([section])
    material = LawMaterial(MPI.COMM_SELF, expressions, [section], ['Beam "beam"'])
    strain = np.arange(6.0)[np.newaxis]
    found, _ = material.response(strain, np.zeros(1, dtype=np.int64))
    np.testing.assert_allclose(found, strain * [1, 1, 1, 1, -2, 1], rtol=1e-15)


@pytest.mark.serial
def test_case_with_a_bad_law_exits_with_2(tmp_path, monkeypatch, capfd):
    from flexfem import cli

    (tmp_path / "bad.py").write_text(
        "import flexfem as ff\n"
        "def broken(strain, p):\n    return p.k * strain\n"
        "def build():\n"
        "    law = ff.BeamLaw(broken, parameters={'k': 1.0})\n"
        "    model = ff.Model('bad', mesh=ff.LineMesh([[0, 0, 0], [1, 0, 0]], [[0, 1]],\n"
        "                                             {'rod': [0]}))\n"
        "    model.add(ff.Beam('rod', ff.Section.general(law=law, inertia=(1,) * 6)))\n"
        "    return model\n"
        "CASE = ff.Case(name='bad', summary='', build=build, dt=0.1, t_end=1.0)\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    assert cli.command(["run", "bad.py", "--output", "a/b"]) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith('error: Beam "rod": BeamLaw "broken": energy must return a UFL')
    assert not (tmp_path / "a").exists()


# --- motion --------------------------------------------------------------------------------------

LENGTH, MASS, PULL, END = 0.8, 3.0, 60.0, 0.8


def _extension_by_runge_kutta(steps: int) -> float:
    """Extension under a sudden force: a third of the beam's mass moves with its end."""
    p, mass = VALUES, MASS + INERTIA[0] * LENGTH / 3.0

    def rates(y: np.ndarray) -> np.ndarray:
        g, r = y / LENGTH
        force = p["EA"] * (g + p["b"] * g**3) - PULL
        force += p["eta"] * (1.0 + g**2) * r / np.sqrt(1.0 + (r / p["r0"]) ** 2)
        return np.array([y[1], -force / mass])

    y, h = np.zeros(2), END / steps
    for _ in range(steps):
        a = rates(y)
        b = rates(y + h / 2 * a)
        c = rates(y + h / 2 * b)
        y = y + h / 6 * (a + 2 * b + 2 * c + rates(y + h * c))
    return float(y[0])


def _extension(dt: float) -> float:
    """The same by one element with a body at its end."""
    mesh = LineMesh([[0, 0, 0], [LENGTH, 0, 0]], [[0, 1]], {"rod": [0]})
    model = ff.Model("pulled", mesh=mesh)
    end = ff.Marker("rod", "end")
    section = ff.Section.general(law=LAW.with_parameters(c=0.0), inertia=INERTIA)
    model.add(
        ff.Beam("rod", section),
        ff.RigidBody("bob", MASS, (0.1, 0.1, 0.1), position=(LENGTH, 0.0, 0.0)),
        ff.Rigid("weld", end, ff.Marker("bob")),
        ff.Rigid("wall", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("pull", ff.Marker("bob"), (PULL, 0.0, 0.0)),
        ff.PositionProbe("end", end),
    )
    outcome = ff.simulate(model, ff.RunOptions(dt=dt, t_end=END, tolerance=1e-11))
    assert outcome.status == "ok"
    return float(outcome.history["end_x"][-1]) - LENGTH


@pytest.mark.serial
def test_damped_oscillation_of_a_bob_follows_its_scalar_equation():
    exact = _extension_by_runge_kutta(4000)
    coarse, fine = (_extension(END / n) - exact for n in (200, 400))
    # second order, so that extrapolation leaves nothing: a viscous stress at another strain or
    # rate, or another mass, would remain, and moves the bob by 1e-3
    assert abs(coarse) <= 1e-4
    assert abs(4.0 * fine - coarse) / 3.0 <= 1e-7
