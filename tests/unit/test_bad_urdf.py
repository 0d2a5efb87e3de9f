# SPDX-License-Identifier: LGPL-3.0-or-later
"""URDF files and arguments that make no sense: one line with file, line, element and value."""

import re
from pathlib import Path
from typing import Any

import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

SOUND = """<robot name="arm">
<link name="base"/>
<joint name="hip" type="revolute"><parent link="base"/><child link="leg"/>
  <origin xyz="0 0 1" rpy="0 0 0"/>
  <axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="5" velocity="2"/>
  <dynamics damping="0.1" friction="0.2"/></joint>
<link name="leg">
  <inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><box size="1 2 3"/></geometry></visual></link>
<joint name="knee" type="prismatic"><parent link="leg"/><child link="foot"/>
  <limit lower="0" upper="1"/>
  <mimic joint="hip" multiplier="2"/></joint>
<link name="foot">
  <inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="sole" type="fixed"><parent link="foot"/><child link="toe"/></joint>
<link name="toe"/>
</robot>
"""

# what is replaced by what, and what the message must say
FILES = {
    "xml": ("</robot>", "", r"line 21: no well-formed XML, no element found"),
    "entity": ('<robot name="arm">', '<!DOCTYPE r [<!ENTITY e "x">]>', "entities"),
    "sdf": (SOUND, '<sdf version="1"/>', "line 1: <sdf> is not the root of a URDF file"),
    "xacro": ('<link name="toe"/>', "<xacro:leg/>", "line 19: <xacro:leg> is a macro: expand them"),
    "xacro value": ('"0 0 1"', '"0 0 ${h}"', r'line 4: joint "hip": <origin> xyz .*expand xacro'),
    "no link": (SOUND, '<robot name="arm"/>', "line 1: <robot> has no <link>"),
    "no name": (' name="arm"', "", "line 1: <robot> has no name"),
    "unknown child": ("<visual>", "<inertal/><visual>", 'link "leg": <inertal> is not known in'),
    "unknown attribute": ("rpy=", "rot=", r'line 4: .* attribute rot="0 0 0"; known: xyz'),
    "twice": ('<link name="toe"/>', '<link name="leg"/>', 'line 19: .* first is in line 8'),
    "joint twice": ('"sole"', '"hip"', 'line 18: joint "hip": .* first is in line 3'),
    "element twice": ("<axis", '<axis xyz="1 0 0"/><axis', "line 5: .* <axis> is there a second"),
    "type": ('type="revolute"', 'type="hinge"', 'line 3: .* type must be one of .*, got "hinge"'),
    "number": ('value="2"', 'value="two"', r'line 9: link "leg": <mass> value must .*, got "two"'),
    "infinite": ('"0 0 1"', '"0 0 inf"', "line 4: .* xyz must be finite"),
    "count": ('"0 1 0"', '"0 1"', 'line 5: .* <axis> xyz must hold 3 numbers, got "0 1"'),
    "axis": ('"0 1 0"', '"0 0 0"', 'line 5: .* xyz must not be zero, got "0 0 0"'),
    "mass": ('value="2"', 'value="-2"', 'line 9: .* value must not be negative, got "-2"'),
    "zero mass": ('value="2"', 'value="0"', 'line 9: .* value must be positive, got 0 with princ'),
    "no mass": ('<mass value="2"/>', "", 'line 9: link "leg": <inertial> has no <mass>'),
    "inertia": ('ixx="0.1"', 'ixx="-0.1"', "line 10: .* must be positive definite, got principal"),
    "triangle": ('ixx="0.1"', 'ixx="0.3"', "line 10: .* breaks the triangle inequality"),
    "point": ('x="0.1" iyy="0.1" izz="0.1"', 'x="0" iyy="0" izz="0"', 'line 8: .* definite'),
    "no limit": ('<limit lower="0" upper="1"/>', "", 'line 12: joint "knee": .* has no <limit>'),
    "limits": ('lower="0" upper="1"', 'lower="2" upper="1"', "above upper, got 2 and 1"),
    "damping": ('"0.1" friction', '"-1" friction', 'line 7: .* damping must not be neg.*"-1"'),
    "no parent": ('<parent link="foot"/>', "", 'joint "sole": <joint> has no <parent>'),
    "no such link": ('link="toe"', 'link="heel"', 'line 18: .* <child> link "heel" is not in the'),
    "two parents": ('child link="toe"', 'child link="leg"', 'child of joint "hip" as well'),
    "two roots": ('<link name="toe"/>', '<link name="toe"/><link name="x"/>', 'link "x": .* root'),
    "circle": ('parent link="base"', 'parent link="toe"', 'joint "hip": .* closed loop'),
    "leader": ('joint="hip"', 'joint="elbow"', 'line 14: .* <mimic> joint "elbow" must be one'),
    "itself": ('joint="hip"', 'joint="knee"', 'line 14: .* joint "knee" follows itself'),
    "multiplier": ('plier="2"', 'plier="0"', "line 14: .* multiplier must not be zero"),
    "planar friction": ('"revolute"', '"planar"', "line 7: .* <dynamics> of a joint of type"),
    "massless": ("fixed", "floating", 'line 19: link "toe": <link> has no mass but moves on joint'),
    "geometry": ("<box size", "<cone size", "<cone> is not known in <geometry>"),
    "box": ("1 2 3", "1 2 0", 'line 11: .* <box> size must be positive, got "1 2 0"'),
    "mesh": ('box size="1 2 3"', 'mesh filename="a.stl"', r'<mesh> filename "a.stl": there is no'),
    "package": ('box size="1 2 3"', 'mesh filename="package://p/a.stl"', 'package "p" is neither'),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), FILES.values(), ids=FILES)
def test_files(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    assert old in SOUND
    path.write_text(SOUND.replace(old, new, 1))
    with pytest.raises(ValueError, match=message) as raised:
        ff.read_urdf(path)
    text = str(raised.value)
    # another line or element than the wrong one would send its author astray
    assert re.match(rf'"{path}", line \d+: ', text)
    assert "\n" not in text
    assert_on_page(text)


BEAM = ff.BeamLink(ff.Section.circle(0.01, ff.Material(2e11, 0.3, 7800.0)))
ARGUMENTS: dict[str, tuple[dict[str, Any], str]] = {
    "base": ({"base": "loose"}, "base must be fixed or free, got 'loose'"),
    "pictures": ({"pictures": "all"}, "pictures must be visual or collision or none, got 'all'"),
    "velocity": ({"velocity": (1, 0, 0)}, 'are for base="free"'),
    "free": ({"base": "free"}, 'line 2: link "base": <link> has no mass: base="free" needs'),
    "no joint": ({"configuration": {"hop": 1.0}}, "no joint 'hop'; there are 'hip"),
    "fixed joint": ({"rates": {"sole": 1.0}}, 'rates: joint "sole" is fixed'),
    "follower": ({"configuration": {"knee": 1.0}}, 'joint "knee" follows "hip"'),
    "limits": ({"configuration": {"hip": 90.0}}, 'joint "hip": .* limits -1 to 1, got 90'),
    "kind": ({"configuration": {"hip": "1"}}, "configuration must be a number, got '1'"),
    "no link": ({"flexible": {"arm": BEAM}}, "flexible: there is no link 'arm'"),
    "no beam": ({"flexible": {"leg": 1}}, r'flexible\["leg"\] must be a BeamLink or FloatingLink'),
    "root": ({"flexible": {"base": BEAM}}, 'line 2: link "base": .* flexible only with'),
    "end": ({"flexible": {"foot": ff.BeamLink(BEAM.section, "hip")}}, 'has no joint "hip" where'),
    "no length": ({"flexible": {"foot": BEAM}}, 'BeamLink "foot": end must not be the origin'),
    "no end": ({"flexible": {"toe": BEAM}}, "has 0 joints that leave it, its BeamLink"),
    "stops": ({"stops": {"hip": (0.0, 1.0)}}, "stiffness must be positive .* got 0 and 1"),
    "no limits": ({"stops": {"sole": (1.0, 1.0)}}, 'joint "sole" has no limits'),
    "separate": ({"separate": ["hip"]}, 'separate: joint "hip" is not fixed but revolute'),
    "massless": ({"separate": ["sole"]}, 'link "toe": .* joint "sole" cannot be separate'),
    "packages": ({"packages": {"p": "/no/such"}}, 'packages: "p": there is no folder "/no/such"'),
    "rotation": ({"rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "must be a rotation matrix"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), ARGUMENTS.values(), ids=ARGUMENTS)
def test_arguments(arguments: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(SOUND)
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        ff.read_urdf(path, **arguments)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


def test_what_stands_on_the_ground_needs_no_sense(tmp_path: Path) -> None:
    """Files give fixed bases masses of zero or inertias that no body has."""
    path, inertia = (
        tmp_path / "arm.urdf",
        '<inertia ixx="1" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>',
    )
    heavy = f'<link name="base"><inertial><mass value="0"/>{inertia}</inertial></link>'
    path.write_text(SOUND.replace('<link name="base"/>', heavy))
    assert ff.read_urdf(path).links["base"] is None
    with pytest.raises(ValueError, match=r'line 2: link "base": <mass> value must be positive'):
        ff.read_urdf(path, base="free")


def test_robots_refuse_what_they_do_not_have(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(SOUND)
    robot = ff.read_urdf(path)
    with pytest.raises(ValueError, match="there is no link 'arm'; it has 'base, leg, foot, toe'"):
        robot.marker("arm")
    with pytest.raises(ValueError, match="no joint with one coordinate 'sole'; it has 'hip, knee'"):
        robot.drive("sole", lambda t: t)
    with pytest.raises(TypeError, match='drive of joint "hip": position must be a function'):
        robot.drive("hip", 1.0)
    with pytest.raises(ValueError, match=r'line 12: joint "knee": .* no positive effort'):
        robot.actuator("knee", saturate=True)
    with pytest.raises(ValueError, match=f'"{tmp_path}/leg.urdf": No such file'):
        ff.read_urdf(tmp_path / "leg.urdf")
    with pytest.raises(TypeError, match="read_urdf: file must be a str or PathLike, got 3"):
        ff.read_urdf(3)  # type: ignore[arg-type]
    path.write_text(
        SOUND.replace('link="leg"', 'link="hip"').replace('k name="leg"', 'k name="hip"')
    )
    names = [item.name for item in ff.read_urdf(path).items]
    assert "hip" in names
    assert "hip_joint" in names  # a model has one list of names
