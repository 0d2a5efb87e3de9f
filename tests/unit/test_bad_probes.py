# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in probes of energies, joints and beams are refused in one line."""

import re

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.serial

SECTION = ff.Section.rectangle(0.03, 0.03, ff.Material(2.1e11, 0.3, 7850.0))

CONSTRUCTORS = [
    (lambda: ff.EnergyProbe(""), "EnergyProbe: name must be a non-empty"),
    (lambda: ff.EnergyProbe("a,b"), 'EnergyProbe "a,b": column "a,b_kinetic" must not contain'),
    (lambda: ff.EnergyProbe("e", "rod"), 'EnergyProbe "e": bodies must be a list of names'),
    (lambda: ff.EnergyProbe("e", []), 'EnergyProbe "e": bodies must hold at least one name'),
    (lambda: ff.MomentumProbe("p", [3]), 'MomentumProbe "p": bodies must be a string, got 3'),
    (lambda: ff.ReactionProbe("r", None), 'ReactionProbe "r": joint must be a string, got None'),
    (
        lambda: ff.ReactionProbe("r", "pin", axes="c"),
        'ReactionProbe "r": axes must be "inertial", "a" or "b", got \'c\'',
    ),
    (lambda: ff.StrainProbe("s", 1, 0.5), 'StrainProbe "s": beam must be a string, got 1'),
    (
        lambda: ff.StrainProbe("s", "rod", 1.5),
        r'StrainProbe "s": fraction must lie in \[0, 1\], got 1.5',
    ),
    (
        lambda: ff.StrainProbe("s", "rod", "end"),
        "StrainProbe \"s\": fraction must be a number, got 'end'",
    ),
]

MODELS = [
    (
        ff.EnergyProbe("e", ["rod", "pin"]),
        'EnergyProbe "e": Model "bad" has no body "pin"',
    ),
    (ff.MomentumProbe("p", ["no"]), 'MomentumProbe "p": Model "bad" has no body "no"'),
    (ff.ReactionProbe("r", "rod"), 'ReactionProbe "r": Model "bad" has no joint "rod"'),
    (ff.StrainProbe("s", "pin", 0.5), 'StrainProbe "s": Model "bad" has no beam "pin"'),
    (
        ff.StrainProbe("s", "tee", 0.5),
        'StrainProbe "s": fraction 0.5: group "tee" branches or falls apart$',
    ),
    (ff.EnergyProbe("rod"), 'EnergyProbe "rod": the name is used already by a Beam'),
    (
        ff.Probe("x", [], ["energy_work"], lambda t: [0.0]),
        'Probe "x": column "energy_work" is used already by EnergyProbe "energy"',
    ),
]


def _expect(message, function) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        function()
    text = str(caught.value)
    assert re.match(message, text), text
    assert "\n" not in text


@pytest.mark.parametrize(("make", "message"), CONSTRUCTORS, ids=[m for _, m in CONSTRUCTORS])
def test_constructors(make, message):
    _expect(message, make)


@pytest.mark.parametrize(("probe", "message"), MODELS, ids=[m for _, m in MODELS])
def test_models(probe, message):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]])
    cells = np.array([[0, 1], [2, 3], [3, 4], [3, 5]])
    mesh = ff.LineMesh(points, cells, {"rod": np.array([0]), "tee": np.array([1, 2, 3])})

    def build() -> None:
        model = ff.Model("bad", mesh=mesh)
        model.add(ff.Beam("rod", SECTION), ff.Beam("tee", SECTION), ff.EnergyProbe())
        model.add(ff.Spherical("pin", ff.Ground(), ff.Marker("rod", "start")), probe)
        model.validate()

    _expect(message, build)
