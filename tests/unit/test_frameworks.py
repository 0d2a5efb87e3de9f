# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions as functions of JAX and PyTorch, which are optional."""

import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page
from tests.unit.test_fits import OPTIONS, oscillator

AT = {"damping": 12.0, "stiffness": 400.0}
WEIGHTS = np.random.default_rng(0).standard_normal(61)


@pytest.fixture(scope="module")
def jax():
    found = pytest.importorskip("jax")
    found.config.update("jax_enable_x64", True)
    return found


@pytest.fixture(scope="module")
def torch():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, at the import
        return pytest.importorskip("torch")


def weighted(x):
    """The sum of a column with weights: its value and derivatives by another way."""
    history = ff.tangent_motion(oscillator, AT, {"stiffness": 1.0}, OPTIONS).derivative
    return WEIGHTS @ history[x] if history else None


def test_reverse_mode_of_jax(jax):
    """Numbers and whole columns, compiled and mapped."""
    motion = ff.jax_function(oscillator, ["final:x", "rms:v"], OPTIONS)

    def cost(values):
        found = motion(values)
        return found["final:x"] ** 2 + found["rms:v"]

    own = ff.gradient(oscillator, ["final:x", "rms:v"], AT, OPTIONS)
    expected = {
        name: 2.0 * own.value["final:x"] * own.gradient["final:x"][name] + slope
        for name, slope in own.gradient["rms:v"].items()
    }
    for found in (jax.grad(cost)(AT), jax.jit(jax.grad(cost))(AT)):
        # one adjoint of the sum of both, or the sum of two adjoints
        assert {n: float(x) for n, x in found.items()} == pytest.approx(expected, rel=1e-7)
    mapped = jax.vmap(lambda k: jax.grad(cost)({"damping": 12.0, "stiffness": k})["damping"])(
        np.array([380.0, 400.0])
    )
    assert float(mapped[1]) == pytest.approx(expected["damping"], rel=1e-9)
    column = ff.jax_function(oscillator, "x", OPTIONS)
    assert column(AT).shape == (61,)
    by = jax.vjp(column, AT)[1](jax.numpy.asarray(WEIGHTS))[0]["stiffness"]
    tangent = weighted("x")
    assert tangent is None or float(by) == pytest.approx(tangent, rel=1e-7)


def test_forward_mode_of_jax(jax):
    """The same weighted sum as backwards."""
    motion = ff.jax_function(oscillator, ["x", "final:x"], OPTIONS, mode="forward")
    slopes = jax.jit(jax.jacfwd(motion))(AT)
    tangent = weighted("x")
    if tangent is not None:
        assert WEIGHTS @ slopes["x"]["stiffness"] == pytest.approx(tangent, rel=1e-8)
    # both numbers change along one direction: that of each less than its share is a half and more
    change = jax.jvp(motion, (AT,), ({"damping": 3.0, "stiffness": -20.0},))[1]["final:x"]
    both = 3.0 * slopes["final:x"]["damping"] - 20.0 * slopes["final:x"]["stiffness"]
    assert float(change) == pytest.approx(float(both), rel=1e-8)
    still = jax.jvp(motion, (AT,), ({"damping": 0.0, "stiffness": 0.0},))[1]
    assert not np.any(still["x"])


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:FutureWarning")
def test_pytorch(torch):
    """Backwards and forwards; constants have no derivatives, and there are no second ones."""
    motion = ff.torch_function(oscillator, ["x", "final:x"], OPTIONS)
    stiffness = torch.tensor(400.0, dtype=torch.float64, requires_grad=True)
    found = motion({"damping": 12.0, "stiffness": stiffness})
    (found["x"] @ torch.from_numpy(WEIGHTS)).backward()
    tangent = weighted("x")
    assert tangent is None or float(stiffness.grad) == pytest.approx(tangent, rel=1e-7)
    forward = torch.autograd.forward_ad
    with forward.dual_level():
        dual = forward.make_dual(stiffness.detach(), torch.ones((), dtype=torch.float64))
        moved = motion({"damping": 12.0, "stiffness": dual})
        slope = forward.unpack_dual(moved["x"]).tangent.numpy() @ WEIGHTS
    assert tangent is None or slope == pytest.approx(tangent, rel=1e-8)
    number = motion({"damping": 12.0, "stiffness": stiffness})["final:x"]
    (once,) = torch.autograd.grad(number, stiffness, create_graph=True)
    with pytest.raises(RuntimeError, match="does not require grad"):
        torch.autograd.grad(once, stiffness)
    with pytest.raises(TypeError) as raised:
        motion({"damping": torch.tensor(12.0), "stiffness": 400.0})
    assert str(raised.value) == "torch_function: damping must be of float64, got torch.float32"
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_states_and_paths(jax):
    """A frequency by a path into a model: as the root of the stiffness."""
    song = ff.jax_function(oscillator(0.0), "frequency:1", ff.ModeOptions(modes=1))
    at = {"buffer.stiffness": 400.0}
    # derivatives of modes have six digits
    assert float(jax.grad(song)(at)["buffer.stiffness"]) * 800.0 == pytest.approx(
        float(song(at)), rel=1e-5
    )
    forward = ff.jax_function(oscillator(0.0), ["frequency:1"], ff.ModeOptions(modes=1),
                              mode="forward")  # fmt: skip
    change = jax.jvp(forward, (at,), (at,))[1]["frequency:1"]
    assert 2.0 * float(change) == pytest.approx(float(song(at)), rel=1e-5)


@pytest.mark.serial
def test_wrong_use_of_jax(jax):
    with pytest.raises(ValueError, match=r"^jax_function: mode must be") as raised:
        ff.jax_function(oscillator, "x", OPTIONS, mode="backward")
    assert_on_page(str(raised.value))
    with pytest.raises(TypeError, match="got 3"):
        ff.jax_function(3, "x", OPTIONS)
    motion = ff.jax_function(oscillator, "final:x", OPTIONS)
    with pytest.raises(Exception, match='SpringDamper "buffer": damping must not be negative'):
        motion({"damping": -1.0, "stiffness": 400.0})
    with pytest.raises(Exception, match="no column"):
        ff.jax_function(oscillator, "y", OPTIONS)(AT)
    with pytest.raises(ValueError, match="do not support JVP"):
        jax.hessian(motion)(AT)
    with pytest.raises(ValueError, match=r'^gradient: column "x" has as many rows as') as raised:
        ff.jax_function(oscillator, ["final:x", "x"], replace(OPTIONS, adaptive=True))
    assert_on_page(str(raised.value))
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(ValueError, match=r"^jax_function: JAX must have double") as raised:
            motion(AT)
        assert_on_page(str(raised.value))
    finally:
        jax.config.update("jax_enable_x64", True)


@pytest.mark.serial
@pytest.mark.parametrize("name", ["jax", "torch"])
def test_missing_packages(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError) as raised:
        getattr(ff, f"{name}_function")(oscillator, "x", OPTIONS)
    assert str(raised.value).startswith(f"{name} is not installed, but required: pip install")
    assert_on_page(str(raised.value))


# --- a double pendulum, whose motion JAX computes by itself --------------------------------------

PENDULUM = {"first": 1.2, "second": 0.7, "long": 0.5, "short": 0.4, "torque": 0.8}
INERTIA, GRAVITY, END = 0.01, 9.81, 0.3


def pendulum(first, second, long, short, torque):
    """Two rods without mass that carry a body each; a torque about the first hinge."""
    model, y = ff.Model("pendulum"), (0.0, 1.0, 0.0)
    upper, lower = (ff.Marker(name) for name in ("upper", "lower"))
    model.add(
        ff.Gravity((0.0, 0.0, -GRAVITY)),
        ff.RigidBody("upper", first, (INERTIA,) * 3, position=(long, 0.0, 0.0)),
        ff.RigidBody("lower", second, (INERTIA,) * 3, position=(long + short, 0.0, 0.0)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("upper", offset=(-long, 0.0, 0.0)), axis=y),
        ff.Revolute("elbow", upper, ff.Marker("lower", offset=(-short, 0.0, 0.0)), axis=y),
        ff.PointMoment("drive", upper, (0.0, torque, 0.0)),
        ff.PositionProbe("tip", lower),
    )
    return model


def tip_of_jax(jax, values):
    """Height of the lower body at the end by 3000 steps of Runge and Kutta."""
    sin, cos, array = jax.numpy.sin, jax.numpy.cos, jax.numpy.array
    long, short, low = values["long"], values["short"], values["second"]
    both = values["first"] + low

    def rate(state):  # angles of the rods below the horizontal, and their rates
        (a, b), (u, v) = state
        mixed = low * long * short * cos(a - b)
        spin = low * long * short * sin(a - b)
        above = both * GRAVITY * long * cos(a) + values["torque"] - spin * v**2
        below = low * GRAVITY * short * cos(b) + spin * u**2
        first, second = both * long**2 + INERTIA, low * short**2 + INERTIA
        size = first * second - mixed**2
        faster = [second * above - mixed * below, first * below - mixed * above]
        return array([[u, v], [one / size for one in faster]])

    def step(state, _):
        h = END / 3000
        a = rate(state)
        b = rate(state + 0.5 * h * a)
        c = rate(state + 0.5 * h * b)
        d = rate(state + h * c)
        return state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d), None

    (a, b), _ = jax.lax.scan(step, jax.numpy.zeros((2, 2)), length=3000)[0]
    return -long * sin(a) - short * sin(b)


@pytest.mark.serial
def test_derivatives_of_a_double_pendulum(jax):
    """They converge with the square of the step to those of equations made by other means."""
    exact = jax.jit(jax.grad(lambda values: tip_of_jax(jax, values)))(PENDULUM)
    found = []
    for steps in (60, 120):
        options = ff.RunOptions(dt=END / steps, t_end=END, rho_inf=1.0, tolerance=1e-12)
        by = ff.gradient(pendulum, "final:tip_z", PENDULUM, options, accuracy=1e-12).gradient
        found.append(np.array([by["final:tip_z"][name] for name in PENDULUM]))
    exact = np.array([float(exact[name]) for name in PENDULUM])
    coarse, fine = (one - exact for one in found)
    # steps of second order; an error of the scheme's derivatives does not get smaller
    assert np.abs(coarse / fine) == pytest.approx(4.0, abs=0.1)
    assert np.abs((4.0 * fine - coarse) / 3.0).max() < 2e-6 * np.abs(exact).max()
