# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections along beams from tables, BeamDyn and windIO; what is refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.tables.csv_table import UNITS
from tests.unit.beam_texts import (
    BLADE,
    MATRICES,
    MU,
    PRIMARY,
    SHARES,
    STATIONS,
    WINDIO_1,
    WINDIO_2,
    matrices,
)
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

#: BeamDyn's numbers of axial force, forces along x and y, torque, moments about x and y.
ORDER = np.array([2, 0, 1, 5, 3, 4])


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    def file(name: str, text: str) -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return file


def test_a_table_holds_the_constants_about_the_reference_axis(write) -> None:
    """One entry after the other from the strain of the centres; twist, units and a middle."""
    table = ff.read_section_table(write("mast.csv", STATIONS))
    assert not table.relative
    assert table.stations.tolist() == [0.0, 3.0]
    assert table.twist_at(np.array([0.0, 1.5])) == pytest.approx([0.0, np.deg2rad(5.0)])
    D, M = table.stiffness[0], table.inertia[0]
    y, z = 0.02, 0.01  # of the tension centre and of the shear centre
    expected = np.diag([4e8, 8e7, 7e7, 9e4, 1.2e5, 2e5])
    expected[4, 5] = expected[5, 4] = -1e3
    expected[0, 5] = expected[5, 0] = -4e8 * y
    expected[5, 5] += 4e8 * y**2
    expected[1, 3] = expected[3, 1] = -8e7 * z
    expected[3, 3] += 8e7 * z**2
    # round-off; a sign or an arm is all of an entry
    np.testing.assert_allclose(D, expected, rtol=1e-13, atol=1e-6)
    first = 15.0 * 0.02
    assert M[0, 4] == pytest.approx(first)
    assert M[1, 3] == pytest.approx(-first)
    assert np.diag(M)[3:] == pytest.approx([0.03 + first * 0.02, 0.01 + first * 0.02, 0.02])
    middle = table.at(np.array([1.5]))[0][0]
    np.testing.assert_allclose(middle, 0.5 * (table.stiffness[0] + table.stiffness[1]))


def test_a_table_holds_whole_matrices(write) -> None:
    table = ff.read_section_table(write("rod.csv", MATRICES))
    assert table.relative
    assert table.stiffness[0, 0, 3] == table.stiffness[0, 3, 0] == 1e5
    assert np.diag(table.stiffness[1]).tolist() == [5e7, 2e7, 2e7, 1e5, 2e5, 2e5]
    assert np.diag(table.inertia[0]).tolist() == [10.0, 10.0, 10.0, 0.05, 0.02, 0.03]


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("EA", "kN", 1e3), ("EA", "MN", 1e6), ("EA", "N", 1.0), ("GJ", "kN m^2", 1e3),
        ("GJ", "MN m^2", 1e6), ("GJ", "N mm^2", 1e-6), ("GJ", "N m^2", 1.0), ("mass", "t/m", 1e3),
        ("mass", "g/mm", 1.0), ("mass", "kg/m", 1.0), ("J2", "kg m", 1.0),
        ("twist", "deg", np.pi / 180), ("twist", "rad", 1.0), ("s", "mm", 1e-3),
    ],
)  # fmt: skip
def test_units_are_their_factors(write, column: str, unit: str, factor: float) -> None:
    numbers = dict.fromkeys(("EA", "GA2", "GA3", "GJ", "EI2", "EI3", "mass", "J2", "J3"), "2")
    numbers |= {"s": "3", "twist": "2"}
    head = ",".join(f"{key} [{unit}]" if key == column else key for key in numbers)
    start = ",".join("0" if key == "s" else value for key, value in numbers.items())
    table = ff.read_section_table(write("t.csv", f"{head}\n{start}\n{','.join(numbers.values())}"))
    found = {
        "EA": table.stiffness[1, 0, 0], "GJ": table.stiffness[1, 3, 3],
        "mass": table.inertia[1, 0, 0], "J2": table.inertia[1, 4, 4],
        "twist": table.twist_at(table.stations)[1], "s": table.stations[1],
    }[column]  # fmt: skip
    assert found == pytest.approx((3.0 if column == "s" else 2.0) * factor, rel=1e-14)
    assert unit in UNITS[{"EA": "N", "GJ": "N m^2", "mass": "kg/m", "J2": "kg m", "twist": "rad",
                          "s": "m"}[column]]  # fmt: skip


def test_beamdyn_files_have_their_axes_and_signs(write) -> None:
    """The root's axes are kept; e1, e2, e3 are z, x, y; the twist is negative about z."""
    write("blade.dat", BLADE)
    data = ff.read_beamdyn(write("primary.dat", PRIMARY))
    assert data.points[-1].tolist() == [-0.4, 0.0, 12.0]
    assert data.damping.tolist() == [MU[i] for i in ORDER]
    assert 12.0 < data.length < 12.1
    for (eta, share), D, M in zip(
        SHARES, data.sections.stiffness, data.sections.inertia, strict=True
    ):
        K, mass = matrices(share)
        assert D[0, 0] == pytest.approx(K[2, 2])
        assert D[5, 5] == pytest.approx(K[4, 4])  # about y = e3: flap
        assert D[0, 4] == pytest.approx(K[2, 3])
        np.testing.assert_allclose(D, K[np.ix_(ORDER, ORDER)], rtol=1e-8)
        np.testing.assert_allclose(M, mass[np.ix_(ORDER, ORDER)], rtol=1e-8)
        assert eta in data.sections.stations
    beam = data.beam("blade")
    mesh = data.mesh("blade", 40)
    lengths = np.linalg.norm(np.diff(mesh.points, axis=0), axis=1)
    # chords of equal arcs differ by the square of their angle
    assert np.ptp(lengths) < 1e-3 * lengths.mean()
    model = ff.Model("blade", mesh=mesh)
    model.add(beam, ff.Rigid("clamp", ff.Ground(), ff.Marker("blade", "start")))
    from flexfem.families.beam_se3.mesh import BeamMesh

    axes = BeamMesh.of(model).cells.frames[0, 0, 3:].reshape(3, 3)
    turn = np.deg2rad(-12.0)
    # the tangent leans by 0.03 from z, by which the axes lean as well
    np.testing.assert_allclose(axes[:, 1], [np.cos(turn), np.sin(turn), 0.0], atol=0.05)
    np.testing.assert_allclose(axes[:, 0], [0.0, 0.0, 1.0], atol=0.05)


@pytest.mark.parametrize("text", [WINDIO_1, WINDIO_2], ids=["1", "2"])
def test_both_versions_of_windio_are_the_same_blade(write, text: str) -> None:
    data = ff.read_windio(write("turbine.yaml", text))
    for (_, share), D, M in zip(
        SHARES, data.sections.stiffness, data.sections.inertia, strict=True
    ):
        K, mass = matrices(share)
        np.testing.assert_allclose(D, K[np.ix_(ORDER, ORDER)], rtol=1e-12)
        np.testing.assert_allclose(M, mass[np.ix_(ORDER, ORDER)], rtol=1e-12)
    assert data.sections.twist_at(np.array([0.0, 0.5])) == pytest.approx([-0.2, -0.05])
    assert data.damping.tolist() == ([0.0] * 6 if text is WINDIO_1 else [MU[i] for i in ORDER])


def test_windio_makes_no_objects_and_does_not_grow(write, tmp_path: Path) -> None:
    for text in (
        "a: !!python/object/apply:os.mkdir ['" + str(tmp_path / "made") + "']\n",
        "a: &a {x: 1}\nb: {<<: *a}\n",
        "[" * 100_000,
        "a: *nothing\n",
    ):
        with pytest.raises(ValueError, match="windIO file") as raised:
            ff.read_windio(write("evil.yaml", text))
        assert "\n" not in str(raised.value)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("text", "old", "new", "reason"),
    [
        (STATIONS, "EA [MN]", "EE", "column 'EE' is not known"),
        (STATIONS, "EA [MN]", "EA [GN]", "is in 'GN', it may be in"),
        (STATIONS, "J2, J3", "J2, J23", 'column "J3" is missing'),
        (STATIONS, "twist [deg]", "K11", 'columns "EA" and "K11" exclude each other'),
        (STATIONS, "twist [deg]", "K12", 'column "K12" does not go with "EA"'),
        (STATIONS, "\n3, 300", "\n3, x", "EA must be a number, got 'x'"),
        (STATIONS, "\n3, 300", "\n3, -3", "station 3: stiffness must be positive definite"),
        (STATIONS, "\n3, 300", "\n-3, 300", "stations must not decrease"),
        (MATRICES, "\n1;", "\n0.9;", "relative stations must go from 0 to 1, got 0 to 0.9"),
        (PRIMARY, "1   member_total", "2   member_total", "only blades of one member are read"),
        (PRIMARY, "4   kp_total", "5   kp_total", "must be a number, got '-----"),
        (PRIMARY, "4   kp_total", "999999999   kp_total", "999999999 rows of numbers"),
        (PRIMARY, "   0.1     0.0     4.0", "   x     0.0     4.0", "line 10: must be a number"),
        (PRIMARY, "blade.dat", "other.dat", "No such file or directory"),
        (BLADE, "3    station_total", "4    station_total", "rows of 1 numbers are missing"),
        (BLADE, " 1   damp_type", " 3   damp_type", "damp_type must be 0 or 1"),
        (BLADE, "4.00000000e+08", "-4.0000000e+08", "stiffness must be positive definite"),
        (BLADE, "-2.00000000e+05", "-9.0000000e+05", "must be symmetric"),
        (WINDIO_1, "stiff_matrix", "stiffness", '"stiff_matrix" is missing'),
        (WINDIO_1, "[0.0, 0.4, 1.0]", "[0.0, 0.4, 0.9]", "grid must increase from 0 to 1"),
        (WINDIO_2, "[100.0, 70.0, 30.0]", "[100.0, 70.0]", "must have 3 numbers as the grid"),
        (WINDIO_2, "[100.0, 70.0, 30.0]", "[100.0, .inf, 30.0]", "must hold finite numbers"),
        (WINDIO_2, "  blade:", "  wing:", '"blade" is missing'),
        (WINDIO_2, "components:", "components: [1]\nx:", "is no mapping"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_named(
    write, text: str, old: str, new: str, reason: str
) -> None:
    assert old in text
    changed = text.replace(old, new, 1)
    read: Callable[[Path], object]
    if text in (STATIONS, MATRICES):
        file, read = write("t.csv", changed), ff.read_section_table
    elif text in (WINDIO_1, WINDIO_2):
        file, read = write("t.yaml", changed), ff.read_windio
    else:
        write("blade.dat", changed if text is BLADE else BLADE)
        file = write("primary.dat", changed if text is PRIMARY else PRIMARY)
        read = ff.read_beamdyn
    with pytest.raises(ValueError, match=reason.replace("[", r"\[")) as raised:
        read(file)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))
