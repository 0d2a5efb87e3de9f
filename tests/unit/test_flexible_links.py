# SPDX-License-Identifier: LGPL-3.0-or-later
"""Links of robots that are beams or elastic bodies in floating frames."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.lie import so3

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
LENGTH, WIDTH, HEIGHT = 0.8, 0.03, 0.01
#: e2 is along the width
SECTION = ff.Section.rectangle(WIDTH, HEIGHT, STEEL)
TURN = so3.exp(np.array([0.3, -0.8, 0.4]))
ROD = STEEL.density * WIDTH * HEIGHT * LENGTH
MOMENTS = ROD / 12 * np.array(
    [WIDTH**2 + HEIGHT**2, LENGTH**2 + HEIGHT**2, LENGTH**2 + WIDTH**2]
)  # fmt: skip
ARM = """<robot name="arm">
<link name="base"/>
<joint name="hip" type="continuous"><parent link="base"/><child link="rod"/>
  <origin xyz="0.1 0 0.2" rpy="0.2 0 0"/><axis xyz="0 1 0"/></joint>
<link name="rod">
  <inertial><origin xyz="0.4 0 0"/><mass value="{m!r}"/>
    <inertia ixx="{0!r}" iyy="{1!r}" izz="{2!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="knee" type="continuous"><parent link="rod"/><child link="foot"/>
  <origin xyz="0.8 0 0" rpy="0 0.3 0"/><axis xyz="0 1 0"/></joint>
<link name="foot">
  <inertial><origin xyz="0.2 0 0.1"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="side" type="fixed"><parent link="rod"/><child link="box"/>
  <origin xyz="0.37 0.05 -0.02" rpy="0 0 1"/></joint>
<link name="box">
  <inertial><mass value="0.4"/>
    <inertia ixx="0.001" iyy="0.002" izz="0.0015" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="mark" type="fixed"><parent link="rod"/><child link="dot"/>
  <origin xyz="0.6 0 0.01"/></joint>
<link name="dot"/>
</robot>
""".format(*MOMENTS.tolist(), m=ROD)
BEAM = {"rod": ff.BeamLink(SECTION, "knee", elements=4)}
CURVE = {"rod": ff.BeamLink(SECTION, "knee", elements=3, formulation="nurbs")}


@pytest.fixture(scope="module")
def reduced() -> ff.ReducedBody:
    """The rod, with interfaces at its ends and where the box is."""
    body = ff.beam_body(
        np.linspace([0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0], 17), SECTION, comm=MPI.COMM_SELF,
        orientation=(0.0, 1.0, 0.0),
    )  # fmt: skip
    places = {"hip": 0.0, "knee": LENGTH, "side": 0.35}
    regions = {name: lambda x, at=at: np.isclose(x[0], at) for name, at in places.items()}
    positions = {name: (at, 0.0, 0.0) for name, at in places.items()}
    positions["side"] = (0.37, 0.05, -0.02)
    return ff.reduce_body(body, regions, modes=2, positions=positions)


def read(folder: Path, text: str = ARM, **arguments: Any) -> ff.Robot:
    path = folder / f"arm{MPI.COMM_WORLD.rank}.urdf"
    path.write_text(text)
    return ff.read_urdf(path, position=(1.0, 2.0, 3.0), rotation=TURN, **arguments)


def model_of(robot: ff.Robot, gravity: bool = True) -> ff.Model:
    model = ff.Model("arm", mesh=robot.mesh)
    model.add(*robot.items, *([ff.Gravity((1.0, 2.0, -9.81))] if gravity else []))
    return model


def torques(robot: ff.Robot) -> np.ndarray:
    outputs = [
        robot.drive("hip", lambda t: 0.5 + 1.5 * t + 3.0 * t * t),
        robot.drive("knee", lambda t: -0.7 + 2.0 * t - 4.0 * t * t),
    ]
    motors = [robot.actuator("hip"), robot.actuator("knee")]
    found = ff.inverse_dynamics(model_of(robot), outputs, motors, [0.0], difference=0.5)
    return found.forces[0]


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["beam", "curve", "floating"])
def test_a_flexible_link_weighs_what_a_rigid_one_does(kind, tmp_path, reduced):
    """Torques of drives: the mass of the rod, and all that is fixed to it, at their places."""
    start = {"configuration": {"hip": 0.5, "knee": -0.7}, "rates": {"hip": 1.5, "knee": 2.0}}
    flexible = {"beam": BEAM, "curve": CURVE, "floating": {"rod": ff.FloatingLink(reduced)}}[kind]
    rigid, robot = read(tmp_path, **start), read(tmp_path, flexible=flexible, **start)
    names = [type(item).__name__ for item in robot.items]
    assert names.count("Rigid") == 1  # the box; the massless dot is a marker
    # torques of 13 N m, equal to 2e-14; without the dot of mass or its arm they differ by tenths
    np.testing.assert_allclose(torques(robot), torques(rigid), rtol=0, atol=1e-10)
    body, twin = robot.links["rod"], rigid.links["rod"]
    if kind == "floating":
        np.testing.assert_array_equal(body.velocity, twin.velocity)
        return
    spin = twin.angular_velocity
    np.testing.assert_allclose(body.angular_velocity, spin, atol=1e-14)
    # beams are given the velocity at the inertial origin
    np.testing.assert_allclose(
        body.velocity + np.cross(spin, twin.position), twin.velocity, atol=1e-13
    )


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["beam", "curve", "floating"])
def test_places_on_a_flexible_link(kind, tmp_path, reduced):
    from flexfem.layout.numbered_model import NumberedModel

    flexible = {"beam": BEAM, "curve": CURVE, "floating": {"rod": ff.FloatingLink(reduced)}}[kind]
    robot = read(tmp_path, flexible=flexible, configuration={"hip": 0.5})
    model = model_of(robot)
    model.validate()
    serial = NumberedModel(model)
    for link, offset in (("rod", (0, 0, 0)), ("dot", (0, 0, 0)), ("rod", (0.5, 0.1, -0.2))):
        pose = serial.marker_pose(robot.marker(link, offset))
        # to round-off: an arm in the wrong axes would be off by its length, 0.01 at least
        np.testing.assert_allclose(
            pose.position, robot.frames[link].apply(offset), atol=1e-14, err_msg=link
        )
        np.testing.assert_allclose(pose.rotation, robot.frames[link].rotation, atol=1e-14)
    for name in ("hip", "knee", "side"):
        joint = robot.joints[name]
        a, b = serial.marker_pose(joint.a), serial.marker_pose(joint.b)
        np.testing.assert_allclose(a.position, b.position, atol=1e-14, err_msg=name)


@pytest.mark.parametrize("direction", [1, 2])
def test_deflection(direction, tmp_path):
    """A clamped rod under a small force at its end, about either axis of its section."""
    robot = read(tmp_path, flexible=BEAM)
    model = model_of(robot, gravity=False)
    frame, force = robot.frames["rod"], 1e-3
    tip = robot.marker("rod", (LENGTH, 0.0, 0.0))
    model.add(
        robot.drive("hip", lambda t: 0.0),
        robot.drive("knee", lambda t: 0.0),
        ff.PointForce("push", tip, force * frame.rotation[:, direction]),
        ff.PositionProbe("tip", tip),
    )
    outcome = ff.solve_static(model, ff.StaticOptions())
    assert outcome.status == "ok"
    if MPI.COMM_WORLD.rank:
        return
    history = outcome.history
    moved = np.array([history[f"tip_{x}"][-1] for x in "xyz"]) - frame.apply((LENGTH, 0.0, 0.0))
    side = {1: WIDTH, 2: HEIGHT}[direction]
    inertia = WIDTH * HEIGHT * side**2 / 12.0
    expected = force * LENGTH**3 / (3.0 * STEEL.youngs_modulus * inertia)
    # two-node elements of constant strain: 1 - 1/(4 n^2), and shear of 0.1 %; the wrong axis of the
    # section is off by nine
    found = frame.rotation.T @ moved / expected
    np.testing.assert_allclose(found[direction], 1.0 - 1.0 / 64.0, atol=3e-3)
    np.testing.assert_allclose(np.delete(found, direction), 0.0, atol=1e-3)


def test_motion_of_a_flexible_arm(tmp_path):
    """It starts as its rigid twin does, with consistent joints, and continues in the same way."""
    start = {"configuration": {"hip": 0.5, "knee": -0.7}, "rates": {"hip": 1.5, "knee": 2.0}}
    ends = []
    for flexible in (BEAM, None):
        robot = read(tmp_path, flexible=flexible, **start)
        model = model_of(robot)
        model.add(robot.probe())
        outcome = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.01, tolerance=1e-9))
        assert outcome.status == "ok"
        if not MPI.COMM_WORLD.rank:
            history = outcome.history
            first = [history[c][0] for c in ("hip", "knee", "hip_rate", "knee_rate")]
            # initial velocities need no correction by the joints
            np.testing.assert_allclose(first, [0.5, -0.7, 1.5, 2.0], atol=1e-9)
            ends.append([history["hip"][-1], history["knee"][-1]])
    if not MPI.COMM_WORLD.rank:
        # they rotate by 0.017 and 0.021; bending makes a difference of 1.3e-3
        np.testing.assert_allclose(ends[0], ends[1], atol=2.5e-3)


@pytest.mark.serial
def test_bad_flexible_links(tmp_path, reduced):
    for old, new, message in (
        ('"knee"', '"ankle"', 'no interface "ankle" for the joint: hip, knee, side'),
        (
            "0.8 0 0",
            "0.8 0 0.1",
            r'"knee" is at \(0.8, 0, 0\), the joint at \(0.8, 0, 0.1\) in the',
        ),
    ):
        with pytest.raises(ValueError, match=f'FloatingLink "rod": .*{message}'):
            read(tmp_path, ARM.replace(old, new), flexible={"rod": ff.FloatingLink(reduced)})
    for arguments, message in (
        ({"elements": 0}, "elements must be at least 1, got 0"),
        ({"elements": 2.0}, "elements must be a whole number, got 2.0"),
        ({"formulation": "bernoulli"}, "formulation must be se3 or nurbs, got 'bernoulli'"),
        ({"orientation": (0, 0, 0)}, "orientation must not be zero"),
        ({"end": 0.5}, "end must hold 3 numbers, got 0.5"),
    ):
        with pytest.raises((ValueError, TypeError), match=f"BeamLink: {message}"):
            ff.BeamLink(SECTION, **arguments)
    with pytest.raises(ValueError, match=r'BeamLink "rod": .* parallel'):
        read(tmp_path, flexible={"rod": ff.BeamLink(SECTION, "knee", orientation=(1, 0, 0))})
    with pytest.raises(TypeError, match="FloatingLink: reduced must be a ReducedBody, got 'rod'"):
        ff.FloatingLink("rod")
