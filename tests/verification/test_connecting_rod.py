# SPDX-License-Identifier: LGPL-3.0-or-later
"""The connecting rod of tetrahedra against beams, in two floating frames."""

import numpy as np
import pytest

from flexfem.cli import load_case
from tests.verification.benchmarks import solid_connecting_rod
from tests.verification.motions import run

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def histories(tmp_path_factory):
    """Histories of a short run that bends the rod by a thousandth of its length."""
    case = load_case("connecting_rod")
    file = tmp_path_factory.mktemp("rod") / "rod.h5"
    given = {"size": 0.02, "internal_modes": 6, "elements": 16, "moment": 300.0}
    kinds = {"beam": {"rod": "beam"}, "pin": {}, "mean": {"frame": "mean_axes"}}
    kinds["nonlinear"] = {"rod": "nonlinear", "reduced": ""}
    found = {}
    for name, kind in kinds.items():
        values = case.values(given | {"reduced": str(file)} | kind)
        model = case.build(**{option.name: values[option.name] for option in case.options})
        found[name] = run(model, 2e-4, 0.05, tolerance=1e-8)
    return found


@pytest.mark.slow
def test_solid_rod_bends_as_the_beam_does(histories):
    beam, solid = histories["beam"], histories["pin"]
    size = np.abs(beam["rod_deflection"]).max()
    assert size > 1e-4
    # vibrations drift apart by 11 %, as meshes and steps are coarse; eyes of half the mass make it
    # 87 %
    assert np.abs(solid["rod_deflection"] - beam["rod_deflection"]).max() < 0.15 * size
    # with eyes of half the mass the crank gets 13 % further
    assert solid["crank_angle"][-1] == pytest.approx(beam["crank_angle"][-1], rel=2e-3)


@pytest.mark.slow
def test_frames_agree(histories):
    """Small displacements are the same in all of them, up to squares."""
    pin, mean = histories["pin"], histories["mean"]
    size = np.abs(pin["rod_deflection"]).max()
    # they are 1.3e-3 apart; without geometric stiffening, which each frame lacks in its own way,
    # 3.5e-2, and the angles 4e-5
    assert np.abs(pin["rod_deflection"] - mean["rod_deflection"]).max() < 5e-3 * size
    assert pin["crank_angle"] == pytest.approx(mean["crank_angle"], rel=0, abs=2e-5)


@pytest.mark.slow
@pytest.mark.benchmark
def test_all_nodes_bend_as_the_reduction_does():
    """Lines of the table, a minute."""
    for result in solid_connecting_rod.results():
        assert result.error <= result.tolerance, result


@pytest.mark.slow
def test_nonlinear_rod_stiffens_as_the_linear_one(histories):
    """Geometric stiffening of the linear rod is the leading part of the nonlinear forces."""
    linear, nonlinear = (histories[name]["rod_deflection"] for name in ("pin", "nonlinear"))
    size = np.abs(linear).max()
    # they are 5.6e-3 apart; a linear rod without geometric stiffening would be 3.5e-2 off
    assert np.abs(linear - nonlinear).max() < 1e-2 * size
