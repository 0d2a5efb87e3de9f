# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves of STEP and IGES files: those that OpenCASCADE writes, and files written by hand."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

U = np.linspace(0.0, 1.0, 41)
T = np.linspace(0.0, 2.0, 6)
#: with so few digits that OpenCASCADE writes all of them
POINTS = np.round(np.column_stack([np.sin(T), 1.0 - np.cos(T), 0.3 * T**2]), 3)
KNOTS = np.array([0, 0, 0, 0, 0.3, 0.7, 1, 1, 1, 1])
WEIGHTS = np.array([1.0, 1.4, 0.8, 1.0, 1.3, 1.0])


def _by_occ(path: Path, points: np.ndarray, degree: int, weights: np.ndarray, knots: np.ndarray):
    """A file of one curve as OpenCASCADE writes it, in millimetres."""
    gmsh = pytest.importorskip("gmsh")
    breaks, times = np.unique(knots, return_counts=True)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        tags = [gmsh.model.occ.addPoint(*(1e3 * point)) for point in points]
        gmsh.model.occ.addBSpline(
            tags, degree=degree, weights=weights, knots=breaks, multiplicities=times
        )
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("end", ["step", "igs"])
@pytest.mark.parametrize("weights", [np.ones(6), WEIGHTS], ids=["polynomial", "rational"])
def test_curves_that_opencascade_writes(tmp_path: Path, end: str, weights: np.ndarray) -> None:
    path = tmp_path / f"curve.{end}"
    _by_occ(path, POINTS, 3, weights, KNOTS)
    (curve,) = ff.read_curves(path).values()
    # round-off; millimetres taken for metres, or lost weights, are off by 0.2
    np.testing.assert_allclose(curve.points, POINTS, rtol=0, atol=1e-12)
    np.testing.assert_allclose(curve.weights / curve.weights[0], weights, rtol=1e-12)
    np.testing.assert_allclose(curve.knots, KNOTS, atol=1e-12)
    assert curve.degree == 3
    (larger,) = ff.read_curves(path, scale=1.0).values()
    np.testing.assert_allclose(larger.points, 1e3 * POINTS, atol=1e-9)


STEP = """ISO-10303-21;
HEADER; FILE_NAME('it; isn''t #1=',''); ENDSEC; DATA; /* a comment; #2= */
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));
{points}
#30=B_SPLINE_CURVE_WITH_KNOTS('rail',2,(#10,#11,#12,#13,#14),.UNSPECIFIED.,.F.,.F.,
 (1,1,1,1,1,1,1,1),(0.,1.,2.,3.,4.,5.,6.,7.),.UNSPECIFIED.);
#40=CARTESIAN_POINT('',(0.,1.)); #41=CARTESIAN_POINT('',(1.,1.));
#42=B_SPLINE_CURVE_WITH_KNOTS('',1,(#40,#41),.UNSPECIFIED.,.F.,.F.,(2,2),(0.,1.),.UNSPECIFIED.);
ENDSEC; END-ISO-10303-21;
""".format(
    points="".join(
        f"#{10 + i}=CARTESIAN_POINT('',({x!r},{y!r},{z!r}));\n"
        for i, (x, y, z) in enumerate(POINTS[:5].tolist())
    )
)


def test_knots_that_are_not_clamped_keep_the_curve(tmp_path: Path) -> None:
    path = tmp_path / "rail.stp"
    path.write_text(STEP)
    (curve,) = ff.read_curves(path).values()
    assert list(ff.read_curves(path)) == ["rail"]  # and not the one in parameters of a surface
    exact = BSpline(np.arange(8.0), POINTS[:5], 2)(2.0 + 3.0 * U)
    # round-off; points taken as they are would begin 0.1 m away
    np.testing.assert_allclose(curve.position(2.0 + 3.0 * U), exact, atol=1e-13)


def _iges(parameters: str, transformation: str = "") -> str:
    """An IGES file with one curve, in centimetres."""
    lines = [f"{'by hand':72}S      1"]
    head = "1H,,1H;,5Hcurve,5Hc.igs,4Hnone,1H1,32,38,6,308,15,5Hcurve,1.0,10,2HCM,1,0.01;"
    lines += [f"{head[i : i + 72]:72}G{i // 72 + 1:7}" for i in range(0, len(head), 72)]
    data = [parameters[i : i + 64] for i in range(0, len(parameters), 64)]
    moved = 3 if transformation else 0
    lines.append(f"{126:8}{1:8}{0:8}{0:8}{0:8}{0:8}{moved:8}{0:8}00000000D      1")
    lines.append(f"{126:8}{0:8}{0:8}{len(data):8}{0:8}{'':16}{'spine':>8}{0:8}D      2")
    if transformation:
        lines.append(f"{124:8}{len(data) + 1:8}{0:8}{0:8}{0:8}{0:8}{0:8}{0:8}00000000D      3")
        lines.append(f"{124:8}{0:8}{0:8}{1:8}{0:8}{'':16}{'':8}{0:8}D      4")
        data.append(transformation)
    lines += [f"{line:64}{1:8}P{i:7}" for i, line in enumerate(data, 1)]
    return "\n".join([*lines, f"{'S      1G      2D      2P      1':72}T      1"]) + "\n"


def _numbers(values: np.ndarray) -> str:
    return ",".join(f"{x:.15g}" for x in values.ravel())


def test_part_of_a_curve_that_is_turned(tmp_path: Path) -> None:
    path = tmp_path / "spine.iges"
    head, whole = "126,5,3,0,0,0,0,", ",".join(map(_numbers, (KNOTS, WEIGHTS, 100.0 * POINTS)))
    path.write_text(
        _iges(f"{head}{whole},0.2,0.9,0,0,1;", "124,0.,-1.,0.,100.,1.,0.,0.,0.,0.,0.,1.,0.;")
    )
    curve = ff.read_curves(path)["spine"]
    x, y, z = ff.NurbsCurve(3, KNOTS, POINTS, WEIGHTS).position(0.2 + 0.7 * U).T
    # round-off; without the transformation, the weights or the ends it is off by 1e-2 m
    moved = np.column_stack([1.0 - y, x, z])
    np.testing.assert_allclose(curve.position(0.2 + 0.7 * U), moved, rtol=0, atol=1e-12)


REFUSED = [
    ("a.obj", "", "its name must end in .step, .stp, .igs, .iges"),
    ("a.step", "Merge 'x.geo';", "it does not begin with ISO-10303-21; like STEP files"),
    ("a.step", "ISO-10303-21; #1='x", "a text or a comment in it does not end"),
    ("a.step", "ISO-10303-21; #1=POINT((;", "#1: brackets that do not match"),
    ("a.step", STEP.replace("$,.METRE.", "$,.FOOT."), "one unit of length in metres, give scale"),
    ("a.step", STEP.replace("(1,1,1,", "(99999999999,1,1,"), "curve #30: it lacks points, knots"),
    ("a.step", STEP.replace("#12,#13", "#12,#99"), "curve #30: it lacks points, knots"),
    ("a.step", STEP.replace("0.,1.,2.,", "0.,9.,2.,"), "curve #30: knots must not decrease"),
    ("a.step", "ISO-10303-21; #1=(LENGTH_UNIT()SI_UNIT($,.METRE.));", "it has no B-spline curve"),
    ("a.igs", "hello\n", "line 1 has no letter of an IGES section in column 73"),
    ("a.igs", _iges("126,999999999,3,0,0,0,0;"), "curve D1: it has fewer numbers than its points"),
    ("a.igs", _iges("126,1,1,0,0,0,0,x;"), "curve D1: its parameters are not the numbers"),
    ("a.igs", _iges("126,1,1;").replace("10,2HCM", "03,2HXX"), "one unit of length in metres"),
    ("a.igs", _iges("126,1,1;").splitlines()[0], "it is not a whole IGES file"),
]


@pytest.mark.parametrize(("name", "text", "message"), REFUSED)
def test_files_that_are_refused_in_one_line(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=r'^curve file "') as raised:
        ff.read_curves(path)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


def test_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r'curve file ".*none.step": No such file'):
        ff.read_curves(tmp_path / "none.step")
