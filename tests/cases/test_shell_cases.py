# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of the cases with shells: folded panels, strips, half cylinders, fabric."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.cli.case_line import read_options
from flexfem.resources import shipped_files


def built(name: str, **given: object) -> ff.Model:
    """Model of a case."""
    case = load_case(name)
    return case.model(**case.prepare(given)[0])


@pytest.mark.serial
def test_contacts_of_the_pile_are_counted() -> None:
    """A pile on a floor that is nearer than half of the thickness touches it from the start."""
    case = load_case("solar_array")
    small = {"panels": 2, "mesh": "5x9", "wire_elements": 2, "t_end": 0.01}
    assert case.results is not None
    near, apart = (case.run(**small, **more).history for more in ({"pitch": 3e-4}, {}))
    counted = case.results(near)
    assert near["contact_closed"][0] == counted["contacts_at_start"] > 0
    assert counted["first_contact"] == 0.0
    counted = case.results(apart)
    assert counted["contacts_at_start"] == counted["most_contacts"] == 0
    assert "first_contact" not in counted


@pytest.mark.serial
def test_hinges() -> None:
    """Lines between panels are hinges or clamps; the container's and the beam's stay hinges."""
    for hinges, kind in (("free", ff.HingeLine), ("clamped", ff.ClampedLine)):
        model = built("solar_array", panels=3, mesh="3x9", hinges=hinges)
        assert [type(model[f"hinge_{i}"]) for i in (1, 2)] == [kind, kind]
        assert type(model["hanger"]) is ff.HingeLine


@pytest.mark.serial
@pytest.mark.parametrize("ramp", [0.5, 4.0])
def test_ramps_of_the_mast(ramp: float) -> None:
    """The way ends where it should, with the given speed between ramps and no jump of it."""
    speed, way = 0.2, 1.5
    lift = load_case("solar_array").build.__globals__["Lift"](way, speed, ramp)
    t = np.linspace(0.0, lift.end, 2001)
    rate = np.gradient([lift(at) for at in t], t)
    # differences over a two-thousandth of the time; a ramp that begins with the full speed has
    # half of it at the ends
    assert [lift(0.0), lift(lift.end), lift(2.0 * lift.end)] == pytest.approx([0.0, way, way])
    assert rate.max() == pytest.approx(speed, rel=1e-3)
    assert max(abs(rate[0]), abs(rate[-1])) < 1e-3 * speed


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"pitch": 0.3}, "the pitch must be below 0.225 m, half a panel, got 0.3"),
        ({"wire_inset": 1.3}, "wire-inset must be below 1.2 m, half the length of a panel"),
        ({"ramp": 100.0}, "the way of the mast, .* m, must be at least that of both ramps, 10 m"),
    ],
)
def test_lengths_that_do_not_go_together(given: dict[str, float], message: str) -> None:
    """Refused in one line that names the value."""
    with pytest.raises(ValueError, match=message):
        built("solar_array", panels=2, mesh="3x9", **given)


@pytest.mark.serial
def test_sphere_of_triangles() -> None:
    """It is closed, as large as the sphere but for its chords, and a quarter turn is a symmetry."""
    radius, size = 0.05, 0.008
    ball = load_case("draping").build.__globals__["ball"](radius, size)
    corners = ball.points[ball.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert 0.8 * size < edges.max() <= size
    volume = np.linalg.det(corners).sum() / 6.0
    # chords take (size/radius)^2/4 at most; a side that is missing or turned takes an eighth
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.25 * (size / radius) ** 2)
    turned = ball.points[:, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    places = {tuple(np.round(point, 12) + 0.0) for point in ball.points}
    assert {tuple(np.round(point, 12) + 0.0) for point in turned} == places
    assert isinstance(built("draping", mesh="9x9", sphere="mesh")["support"], ff.Contact)


@pytest.mark.serial
def test_numbers_reach_the_models() -> None:
    """Sizes and densities change the mesh and the mass per area."""
    half = built("cylindrical_pendulum", mesh="7x5", radius=0.5, length=2.0)
    assert half.surface is not None
    assert half.surface.areas.sum() == pytest.approx(2.0 * np.pi * 0.5 * 2.0, rel=0.02)
    strips = built("circular_strips", mesh="41x3", radius=1.0, width=0.2, density=1e3)
    assert strips.surface is not None
    assert strips.surface.areas.sum() == pytest.approx(3.0 * np.pi * 0.2, rel=0.01)
    assert strips["strip_1"].section.mass == pytest.approx(1.0)


@pytest.mark.serial
def test_numbers_of_the_benchmarks() -> None:
    """Each benchmark brings its own along, and takes others."""
    model = built("shell_statics", benchmark="hemisphere", mesh="4x4", load=600.0, radius=5.0)
    assert model.surface is not None
    assert np.linalg.norm(model.surface.points, axis=1) == pytest.approx(5.0)
    assert tuple(model["pull"].force) == (300.0, 0.0, 0.0)  # half of it, on the quarter
    assert model["shell"].section.thickness == 0.04
    roof = built("shell_statics", benchmark="thin_roof", mesh="4x4", width=254.0)
    assert roof.surface is not None
    assert roof.surface.points[:, 0].max() == pytest.approx(2540.0 * np.sin(0.05))
    assert roof["shell"].section.thickness == 6.35


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"benchmark": "roof", "inner_radius": 3.0}, "roof has no inner-radius, but 3 is given"),
        ({"inner_radius": 12.0}, "inner-radius must be below the radius 10, got 12"),
        ({"benchmark": "pinched", "displacement": 0.0}, "displacement of pinched must be above 0"),
    ],
)
def test_numbers_that_a_benchmark_refuses(given: dict[str, object], message: str) -> None:
    """Nothing that is given is left out unsaid."""
    with pytest.raises(ValueError, match=message):
        built("shell_statics", mesh="4x4", **given)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "given", "far"),
    [
        ("tutorial_1_pendulum", {"length": 2.0}, (2.0, 0.0, 0.0)),
        ("tutorial_2_four_bar", {"crank": 0.15}, (0.4, 0.3, 0.0)),
        ("tutorial_3_column", {"length": 2.0}, (0.0, 0.0, 2.0)),
        ("tutorial_4_rotor", {"length": 0.4}, (0.0, 0.0, 0.4)),
        ("flying_spaghetti", {"base": 3.0, "height": 4.0}, (3.0, 4.0, 0.0)),
    ],
)
def test_lengths_reach_the_lines(
    name: str, given: dict[str, float], far: tuple[float, float, float]
) -> None:
    """Beams are as long as their options say."""
    mesh = built(name, elements=2, **given).mesh
    assert mesh is not None
    assert mesh.points.max(axis=0) == pytest.approx(far)


@pytest.mark.serial
def test_names_of_numbers_are_free_for_other_analyses() -> None:
    """A case whose gravity is an option can be brought to rest under it, for example."""
    weighed = 0
    for name in shipped_files("cases"):
        case = load_case(name)
        if any(option.name == "gravity" for option in case.options):
            read_options(case, ["--analysis", "statics"])
            weighed += 1
    assert weighed >= 10
    read_options(load_case("solar_array"), ["--analysis", "relaxation"])
    read_options(load_case("tutorial_6_solid_arm"), ["--analysis", "modes"])
