# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model building: names, markers, probes, loads, printing."""

import numpy as np
import pytest

from flexfem.core.marker import Ground, Marker
from flexfem.core.pose import Pose
from flexfem.joints.spherical import Spherical
from flexfem.loads.amplitude import SmoothStep, Table
from flexfem.loads.gravity import Gravity
from flexfem.loads.line_load import LineLoad
from flexfem.loads.point_force import PointForce
from flexfem.loads.point_moment import PointMoment
from flexfem.materials.material import Material
from flexfem.materials.section import Section
from flexfem.mesh.library import build_mesh
from flexfem.mesh.line_mesh import LineMesh
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.shapes import Box, Cylinder, Sphere
from flexfem.model.contact import Contact
from flexfem.model.modal_damping import ModalDamping
from flexfem.model.model import Model
from flexfem.model.probes.base import MarkerState, PositionProbe, Probe
from flexfem.model.rigid_surface import RigidPlane
from tests.unit.executed import executed_lines

pytestmark = pytest.mark.serial

EPS = np.finfo(float).eps
SECTION = Section.rectangle(0.03, 0.03, Material(2.1e11, 0.3, 7850.0))


@pytest.fixture
def model():
    """The slider-crank with a rigid slider."""
    model = Model("slider_crank", mesh=build_mesh("slider_crank", elements=6))
    model.add(
        Beam("rod_1", SECTION),
        Beam("second", SECTION, group="rod_2", orientation=(0, 0, 1), damping=1e-5),
        RigidBody("slider", 0.1, (1e-5, 1e-5, 1e-5), position=(0.9, 0, 0), shape=Sphere(0.02)),
        Spherical("base", Ground(), Marker("rod_1", "ground_pin")),
        Spherical("pin", Marker("rod_1", "end"), Marker("second", "start")),
        Spherical("slide", Marker("second", "slider_pin"), Marker("slider")),
        PointMass("lump", 0.2, Marker("second", "rod_2_middle")),
        PointMoment("drive", Marker("rod_1", "start"), (0, 0, 500.0)),
        Gravity((0, -9.81, 0)),
        PositionProbe("middle", Marker("second", 0.5)),
    )
    return model


def test_model_holds_what_was_added(model):
    model.validate()
    assert [beam.group for beam in model.beams] == ["rod_1", "rod_2"]
    assert [joint.name for joint in model.joints] == ["base", "pin", "slide"]
    assert [load.name for load in model.loads] == ["drive"]
    assert model.gravity.acceleration.tolist() == [0, -9.81, 0]
    assert model["slider"] is model.rigid_bodies[0]
    assert model.get("nothing") is None
    np.testing.assert_array_equal(model.weights(), [6, 6])
    np.testing.assert_array_equal(model.beam_cells(model["second"]), np.arange(6, 12))


def test_add_returns_a_single_object():
    model = Model()
    body = RigidBody("body", 1.0, (1, 1, 1))
    assert model.add(body) is body
    assert model.add(RigidBody("a", 1.0, (1, 1, 1)), RigidBody("b", 1.0, (1, 1, 1))) is None


def test_printed_table(model):
    lines = str(model).splitlines()
    assert lines[0] == 'Model "slider_crank"'
    assert '    second  Beam  group "rod_2", 6 cells, 7.065 kg/m' in lines
    assert any(
        line.split() == ["slide", "Spherical", "second:slider_pin", "-", "slider"] for line in lines
    )
    assert any("middle_x, middle_y, middle_z" in line for line in lines)
    model.add(
        Contact("floor", "rod_1", surfaces=RigidPlane(Ground()), radius=0.01),
        ModalDamping("air", 0.02, modes=3),
    )
    lines = str(model).splitlines()
    assert "    floor  Contact  rod_1 - RigidPlane" in lines
    assert "    air  ModalDamping  3 modes" in lines
    assert max(len(line) for line in lines) < 100
    for i in range(100):
        model.add(RigidBody(f"body_{i}", 1.0, (1, 1, 1)))
    assert len(str(model).splitlines()) < 40
    assert "    ... and 93 more" in str(model)


@pytest.mark.parametrize(
    ("point", "x"),
    [
        ("rod_2_root", 0.3),
        ("rod_2_middle", 0.6),
        ("start", 0.3),
        ("end", 0.9),
        (0.0, 0.3),
        (0.5, 0.6),
        (2 / 3, 0.7),
        (1, 0.9),
    ],
)
def test_nodes_of_markers(model, point, x):
    node = model.marker_place(Marker("second", point)).node
    assert node in model.mesh.group_cells("rod_2")
    assert model.mesh.points[node] == pytest.approx([x, 0, 0])


def test_markers_without_node(model):
    assert model.marker_place(Marker("slider", offset=(0, 1, 0))) is None
    assert model.marker_place(Ground()) is None


def test_fraction_follows_the_arc_length():
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [1.0, 0, 0]])
    mesh = LineMesh(points, [[0, 1], [1, 2], [2, 3]], {"a": [0, 1, 2]})
    model = Model(mesh=mesh)
    model.add(Beam("a", SECTION))
    # nodes by their exact fractions or by some digits of these
    assert [model.marker_place(Marker("a", s)).node for s in (0, 0.1, 0.20001, 1.0)] == [0, 1, 2, 3]
    places = [model.marker_place(Marker("a", s)) for s in (0.04, 0.3, 0.95)]
    assert [place.node for place in places] == [None, None, None]
    assert [place.element for place in places] == [0, 2, 2]
    # round-off; fractions of the number of elements would be 0.12, 0.9 and 0.85
    assert [place.xi for place in places] == pytest.approx([0.4, 0.125, 0.9375], abs=1e-12)


def test_branching_beams_have_named_points():
    points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]]
    mesh = LineMesh(points, [[0, 1], [1, 2], [1, 3]], {"tee": [0, 1, 2]}, {"foot": 3})
    model = Model(mesh=mesh)
    model.add(Beam("tee", SECTION), Spherical("j", Ground(), Marker("tee", "foot")))
    model.validate()
    assert model.marker_place(Marker("tee", "foot")).node == 3


@pytest.mark.slow
def test_a_thousand_bodies_are_checked_quickly():
    """No loop over pairs of bodies, or over all bodies for each joint."""
    model = Model(mesh=build_mesh("chain", links=1000, elements=2))
    for i in range(1, 1001):
        model.add(Beam(f"link_{i}", SECTION, orientation=(0, 1, 0)))
        model.add(
            Spherical(
                f"joint_{i}",
                Marker(f"link_{i - 1}", "end") if i > 1 else Ground(),
                Marker(f"link_{i}", "start"),
            )
        )
    _, lines = executed_lines(model.validate)
    assert lines < 1000 * 1000


# --- frames and markers --------------------------------------------------------------------------


def quarter_turn():
    return np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_pose_products():
    a, b = Pose((1, 2, 3), quarter_turn()), Pose((0, 0, 5), quarter_turn().T)
    point = np.array([0.3, 0.4, 0.5])
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), rtol=8 * EPS)
    unit = a @ a.inverse()
    np.testing.assert_allclose(unit.position, 0.0, atol=8 * EPS)
    np.testing.assert_allclose(unit.rotation, np.eye(3), atol=8 * EPS)
    np.testing.assert_array_equal(Ground((1, 2, 3), quarter_turn()).pose.position, [1, 2, 3])


def test_rounded_rotations_are_made_orthonormal():
    angle = np.pi / 6
    rounded = np.round(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]], 7
    )
    rotation = Marker("a", rotation=rounded).rotation
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=4 * EPS)
    np.testing.assert_allclose(rotation, rounded, atol=1e-7)


def test_values_are_frozen():
    marker = Marker("a", "tip", offset=[1, 2, 3])
    with pytest.raises(AttributeError):
        marker.body = "b"
    with pytest.raises(ValueError, match="read-only"):
        marker.offset[0] = 2.0
    assert str(marker) == "a:tip+offset"


def test_rigid_body_inertia_from_diagonal_or_matrix():
    diagonal = RigidBody("a", 2.0, (1, 2, 3))
    np.testing.assert_array_equal(diagonal.inertia, np.diag([1, 2, 3]))
    turned = quarter_turn() @ diagonal.inertia @ quarter_turn().T
    np.testing.assert_array_equal(RigidBody("b", 2.0, turned).inertia, np.diag([2, 1, 3]))
    # A thin plate satisfies the triangle inequality as an equality, up to rounding
    RigidBody("plate", 1.0, (0.1, 0.2, 0.1 + 0.2), shape=Box((1, 1, 0.01)))
    RigidBody("wheel", 1.0, (0.1, 0.2, 0.2), shape=Cylinder(0.1, 0.2))


# --- loads and amplitudes ------------------------------------------------------------------------


def test_loads_know_where_they_act():
    marker = Marker("rod_1", "end")
    force = PointForce("f", marker, [1, 2, 3], follower=True, amplitude=np.sin)
    assert force.markers == (marker,)
    assert force.factor(0.5) == pytest.approx(np.sin(0.5))
    assert PointMoment("m", marker, [1, 2, 3]).factor(7.0) == 1.0
    line = LineLoad("q", "rod_1", (0, 0, -1))
    assert (line.markers, line.beams) == ((), ("rod_1",))


def test_table_is_piecewise_linear():
    table = Table([0, 2.5, 5], [0, 200, 0])
    values = [table(t) for t in (-1, 0, 1, 2.5, 3.75, 5, 9)]
    assert values == pytest.approx([0, 0, 80, 200, 100, 0, 0])


def test_smooth_step():
    step = SmoothStep(1.0, 3.0, -1.0, 5.0)
    assert [step(t) for t in (0.0, 1.0, 2.0, 3.0, 4.0)] == [-1.0, -1.0, 2.0, 5.0, 5.0]
    # Near its ends the step is of third order: no jump in velocity or acceleration
    small = [step(1.0 + d) + 1.0 for d in (1e-2, 5e-3)]
    assert np.log2(small[0] / small[1]) == pytest.approx(3.0, abs=0.02)


# value at a quarter of the time, by hand: a wrong coefficient of any profile shows there
QUARTERS = {
    "linear": (0.25, 1.0),
    "polynomial": (0.103515625, 3.0),
    "cycloid": (0.25 - 1.0 / (2.0 * np.pi), 3.0),
    "cosine": (0.5 - 0.625 / np.sqrt(2.0), 4.0),
}


@pytest.mark.parametrize("profile", QUARTERS)
def test_profiles_of_a_step(profile):
    step, (quarter, order) = SmoothStep(2.0, 4.0, profile=profile), QUARTERS[profile]
    assert step(2.5) == pytest.approx(quarter, rel=1e-14)
    # all are point-symmetric about the middle, constant outside
    assert [step(t) for t in (1.0, 2.0, 3.0, 4.0, 9.0)] == pytest.approx([0, 0, 0.5, 1, 1])
    assert step(3.5) == pytest.approx(1.0 - quarter, rel=1e-14)
    # how smoothly they begin
    small = [step(2.0 + d) for d in (2e-2, 1e-2)]
    assert np.log2(small[0] / small[1]) == pytest.approx(order, abs=0.03)


# --- probes --------------------------------------------------------------------------------------


def state(position):
    return MarkerState(np.array(position, dtype=float), np.eye(3), np.zeros(3), np.zeros(3))


def test_probe_values():
    a, b = Marker("rod_1", "start"), Ground()
    probe = Probe(
        "gap",
        [a, b],
        ["distance", "angle"],
        lambda t, p, q: (np.linalg.norm(p.position - q.position), t),
        unwrap=["angle"],
    )
    assert probe.markers == (a, b)
    values = probe.evaluate(0.25, [state((3, 4, 0)), state((0, 0, 0))])
    np.testing.assert_array_equal(values, [5.0, 0.25])
    position = PositionProbe("tip", a)
    assert position.columns == ("tip_x", "tip_y", "tip_z")
    np.testing.assert_array_equal(position.evaluate(0.0, [state((1, 2, 3))]), [1, 2, 3])
