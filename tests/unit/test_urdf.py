# SPDX-License-Identifier: LGPL-3.0-or-later
"""Robots from URDF files: where links are, how they move, what they become."""

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.vtu.surfaces import body_surface
from flexfem.lie import so3
from flexfem.model.probes.base import MarkerState

pytestmark = pytest.mark.serial

MASS = (
    '<inertial><origin xyz="{c}" rpy="{r}"/><mass value="{m}"/><inertia ixx="0.2" iyy="0.3" '
    'izz="0.25" ixy="0.01" ixz="-0.02" iyz="0.03"/></inertial>'
)


def heavy(name: str, m: float = 1.0, c: str = "0.1 0 0.2", r: str = "0 0 0", more: str = "") -> str:
    return f'<link name="{name}">{MASS.format(c=c, r=r, m=m)}{more}</link>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    limit = '<limit lower="-3" upper="3" effort="7" velocity="2"/>'
    limits = limit if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{limits}{more}</joint>"
    )


def read(folder: Path, *parts: str, **arguments: Any) -> ff.Robot:
    path = folder / "robot.urdf"
    path.write_text('<robot name="robot">' + "\n".join(parts) + "</robot>")
    return ff.read_urdf(path, **arguments)


EVERY = (
    '<link name="base"/>',
    joint("yaw", "continuous", "base", "a", '<origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/>'
          '<axis xyz="1 2 2"/>'),
    heavy("a"),
    joint("slide", "prismatic", "a", "b", '<origin xyz="0.3 0 0" rpy="0 0 1"/><axis xyz="0 1 1"/>'),
    heavy("b"),
    joint("table", "planar", "b", "c", '<origin xyz="0 0.2 0"/><axis xyz="0.6 0 0.8"/>'),
    heavy("c"),
    joint("fly", "floating", "c", "d", '<origin rpy="0 1 0"/>'),
    heavy("d"),
    joint("follow", "revolute", "d", "e", '<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>'
          '<mimic joint="slide" multiplier="-3" offset="0.25"/>'),
    heavy("e"),
    joint("bolt", "fixed", "e", "tip", '<origin xyz="0.1 0.2 0.3" rpy="0.3 0 0"/>'),
    '<link name="tip"/>',
)  # fmt: skip


def state(t: float) -> dict[str, Any]:
    """A motion of all joints: the configuration at a time."""
    pose = ff.Pose((0.2 + t, 0.1, -0.3 * t), so3.exp(np.array([0.1, 0.4, 0.2]) * (1 + t)))
    return {
        "yaw": 0.7 + 1.1 * t, "slide": 0.2 - 0.4 * t, "table": (0.3 + t, 0.5 * t, -0.9 + 2 * t),
        "fly": pose,
    }  # fmt: skip


RATES = {
    "yaw": 1.1, "slide": -0.4, "table": (1.0, 0.5, 2.0), "fly": (1.0, 0.0, -0.3, 0.1, 0.4, 0.2),
}  # fmt: skip
BASE = {"position": (0.1, 0.2, 0.3), "rotation": so3.exp(np.array([0.5, -0.2, 0.9]))}


def test_velocities_are_rates_of_positions(tmp_path: Path) -> None:
    robot = read(tmp_path, *EVERY, configuration=state(0.0), rates=RATES, **BASE)
    h = 1e-4
    low, high = (read(tmp_path, *EVERY, configuration=state(s * h), **BASE) for s in (-1.0, 1.0))
    for name in "abcde":
        body = robot.links[name]
        before, after = low.frames[name], high.frames[name]
        velocity = (after.position - before.position) / (2 * h)
        spin = so3.log(after.rotation @ before.rotation.T) / (2 * h)
        # differences are good to h^2 = 1e-8; a velocity in the wrong axes is off by a part of one
        np.testing.assert_allclose(body.velocity, velocity, atol=1e-6)
        np.testing.assert_allclose(body.angular_velocity, spin, atol=1e-6)
    assert robot.configuration == pytest.approx({"yaw": 0.7, "slide": 0.2, "follow": -0.35})


def test_probes_of_joints_follow_moving_parents(tmp_path: Path) -> None:
    """Coordinates and rates of joints whose parent rotates and moves, by differences."""
    robot = read(tmp_path, *EVERY, configuration=state(0.0), **BASE)
    h = 1e-5

    def frames(joint: str, q: float, t: float) -> list[ff.Pose]:
        it = robot._single(joint)
        at = so3.exp(np.array([0.3, -0.5, 0.8]) * t) @ it.a.rotation
        axis = at @ it.a.rotation.T @ np.array(it.axis)
        turn = so3.exp((q - it.start.value) * axis) if it.motion == "rotation" else np.eye(3)
        place = np.array([0.1, 1.0, -0.4]) + np.array([2.0, -1.0, 0.5]) * t
        shift = np.zeros(3) if it.motion == "rotation" else q * axis
        return [
            ff.Pose(place, at),
            ff.Pose(place + shift, turn @ at @ it.a.rotation.T @ it.b.rotation),
        ]

    for joint, rate in {"yaw": 1.3, "slide": -0.7}.items():
        q = 0.4
        middle, low, high = (frames(joint, q + rate * s, 0.3 + s) for s in (0.0, -h, h))
        states = [
            MarkerState(
                now.position, now.rotation, (after.position - before.position) / (2.0 * h),
                so3.log(after.rotation @ before.rotation.T) / (2.0 * h),
            )
            for now, before, after in zip(middle, low, high, strict=True)
        ]  # fmt: skip
        found = robot.probe(joint).function(0.0, *states)
        # differences are good to 1e-9; without the parent's motion rates are off by 0.1 to 2
        assert found == pytest.approx([q, rate], abs=1e-7)


def test_every_kind_of_joint(tmp_path: Path) -> None:
    robot = read(tmp_path, *EVERY, configuration=state(0.0), **BASE)
    kinds = {name: type(it).__name__ for name, it in robot.joints.items()}
    assert kinds == {
        "yaw": "Revolute", "slide": "Prismatic", "table": "Planar", "follow": "Revolute"
    }  # fmt: skip
    coupling = next(item for item in robot.items if isinstance(item, ff.Coupling))
    assert (coupling.name, coupling.ratio) == ("follow_mimic", -3.0)
    assert coupling.motions == ("translation", "rotation")
    model = ff.Model("robot")
    model.add(*robot.items)
    # all joints hold at the start: assembling moves nothing
    moved = ff.assemble(model, tolerance=1e-12)
    for name in "abcde":
        np.testing.assert_allclose(moved[name].position, robot.links[name].position, atol=1e-12)
    # the frame of a planar joint: its plane is that of the normal, x rotated onto it
    flat = robot.frames["b"] @ ff.Pose((0.0, 0.2, 0.0))
    shift = flat.rotation.T @ (robot.frames["c"].position - flat.position)
    np.testing.assert_allclose(shift, 0.3 * np.array([0.8, 0.0, -0.6]), atol=1e-14)


def test_planar_arm_in_closed_form(tmp_path: Path) -> None:
    """Two links: positions of the tip, forces of the drives."""
    l1, l2, m1, m2, g = 0.5, 0.4, 3.0, 2.0, 9.81
    q, v, a = np.array([0.3, 0.8]), np.array([1.2, -0.7]), np.array([2.0, 5.0])
    hinge = '<origin xyz="{} 0 0"/><axis xyz="0 0 1"/>'
    robot = read(
        tmp_path, '<link name="base"/>', joint("q1", "revolute", "base", "one", hinge.format(0)),
        heavy("one", m1, "0.2 0 0"), joint("q2", "revolute", "one", "two", hinge.format(l1)),
        heavy("two", m2, "0.15 0 0"), configuration={"q1": q[0], "q2": q[1]},
    )  # fmt: skip
    # origin of inertia: as MASS has it
    c1, c2, I1, I2 = 0.2, 0.15, 0.25, 0.25
    tip = [l1 * np.cos(q[0]) + l2 * np.cos(q.sum()), l1 * np.sin(q[0]) + l2 * np.sin(q.sum()), 0.0]
    np.testing.assert_allclose(robot.marker("two", (l2, 0, 0)).offset, (l2, 0, 0), atol=1e-15)
    np.testing.assert_allclose(robot.frames["two"].apply((l2, 0, 0)), tip, atol=1e-15)
    s, c = np.sin(q[1]), np.cos(q[1])
    M = np.array(
        [
            [I1 + I2 + m1 * c1**2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * c), 0],
            [I2 + m2 * (c2**2 + l1 * c2 * c), I2 + m2 * c2**2],
        ]
    )
    M[0, 1] = M[1, 0]
    coriolis = m2 * l1 * c2 * s * np.array([-(2 * v[0] * v[1] + v[1] ** 2), v[0] ** 2])
    outer = m2 * g * c2 * np.cos(q.sum())
    weight = np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + outer, outer])
    model = ff.Model("arm")
    model.add(ff.Gravity((0.0, -g, 0.0)), *robot.items)
    found = ff.inverse_dynamics(
        model,
        [
            robot.drive(f"q{i + 1}", lambda t, i=i: q[i] + v[i] * t + a[i] * t * t / 2)
            for i in (0, 1)
        ],
        [robot.actuator("q1"), robot.actuator("q2")],
        [0.0],
        difference=0.5,
    )
    # of order 30 N m: round-off is 1e-13, the smallest term 0.5
    np.testing.assert_allclose(found.forces[0], M @ a + coriolis + weight, atol=1e-10)


def test_fixed_links_are_one_body(tmp_path: Path) -> None:
    """Mass, centre and inertia of two links, against points that have the same ones."""
    robot = read(
        tmp_path, heavy("one", 2.0, "0.1 0.2 0.3", "0.4 0.5 0.6"),
        joint("bolt", "fixed", "one", "two", '<origin xyz="1 0 0.5" rpy="0.1 -0.7 0.2"/>'),
        heavy("two", 3.0, "0 0.1 0", "1 0 0"), base="free", velocity=(1, 2, 3),
        angular_velocity=(0.1, 0.2, 0.3), prefix="my_", **BASE,
    )  # fmt: skip
    (body,) = robot.items
    assert body.name == "my_one"
    assert str(robot) == 'robot "my_robot": 2 links, 1 bodies, 0 joints with one coordinate'
    assert robot.links["two"] is body
    total = np.zeros((4, 4))
    tensor = np.array([[0.2, 0.01, -0.02], [0.01, 0.3, 0.03], [-0.02, 0.03, 0.25]])
    second = np.trace(tensor) / 2 * np.eye(3) - tensor  # moments of second order of the mass

    def turn(r, p, y):
        return so3.exp([0, 0, y]) @ so3.exp([0, p, 0]) @ so3.exp([r, 0, 0])

    place = np.eye(4)
    for m, c, rpy in ((2.0, (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)), (3.0, (0, 0.1, 0), (1, 0, 0))):
        H = np.eye(4)
        H[:3, :3], H[:3, 3] = turn(*rpy), c
        moments = np.diag([0.0, 0.0, 0.0, m])
        moments[:3, :3] = second
        total += place @ H @ moments @ H.T @ place.T
        place[:3, :3], place[:3, 3] = turn(0.1, -0.7, 0.2), (1, 0, 0.5)
    centre = total[:3, 3] / total[3, 3]
    about = total[:3, :3] - total[3, 3] * np.outer(centre, centre)
    assert body.mass == pytest.approx(5.0)
    np.testing.assert_allclose(body.centre, centre, atol=1e-14)
    np.testing.assert_allclose(body.inertia, np.trace(about) * np.eye(3) - about, atol=1e-13)
    np.testing.assert_allclose(body.velocity, (1, 2, 3))
    np.testing.assert_allclose(body.angular_velocity, (0.1, 0.2, 0.3), atol=1e-15)
    # bolted by a joint of its own, it is a body of its own
    apart = ff.read_urdf(
        tmp_path / "robot.urdf", base="free", separate=["bolt"], velocity=(1, 2, 3)
    )
    assert [type(item).__name__ for item in apart.items] == ["RigidBody", "RigidBody", "Rigid"]
    np.testing.assert_array_equal(apart.links["two"].velocity, (1, 2, 3))


def test_friction_stops_and_drives(tmp_path: Path) -> None:
    parts = (
        '<link name="base"/>',
        joint("turn", "revolute", "base", "one", '<dynamics damping="0.3" friction="0.2"/>'),
        heavy("one"),
        joint("push", "prismatic", "one", "two", '<dynamics damping="4"/>'),
        heavy("two"),
    )
    robot = read(
        tmp_path, *parts, configuration={"turn": 0.5, "push": 0.1}, stops=(1e4, 10.0),
        friction_velocity=0.01,
    )  # fmt: skip
    things = {item.name: item for item in robot.items}
    rubbing = things["turn_friction"]
    assert (rubbing.force, rubbing.viscous, rubbing.velocity) == (0.2, 0.3, 0.01)
    assert (things["push_friction"].force, things["push_friction"].viscous) == (0.0, 4.0)
    # angles count from the start, displacements from the joint's frame
    assert (things["turn_stop"].lower, things["turn_stop"].upper) == (-3.5, 2.5)
    assert (things["push_stop"].lower, things["push_stop"].upper) == (-3.0, 3.0)
    assert (things["push_stop"].stiffness, things["push_stop"].damping) == (1e4, 10.0)
    drive = robot.drive("turn", lambda t: 0.5 + t)
    assert (drive.name, drive.angle(2.0)) == ("turn_drive", pytest.approx(2.0))
    push = robot.drive("push", lambda t: 0.1 + t)
    assert push.displacement(2.0) == pytest.approx(2.0)
    motor = robot.actuator("turn", lambda t: 20 * np.sin(t), saturate=True)
    assert [motor.force(t) for t in (0.1, 1.5, -1.5)] == pytest.approx(
        [20 * np.sin(0.1), 7.0, -7.0]
    )
    assert robot.limits["turn"].velocity == 2.0
    with pytest.raises(ValueError, match="starts at 0, beyond its limits 1 to 3; give another"):
        read(tmp_path, *parts[:2], *(p.replace('"-3"', '"1"') for p in parts[2:]), stops=(1.0, 0.0))
    plain = read(tmp_path, *parts, friction=False)
    assert [item.name for item in plain.items] == ["one", "two", "turn", "push"]


def test_what_other_programs_want_is_let_pass(tmp_path: Path) -> None:
    robot = read(
        tmp_path, '<material name="grey"><color rgba="0 0 0 1"/></material>',
        '<gazebo reference="one"><plugin filename="a.so"/></gazebo>', '<link name="base"/>',
        '<transmission name="t"><joint name="hip"><x/></joint></transmission>',
        joint("hip", "revolute", "base", "one", '<calibration rising="0.0"/><drake:gear a="1"/>'
              '<safety_controller k_velocity="10"/>'),
        heavy("one", more="<contact><friction/></contact>").replace("<mass ", '<mass drake:a="1" '),
    )  # fmt: skip
    assert [item.name for item in robot.items] == ["one", "hip"]


def test_coordinates_in_the_history(tmp_path: Path) -> None:
    """A finger follows a rotating knob over more than a turn; both counted as in the file."""
    robot = read(
        tmp_path, '<link name="base"/>', joint("knob", "continuous", "base", "one"), heavy("one"),
        joint("finger", "prismatic", "base", "two", '<origin xyz="0 1 0" rpy="0 0 1"/>'
              '<mimic joint="knob" multiplier="0.05" offset="0.2"/>'), heavy("two"),
        configuration={"knob": 4.0}, rates={"knob": 30.0},
    )  # fmt: skip
    model = ff.Model("gripper")
    model.add(*robot.items, robot.probe(), robot.drive("knob", lambda t: 4.0 + 30.0 * t))
    history = ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.4, tolerance=1e-10)).history
    knob = 4.0 + 30.0 * history["t"]
    # kinematics alone; an angle that is wrapped would be off by a turn
    np.testing.assert_allclose(history["knob"], knob, atol=1e-9)
    np.testing.assert_allclose(history["finger"], 0.2 + 0.05 * knob, atol=1e-9)
    # rates end with what the scheme leaves of second order
    np.testing.assert_allclose(history["finger_rate"], 1.5, atol=1e-6)


def test_a_follower_loads_its_leader(tmp_path: Path) -> None:
    """A motor drives a pinion, its rack follows: (I + m r^2) alpha = torque."""
    robot = read(
        tmp_path, '<link name="base"/>', joint("pinion", "continuous", "base", "one"), heavy("one"),
        joint("rack", "prismatic", "base", "two", '<mimic joint="pinion" multiplier="0.4"/>'),
        heavy("two", 2.0),
    )  # fmt: skip
    model = ff.Model("rack")
    model.add(*robot.items, robot.probe(), robot.actuator("pinion", lambda t: 3.0))
    history = ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.1, tolerance=1e-10)).history
    # about x through the joint: that of MASS and 1 kg 0.2 m away
    alpha = 3.0 / (0.2 + 0.2**2 + 2.0 * 0.4**2)
    # at constant acceleration the scheme is exact; without the rack it is more than twice that
    np.testing.assert_allclose(history["pinion"], 0.5 * alpha * history["t"] ** 2, atol=1e-9)
    np.testing.assert_allclose(history["rack"], 0.4 * history["pinion"], atol=1e-10)


BOX = '<visual><origin xyz="1 0 0" rpy="0 0 1.5"/><geometry>{}</geometry></visual>'


def test_pictures(tmp_path: Path) -> None:
    """Surfaces of all geometries at their places; a mirrored mesh keeps its outside."""
    package = tmp_path / "hand_description" / "meshes"
    package.mkdir(parents=True)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    (package / "a.obj").write_text(
        "".join("v {} {} {}\n".format(*x) for x in corners)
        + "".join("f {} {} {}\n".format(*(face + 1)) for face in faces)
    )
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[f].ravel(), 0) for f in faces)
    (tmp_path / "b.STL").write_bytes(bytes(80) + struct.pack("<I", 4) + triangles)
    shapes = (
        '<box size="1 2 3"/>', '<sphere radius="0.5"/>', '<cylinder radius="0.2" length="2"/>',
        '<capsule radius="0.2" length="2"/>', '<mesh filename="b.STL" scale="-2 1 1"/>',
        '<mesh filename="package://hand_description/meshes/a.obj"/>',
    )  # fmt: skip
    low_high = {}
    for shape in shapes:
        robot = read(
            tmp_path,
            heavy("one", more=BOX.format(shape).replace("1.5", str(np.pi / 2))),
            base="free",
        )
        (body,) = robot.items
        surface = body_surface(body.shape, body.mass, body.inertia)
        a, b, c = (surface.points[surface.triangles[:, i]] for i in range(3))
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
        low_high[shape] = (*surface.points.min(axis=0), *surface.points.max(axis=0), volume)
    # x of the geometry is y of the link, and y is -x; volumes are positive: outside is outside
    expected = [
        (0, -0.5, -1.5, 2, 0.5, 1.5, 6.0),
        (0.5, -0.5, -0.5, 1.5, 0.5, 0.5, np.pi / 6),
        (0.8, -0.2, -1, 1.2, 0.2, 1, 0.08 * np.pi),
        (0.8, -0.2, -1.2, 1.2, 0.2, 1.2, np.pi * (0.08 + 4 / 3 * 0.008)),
        (0, -2, 0, 1, 0, 1, 1 / 3),
        (0, 0, 0, 1, 1, 1, 1 / 6),
    ]
    for row, wanted in zip(low_high.values(), expected, strict=True):
        # round shapes have flat facets, within 3 % of their volume
        np.testing.assert_allclose(row, wanted, rtol=0.03, atol=1e-12)


def test_what_pictures_need(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = tmp_path / "packages" / "p"
    elsewhere.mkdir(parents=True)
    here = tmp_path / "here"
    here.mkdir()
    look = BOX.format('<mesh filename="package://p/a.dae"/>')
    link = heavy("one", more=look + look.replace("visual", "collision").replace("dae", "stl"))
    with pytest.raises(ValueError, match=r'package "p" is neither .* packages={"p": "folder"}'):
        read(here, link, base="free")
    with pytest.raises(ValueError, match=r"there is no file .*/packages/p/a.dae"):
        read(here, link, base="free", packages={"p": elsewhere})
    (elsewhere / "a.dae").touch()
    (elsewhere / "a.stl").write_text("no triangles")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere{os.pathsep}{elsewhere.parent}")
    with pytest.raises(ValueError, match=r'line 1: link "one": <mesh> .*".dae" files are not read'):
        read(here, link, base="free")
    with pytest.raises(ValueError, match=r"a.stl.*: it is neither a binary nor an ASCII STL file"):
        read(here, link, base="free", pictures="collision")
    assert read(here, link, base="free", pictures="none").items[0].shape is None


def test_an_ascii_stl_file_is_read_without_a_warning(tmp_path: Path) -> None:
    """Text that is taken for a number overflows; warnings are errors here."""
    lines = "".join(f"vertex {x} {y} 0\n" for x, y in ((0, 0), (0.1, 0), (0, 0.1)))
    facet = f"facet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\n"
    (tmp_path / "plate.stl").write_text(f"solid plate\n{facet}endsolid plate\n")
    link = heavy("one", more=BOX.format('<mesh filename="plate.stl"/>'))
    shape = read(tmp_path, link, base="free").items[0].shape
    assert isinstance(shape, ff.CompoundShape)  # of one shape, where the file puts it
    mesh = shape.parts[0][0]
    assert isinstance(mesh, ff.SurfaceShape)
    corners = mesh.points[mesh.triangles]
    assert corners == pytest.approx(np.array([[(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)]]))
