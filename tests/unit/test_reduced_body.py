# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced data: what they tell of a body, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexfem.reduction.reduced_body import Interface, Recovery, ReducedBody
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

PLACES = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5]])


def two_masses(**change: Any) -> ReducedBody:
    """Two rigid dice of 3 kg and 5 kg that a soft spring of six stiffnesses joins."""
    masses, inertia = np.array([3.0, 5.0]), 0.1
    moments, products = np.zeros((3, 13)), np.zeros((3, 3, 13, 13))
    for i, (mass, place) in enumerate(zip(masses, PLACES, strict=True)):
        # eight points each, which have the inertia of a die
        for corner in np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
            arm = corner * np.sqrt(inertia / mass / 2.0)
            field = np.zeros((3, 13))
            field[:, 0] = place + arm
            x, y, z = arm
            field[:, 1 + 6 * i : 4 + 6 * i] = np.eye(3)
            field[:, 4 + 6 * i : 7 + 6 * i] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
            moments += mass / 8.0 * field
            products += mass / 8.0 * np.einsum("ai,bj->abij", field, field)
    # the stretch of the spring: what the second frame does relative to the first
    x, y, z = PLACES[1]
    relative = np.zeros((6, 12))
    relative[:, 6:] = np.eye(6)
    relative[:, :6] = -np.eye(6)
    relative[:3, 3:6] = -np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    data: dict[str, Any] = {
        "interfaces": tuple(Interface(n, p) for n, p in zip("ab", PLACES, strict=True)),
        "mass": 8.0,
        "moments": moments,
        "products": products,
        "stiffness": relative.T @ np.diag([1e3, 2e3, 3e3, 10.0, 20.0, 30.0]) @ relative,
        "damping": np.zeros((12, 12)),
        "held": np.zeros(12, dtype=np.bool_),
        "frequencies": np.zeros(0),
    }
    return ReducedBody(**(data | change))


def test_mass_properties_of_two_masses() -> None:
    body = two_masses()
    assert (body.size, body.modes, body.interface("b")) == (12, 0, 1)
    # the figures have a dozen digits; a wrong order of the columns gives others altogether
    np.testing.assert_allclose(body.mass_centre, 5.0 / 8.0 * PLACES[1], rtol=1e-14)
    x, y, z = PLACES[1]
    steiner = 5.0 * ((x * x + y * y + z * z) * np.eye(3) - np.outer(PLACES[1], PLACES[1]))
    np.testing.assert_allclose(body.inertia, 0.2 * np.eye(3) + steiner, atol=1e-13)
    # rigid motions as coordinates have the rigid body's mass matrix
    rigid = body.rigid_motions
    np.testing.assert_allclose((rigid.T @ body.mass_matrix @ rigid)[3:, 3:], body.inertia)
    np.testing.assert_allclose(body.stiffness @ rigid, 0.0, atol=1e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass must be positive, got 0.0"),
        ({"moments": np.zeros((3, 12))}, "moments must hold 3 x 13 numbers"),
        ({"stiffness": np.diag(np.full(12, 1e3))}, "stiffness must be free of rigid motions"),
        ({"stiffness": -np.eye(12)}, "stiffness must be"),
        ({"damping": np.eye(12) - 2.0 * (np.eye(12, k=1) + np.eye(12, k=-1))}, "smallest eigenv"),
        ({"damping": np.triu(np.ones((12, 12)))}, "damping must be symmetric"),
        ({"held": np.zeros(6, dtype=np.bool_)}, "held must hold 12 truth values"),
        ({"held": np.arange(12) == 2}, "must be zero for held coordinates"),
        ({"frequencies": np.full(1, np.nan)}, "frequencies must be finite"),
        ({"interfaces": (Interface("a", PLACES[0]),) * 2}, "names of interfaces must differ"),
        ({"acceleration_stiffness": np.zeros((3, 12, 12))}, "acceleration_stiffness must hold 12"),
        ({"mass": 7.0}, "moments must be the mass times a uniform displacement"),
    ],
)
def test_wrong_data_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        two_masses(**change)
    assert_on_page(str(raised.value))


def test_a_body_is_shown_in_one_line() -> None:
    # with its arrays 30,000 characters, which hide every message that shows a body
    assert repr(two_masses()) == "ReducedBody(8 kg; interfaces: a, b; modes: 0)"


def test_unknown_interfaces_are_refused() -> None:
    with pytest.raises(ValueError, match="no interface 'c'; there are a, b"):
        two_masses().interface("c")
    with pytest.raises(TypeError, match="interface must be a Interface"):
        two_masses(interfaces=("a", "b"))


def test_surfaces_are_checked() -> None:
    points, cells = np.eye(3), np.array([[0, 1, 2]])
    moves = np.zeros((3, 3, 12))
    good = Recovery(points, cells, moves, np.zeros((1, 6, 12)))
    assert two_masses(recovery=good).recovery is good
    with pytest.raises(ValueError, match="recovery must have 12 functions, got 5"):
        two_masses(recovery=Recovery(points, cells, moves[..., :5]))
    with pytest.raises(ValueError, match="cells must lie in 0 to 2, got 3"):
        replace(good, cells=cells + 1)
    with pytest.raises(ValueError, match="cells must be triangles or lines"):
        replace(good, cells=np.array([[0, 1, 2, 2]]))
    with pytest.raises(ValueError, match="stress must hold 1 x 6 x 12"):
        replace(good, stress=np.zeros((3, 6, 12)))
