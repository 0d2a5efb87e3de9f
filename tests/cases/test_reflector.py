# SPDX-License-Identifier: LGPL-3.0-or-later
"""The nets of the mesh reflector: equilibrium in the design, slack when folded, refusals."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.case import load_case

pytestmark = pytest.mark.serial


def built(**given: object) -> ff.Model:
    case = load_case("mesh_reflector")
    return case.model(**case.prepare(given)[0])


def test_design_is_in_equilibrium() -> None:
    """Tensions by the lengths of all cables, in the places of the design, cancel at all nodes."""
    names = load_case("mesh_reflector").build.__globals__
    ring = names["Ring"](12, 3.0, 1.5)
    nets = names["Nets"](ring, 6, 0.4, 0.6, 20.0, 80.0, 1e4, 1e5)
    front, rear, *_ = nets.design
    pairs, stiffness, rest = nets.members
    places = np.concatenate([front, rear])
    along = places[pairs[:, 1]] - places[pairs[:, 0]]
    lengths = np.linalg.norm(along, axis=1)
    tension = stiffness * (lengths / rest - 1.0)
    assert tension.min() > 0.1
    pull = (tension / lengths)[:, np.newaxis] * along
    sums = np.zeros_like(places)
    np.add.at(sums, pairs[:, 0], pull)
    np.subtract.at(sums, pairs[:, 1], pull)
    held = np.concatenate([nets.corners, nets.corners + len(front)])
    np.testing.assert_allclose(places[held][:12, :2], ring.feet(0.5 * np.pi)[:, :2], atol=1e-12)
    free = np.setdiff1d(np.arange(len(places)), held)
    # a tie that pulls the wrong way, or a ring without its share, leaves newtons
    assert np.abs(sums[free]).max() < 1e-9
    # nodes inside the ties are on the paraboloid
    tied = nets.design[2]
    heights = 1.5 - 0.4 * (1.0 - (front[tied, :2] ** 2).sum(axis=1) / 9.0)
    np.testing.assert_allclose(front[tied, 2], heights, atol=1e-12)


@pytest.mark.parametrize("given", [{}, {"bays": 6, "rings": 3}, {"bays": 18, "rings": 6}])
def test_folded_cables_are_slack(given: dict[str, int]) -> None:
    """All of them, though neighbouring battens are a longeron's length apart as in the design."""
    model = built(**given)
    net = model["nets"]
    assert (net.lengths / net.unstretched).max() < 1.0
    rings = given.get("rings", 4)
    assert len(net.points) == 2 * (1 + 3 * rings * (rings + 1))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"bays": 8}, "bays must be a multiple of 6, got 8"),
        ({"rings": 3}, "rings must be a multiple of bays / 6, got 3"),
        ({"bays": 12, "rings": 2}, "rings must be 4 at least with 12 bays, got 2"),
        ({"depth": 0.75}, "depth must be less than half of the height, 0.75 m, got 0.75"),
        ({"tied": 1.0}, "ties near the edge would have to press with tied 1"),
        ({"start_angle": 90.0}, "start_angle must be less than latch_angle, got 90"),
        ({"wall": 20.0}, "wall must be less than half of diameter, got 20"),
        (
            {"edge_stiffness": 1e3},
            "the folded nets do not fit .* with edge_force 80",
        ),
    ],
)
def test_refusals(given: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        built(**given)
