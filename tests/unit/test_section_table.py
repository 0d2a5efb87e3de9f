# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections and materials from tables."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.tables import csv_table, section_table

pytestmark = pytest.mark.serial

MATERIALS = """\
# of the workshop
name, E [GPa], nu, rho
steel, 210, 0.3, 7850
alloy, 70, 0.33, 2700
"""

SECTIONS = """\
name;kind;material;width [mm];height [mm];wall [mm];diameter [mm];inner_diameter [mm];\
outer_diameter [mm];A [cm^2];I2 [cm^4];I3 [cm^4];J [cm^4];k2;k3;mass_y;shear_y [mm]

# bars
bar;rectangle;steel;20;30
box;hollow_rectangle;alloy;40;60;2
rod;circle;steel;;;;12
pipe;tube;alloy;;;;;16;20
IPE 100;constants;steel;;;;;;;10.3;171;15.9;1.20;0.6;0.4;0.001;-2
"""


@pytest.fixture
def file(tmp_path):
    def write(text, name="table.csv"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


def test_sections_are_those_of_the_library(file) -> None:
    materials = ff.read_materials(file(MATERIALS))
    assert materials == {
        "steel": ff.Material(210e9, 0.3, 7850.0),
        "alloy": ff.Material(70e9, 0.33, 2700.0),
    }
    steel, alloy = materials.values()
    expected = {
        "bar": ff.Section.rectangle(0.02, 0.03, steel),
        "box": ff.Section.hollow_rectangle(0.04, 0.06, 0.002, alloy),
        "rod": ff.Section.circle(0.012, steel),
        "pipe": ff.Section.tube(0.016, 0.02, alloy),
    }
    found = ff.read_sections(file(SECTIONS), materials)
    assert list(found) == [*expected, "IPE 100"]
    for name, section in expected.items():
        # decimal fractions times 1e-3: round-off; a wrong unit or order of sides is no round-off
        np.testing.assert_allclose(found[name].stiffness, section.stiffness, rtol=1e-14)
        np.testing.assert_allclose(found[name].inertia, section.inertia, rtol=1e-14)
        np.testing.assert_allclose(found[name].outline, section.outline, rtol=1e-14)


def test_constants_of_a_profile(file) -> None:
    """An IPE 100 (EN 10365), strong axis e2: 8.1 kg/m and 171 cm^4 by the tables of profiles."""
    materials = ff.read_materials(file(MATERIALS))
    section = ff.read_sections(file(SECTIONS), materials)["IPE 100"]
    assert section.mass_per_length == pytest.approx(8.1, rel=5e-3)  # listed with two digits
    g = 210e9 / 2.6
    diagonal = [210e9 * 10.3e-4, 0.6 * g * 10.3e-4, 0.4 * g * 10.3e-4, None, 210e9 * 171e-8,
                210e9 * 15.9e-8]  # fmt: skip
    # twist turns about the shear centre at y = -2 mm: the force along e3 adds k3 G A y^2
    diagonal[3] = g * 1.2e-8 + diagonal[2] * 0.002**2
    np.testing.assert_allclose(np.diag(section.stiffness), diagonal, rtol=1e-12)
    np.testing.assert_allclose(section.mass_centre, [0.001, 0.0], atol=1e-15)
    assert section.outline is None


def test_materials_in_the_rows_of_sections(file) -> None:
    found = ff.read_sections(
        file("\ufeffname,kind,E,nu,rho,diameter\na,circle,2e11,0.3,7800,0.01\n")
    )
    section = ff.Section.circle(0.01, ff.Material(2e11, 0.3, 7800.0))
    np.testing.assert_array_equal(found["a"].stiffness, section.stiffness)


PROFILES = """\
name, kind, material, width [mm], height [mm], web [mm], flange [mm], thickness [mm], fillet [mm], \
k2, k3, shear_y [mm]
IPE 100, i_section, steel, 55, 100, 4.1, 5.7, , 7
UPE 100, channel, steel, 55, 100, 4.5, 7.5, , 10
U, channel, steel, 55, 100, 4.5, 7.5, , 10, 0.4, 0.3, -35
L, angle, steel, 100, 65, , , 8
T, t_section, steel, 50, 60, 5, 6
"""


def test_profiles(file) -> None:
    steel = ff.Material(210e9, 0.3, 7850.0)
    channel = (0.055, 0.1, 0.0045, 0.0075, steel)
    expected = {
        "IPE 100": ff.Section.i_section(0.055, 0.1, 0.0041, 0.0057, steel, fillet=0.007),
        "UPE 100": ff.Section.channel(*channel, fillet=0.01),
        "U": ff.Section.channel(
            *channel, fillet=0.01, shear_factor=(0.4, 0.3), shear_centre=(-0.035, 0.0)
        ),
        "L": ff.Section.angle(0.1, 0.065, 0.008, steel),
        "T": ff.Section.t_section(0.05, 0.06, 0.005, 0.006, steel),
    }
    found = ff.read_sections(file(PROFILES), {"steel": steel})
    for name, section in expected.items():
        # decimal fractions times 1e-3, through the solution of a system: 1e-12 and less of the
        # largest entry; sides or columns exchanged are off by per cents
        for got, wanted in (
            (found[name].stiffness, section.stiffness), (found[name].outline, section.outline),
        ):  # fmt: skip
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


HEAD = "name,kind,material,diameter,width,height,k2,k3\n"
BAD = [
    ("", "no line with the names of columns"),
    (HEAD, "no rows"),
    ("kind,diameter\ncircle,1\n", 'line 1: column "name" is missing; there are kind, diameter'),
    ("name,diameter\na,1\n", 'line 1: column "kind" is missing'),
    ("name,kind,colour\na,circle,red\n", "line 1: column 'colour' is not known; known are name, "),
    ("name,kind,kind\na,circle,b\n", 'line 1: column "kind" occurs twice'),
    ("name,kind,diameter [in]\na,circle,1\n", "is in 'in', it may be in m, cm, mm"),
    ("name,kind,k2 [mm]\na,circle,1\n", "is in 'mm', it may be in no unit"),
    ("#\n" + HEAD + "\na,circle,steel,x\n", "line 4 \"a\": diameter must be a number, got 'x'"),
    (HEAD + "a,circle,steel,-1\n", 'line 2 "a": diameter must be positive, got -1.0'),
    (HEAD + "a,circle,steel,nan\n", 'line 2 "a": diameter must be finite'),
    (HEAD + "a,circle,steel,\n", 'line 2 "a": diameter is missing'),
    (HEAD + "a,ring,steel,1\n", "line 2 \"a\": kind must be one of rectangle, .*, got 'ring'"),
    (HEAD + "a,circle,wood,1\n", "material \"wood\" is not known; there are 'steel'"),
    (HEAD + "a,circle,,1\n", 'line 2 "a": E is missing'),
    (HEAD + "a,circle,steel,1,2\n", "width must be empty, a circle has none, got '2'"),
    (HEAD + "a,circle,steel,1,,,0.9\n", 'line 2 "a": k2 and k3 must both be given, or neither'),
    (HEAD + "a,circle,steel,1,,,0.9,0\n", "shear_factor must be positive"),
    (
        "name,kind,material,diameter,fillet\na,circle,steel,1,1\n",
        "fillet must be empty, a circle has none, got '1'",
    ),
    (
        "name,kind,material,width,height,thickness,web\na,angle,steel,1,1,0.1,0.1\n",
        "web must be empty, an angle has none, got '0.1'",
    ),
    (
        "name,kind,material,width,height,thickness\na,angle,steel,1,1,2\n",
        'line 2 "a": thickness and fillet must be less than the width 1, got 2',
    ),
    (HEAD + "a,circle,steel,1\na,circle,steel,2\n", 'line 3: the name "a" occurs twice'),
    (HEAD + ",circle,steel,1\n", "line 2: name is missing"),
    (HEAD + "a,circle,steel,1,,,,,5\n", "line 2: 9 fields for 8 columns"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[message for _, message in BAD])
def test_bad_tables_are_refused_in_one_line(text, message, file) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        ff.read_sections(file(text), {"steel": ff.Material(210e9, 0.3, 7850.0)})
    assert str(caught.value).startswith('table "')
    assert "\n" not in str(caught.value)


def test_other_mistakes(file, tmp_path) -> None:
    with pytest.raises(ValueError, match=r'table ".*none.csv" cannot be read: No such file'):
        ff.read_sections(tmp_path / "none.csv")
    with pytest.raises(TypeError, match='material "steel" must be a Material, got 210'):
        ff.read_sections(file(SECTIONS), {"steel": 210e9})
    with pytest.raises(ValueError, match=r'line 2 "a": poisson_ratio must be in \(-1, 0.5\]'):
        ff.read_materials(file("name,E,nu,rho\na,1e9,0.7,1000\n"))
    with pytest.raises(ValueError, match='column "rho" is missing'):
        ff.read_materials(file("name,E,nu\na,1e9,0.3\n"))


#: Values in SI units of numbers in other units, by column.
UNITS = {
    "E": {"Pa": 1.0, "MPa": 1e6, "N/mm^2": 1e6, "GPa": 1e9},
    # a tonne in a cubic millimetre, of 1e-9 m^3
    "rho": {"kg/m^3": 1.0, "g/cm^3": 1e3, "t/mm^3": 1e12},
    "diameter": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "A": {"m^2": 1.0, "cm^2": 0.01**2, "mm^2": 0.001**2},
    "J": {"m^4": 1.0, "cm^4": 0.01**4, "mm^4": 0.001**4},
}


@pytest.mark.parametrize(
    ("column", "unit"), [(column, unit) for column, units in UNITS.items() for unit in units]
)
def test_units(column, unit, file) -> None:
    """A number in every unit is the same number in the SI unit times its factor."""
    found = []
    for name, value in ((unit, "3"), (next(iter(UNITS[column])), repr(3.0 * UNITS[column][unit]))):
        head = {"E": "1", "nu": "0.3", "rho": "1"}
        if column in head:
            titles = [f"{key} [{name}]" if key == column else key for key in head]
            row = ["one", *(value if key == column else number for key, number in head.items())]
            text = ",".join(["name", *titles]) + "\n" + ",".join(row) + "\n"
            found.append(vars(ff.read_materials(file(text))["one"]))
            continue
        steel = {"steel": ff.Material(210e9, 0.3, 7850.0)}
        if column == "diameter":
            text = f"name,kind,material,diameter [{name}]\none,circle,steel,{value}\n"
        else:
            sizes = {key: value if key == column else "1" for key in ("A", "I2", "I3", "J")}
            titles = [f"{key} [{name}]" if key == column else key for key in sizes]
            text = ",".join(["name", "kind", "material", *titles, "k2", "k3"]) + "\n"
            text += ",".join(["one", "constants", "steel", *sizes.values(), "1", "1"]) + "\n"
        found.append({"K": ff.read_sections(file(text), steel)["one"].stiffness.tolist()})
    for key, expected in found[1].items():
        # round-off; a wrong power of ten is none
        np.testing.assert_allclose(found[0][key], expected, rtol=1e-14)


def test_all_units_of_the_tables_are_tested() -> None:
    known = {unit for units in UNITS.values() for unit in units}
    tables = set(section_table._COLUMNS.values())
    assert {unit for si in tables for unit in csv_table.UNITS[si]} == known
