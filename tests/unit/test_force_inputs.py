# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in forces by laws of users: one line that names the force and the value."""

from typing import Any

import numpy as np
import pytest

import flexfem as ff

BODY = ff.Marker("mass")


def no_force(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    return np.zeros_like(ends.positions)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"markers": []}, r'^Force "f": markers must hold at least one marker, got none$'),
        ({"markers": ["mass"]}, r'^Force "f": markers\[0\] must be a Marker'),
        ({"markers": 13 * [BODY]}, r'^Force "f": markers must be at most 12 that all depend'),
        ({"markers": 3 * [BODY], "each": 2}, r"each must be a number .* the 3 markers, got 2$"),
        ({"law": lambda t, ends: 0.0}, r"law must be a function of \(t, ends, z\) .* 2 arguments$"),
        ({"law": 3.0}, r'^Force "f": law must be a function of t, ends, z, got 3.0$'),
        ({"states": 2, "initial": [1.0]}, r"initial must have the shape \(2,\) or \(1, 2\), got"),
        ({"initial": ["p"]}, r"initial must be finite numbers in one or two dimensions"),
        ({"states": -1}, r"states must"),
        ({"every": "sometimes"}, r'every must be .*"?sometimes'),
    ],
)  # fmt: skip
def test_arguments(given: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        ff.Force(**({"name": "f", "markers": [BODY], "law": no_force} | given))


def model(law: Any, **given: Any) -> ff.Model:
    made = ff.Model("m")
    made.add(ff.RigidBody("mass", 1.0, (1.0, 1.0, 1.0)))
    made.add(ff.Force("f", [BODY], law, **given), ff.PositionProbe("at", BODY))
    return made


def fails(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    raise KeyError("lift")


@pytest.mark.serial
@pytest.mark.parametrize(
    ("law", "given", "message"),
    [
        (lambda t, ends, z: np.zeros(3), {}, r"forces of the shape \(1, 3\), got \(3,\)"),
        (lambda t, ends, z: None, {}, r"law must return numbers, got None for forces"),
        (lambda t, ends, z: np.full((1, 3), np.nan), {}, r"must return finite numbers at the"),
        (no_force, {"states": 1}, r"forces, moments and rates of states, got 1 values"),
        (fails, {}, r"fails \(test_force_inputs.py, line \d+\): KeyError: 'lift'"),
        (no_force, {"jacobian": lambda t, ends, z: np.zeros(6)}, r"shape \(1, 6, 12\), got \(6,\)"),
        (lambda t, ends, z: ends.nothing, {"compiled": True}, r"cannot be compiled: .*nothing"),
    ],
)
def test_laws_at_the_start(law: Any, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=rf'^Force "f": .*{message}'):
        ff.simulate(model(law, **given), ff.RunOptions(dt=0.1, t_end=0.1, quiet=True))


@pytest.mark.serial
@pytest.mark.parametrize("wrong", [np.nan, "error"])
def test_laws_during_a_run(wrong: Any) -> None:
    """The run ends with what there is until then, and the law is named."""

    def law(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
        if t > 0.35:
            if wrong == "error":
                raise ValueError("no more wind")
            return np.full((1, 3), np.nan)
        return np.zeros((1, 3))

    reason = r"no more wind" if wrong == "error" else r"returned forces with \[nan, nan, nan\] at"
    options = ff.RunOptions(dt=0.1, t_end=1.0, quiet=True)
    with pytest.raises(ff.FunctionError, match=rf'^Force "f": .*{reason}') as found:
        ff.simulate(model(law), options)
    assert found.value.outcome.history["t"][-1] == pytest.approx(0.3)


@pytest.mark.serial
def test_states_without_steady_values() -> None:
    """An equilibrium of a force whose states drift is none."""

    def law(t: float, ends: ff.Ends, z: np.ndarray) -> Any:
        return np.zeros((1, 3)), None, np.ones(1)

    made = model(law, states=1)
    options = ff.ModeOptions(modes=1, quiet=True)
    with pytest.raises(ValueError, match=r'^Force "f": has no steady states at rest'):
        ff.find_modes(made, options)


@pytest.mark.serial
def test_the_energy_momentum_method_refuses_them() -> None:
    options = ff.RunOptions(dt=0.1, t_end=0.1, integrator="energy_momentum", quiet=True)
    with pytest.raises(ValueError, match=r'^Force "f": the integrator energy_momentum'):
        ff.simulate(model(no_force), options)
