# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces and moments along beams that vary from place to place, against closed forms."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
SECTION = ff.Section.circle(0.02, STEEL)
EI = 2.1e11 * np.pi * 0.02**4 / 64.0
LENGTH = 2.0
ELEMENTS = pytest.mark.parametrize("elements", ["se3", "nurbs"])


def _static(elements: str, *things: object, count: int = 20, steps: int = 1) -> dict[str, float]:
    """Last row of the history of a cantilever along x, empty on all ranks but the first."""
    if elements == "se3":
        line = {"rod": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}
        model = ff.Model("rod", mesh=ff.LineMesh.straight(line, count))
        beam = ff.Beam("rod", SECTION)
    else:
        model = ff.Model("rod")
        curve = ff.NurbsCurve.line((0, 0, 0), (LENGTH, 0, 0), degree=3, elements=count // 4)
        rotations = "relative_rotation_vectors" if elements == "vectors" else "quaternions"
        beam = ff.Beam("rod", SECTION, curve=curve, interpolation=rotations)
    model.add(
        beam,
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
        ff.ReactionProbe("held", "clamp"),
        *things,
    )
    options = ff.StaticOptions(load_steps=steps, split_above=2, quiet=True)
    outcome = ff.solve_static(model, options)
    assert outcome.status == "ok"
    return {name: float(values[-1]) for name, values in outcome.history.items()}


TRIANGLES = {
    "of length": {"force_per_length": lambda s: (0.0, 0.0, -6.0 * s / LENGTH)},
    "of fraction": {
        "force_per_length": lambda u: (0.0, 0.0, -6.0 * u),
        "coordinate": "fraction",
    },
    "table": {"force_per_length": ff.LineTable([0.0, LENGTH], [(0, 0, 0), (0, 0, -6.0)])},
}


@ELEMENTS
@pytest.mark.parametrize(
    "given",
    [
        pytest.param(name, marks=[pytest.mark.three_ranks] if name == "table" else [])
        for name in TRIANGLES
    ],
)
def test_triangular_load_on_a_cantilever(given: str, elements: str) -> None:
    last = _static(elements, ff.LineLoad("wind", "rod", **TRIANGLES[given]))
    if COMM.rank:
        return
    # the mean along the beam as a uniform load has 15/11 of this deflection; shear adds 2e-5 of it,
    # twenty two-node elements lose 2e-3
    tip = -11.0 * 6.0 * LENGTH**4 / (120.0 * EI)
    assert last["tip_z"] == pytest.approx(tip, rel=4e-3 if elements == "se3" else 1e-3)
    # the load is integrated exactly; linear theory is off by the square of 1e-3 rad
    assert last["held_fz"] == pytest.approx(6.0 * LENGTH / 2.0, rel=1e-9)
    assert last["held_my"] == pytest.approx(-6.0 * LENGTH**2 / 3.0, rel=1e-4)


@pytest.mark.serial
@ELEMENTS
def test_load_between_places_inside_elements(elements: str) -> None:
    """Half a sine wave and a block whose ends lie within elements."""
    block = ff.LineTable([0.33, 0.33, 1.21, 1.21], [(0, 0, 0), (0, 0, 5.0), (0, 0, 7.0), (0, 0, 0)])
    last = _static(elements, ff.LineLoad("block", "rod", block))
    width, lever = 0.88, 0.33 + 0.88 * (5.0 + 2.0 * 7.0) / (3.0 * (5.0 + 7.0))
    # exact; integrated by Gauss points of whole elements the ends of the block are blurred by 1e-2
    assert last["held_fz"] == pytest.approx(-6.0 * width, rel=1e-10)
    assert last["held_my"] == pytest.approx(6.0 * width * lever, rel=1e-4)
    wave = ff.LineLoad("wave", "rod", lambda s: (0.0, 0.0, 3.0 * np.sin(np.pi * s / LENGTH)))
    last = _static(elements, wave)
    # 2/pi of a uniform load; three Gauss points in each of five elements are good to 1e-7
    assert last["held_fz"] == pytest.approx(-3.0 * 2.0 * LENGTH / np.pi, rel=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("elements", ["se3", "nurbs", "vectors"])
@pytest.mark.parametrize("follower", [False, True])
def test_moment_that_varies_along_a_cantilever_twists_and_bends_it(
    elements: str, follower: bool
) -> None:
    """Moments along the axis that fall to the end, and a small one across it."""
    GJ, EI_y = 2.0 * EI / 2.6, EI
    twist, bend = 1.5 * GJ / LENGTH**2, 1e-4 * EI_y / LENGTH**2
    last = _static(
        elements,
        ff.LineLoad(
            "twist", "rod", moment_per_length=lambda s: (twist * (1.0 - s / LENGTH), 0.0, 0.0),
            follower=follower,
        ),
        ff.LineLoad("bend", "rod", moment_per_length=(0.0, bend, 0.0)),
        ff.Probe("end", ff.Marker("rod", "end"), ("turn",), _turn),
        count=8,
    )  # fmt: skip
    # the torque is m L / 2 (1 - s/L)^2: a turn of m L^2 / (6 GJ); 8 elements and a load that is
    # exact by Gauss points leave 1e-5 in the turn, a uniform load of the same sum gives 1.5 times
    assert last["turn"] == pytest.approx(twist * LENGTH**2 / (6.0 * GJ), rel=1e-4)
    # a constant moment along the beam gives m L^3 / (3 EI); coarse two-node elements miss 1 %
    assert last["tip_z"] == pytest.approx(-bend * LENGTH**3 / (3.0 * EI_y), rel=2e-2)
    assert last["held_mx"] == pytest.approx(-twist * LENGTH / 2.0, rel=1e-6)


def _turn(t: float, end: ff.MarkerState) -> tuple[float]:
    return (float(np.arctan2(end.rotation[2, 1], end.rotation[1, 1])),)


@pytest.mark.parametrize("elements", ["se3", "nurbs", "vectors"])
@pytest.mark.parametrize("follower", [False, pytest.param(True, marks=pytest.mark.three_ranks)])
def test_moment_along_a_cantilever_bends_it_far(elements: str, follower: bool) -> None:
    """The curvature is ``m (L - x) / EI`` however far it bends, and in the plane dead or not."""
    moment = -2.0 * 2.0 * EI / LENGTH**2  # 2 rad at the end
    last = _static(
        elements,
        ff.LineLoad("twist", "rod", moment_per_length=(0.0, moment, 0.0), follower=follower),
        count=20 if elements == "se3" else 80,
        steps=4,
    )
    if COMM.rank:
        return
    x, w = np.polynomial.legendre.leggauss(30)
    s, w = 0.5 * LENGTH * (1.0 + x), 0.5 * LENGTH * w
    angle = -moment / EI * (LENGTH * s - 0.5 * s**2)
    # 20 elements are off by 1e-3, and 20 smooth cubics lock a little; half a moment that is lost at
    # one end of 20 changes it by 5 %
    assert last["tip_x"] == pytest.approx(w @ np.cos(angle), abs=3e-3)
    assert last["tip_z"] == pytest.approx(w @ np.sin(angle), abs=3e-3)
    assert last["held_my"] == pytest.approx(-moment * LENGTH, rel=1e-6)
    assert abs(last["held_fx"]) < 1e-6 * abs(moment)


@pytest.mark.serial
def test_functions_that_fail_are_named() -> None:
    cases = [
        (lambda s: (0.0, 1.0), {}, r'LineLoad "w": force_per_length\(0\) must hold 3 numbers'),
        (lambda s: (0.0, 0.0, np.nan), {}, r"force_per_length\(0\) must be finite"),
        (
            ff.LineTable([0.0, 3.0], np.ones((2, 3))), {},
            r'LineLoad "w": .3.0. is not on Beam "rod", which is 2 m long',
        ),
        (
            ff.LineTable([0.0, 1.5], np.ones((2, 3))), {"coordinate": "fraction"},
            r'.1.5. is not on Beam "rod", whose fractions are 0 to 1',
        ),
    ]  # fmt: skip
    for force, more, words in cases:
        with pytest.raises(ValueError, match=words):
            _static("se3", ff.LineLoad("w", "rod", force, **more))
    with pytest.raises(ValueError, match='coordinate must be "length" or "fraction", got \'arc\''):
        ff.LineLoad("w", "rod", coordinate="arc")
    with pytest.raises(ValueError, match="places must be at least two that ascend"):
        ff.LineTable([1.0, 0.5], np.zeros((2, 3)))
