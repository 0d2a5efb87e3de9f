# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of ``contact_peers.py`` in MuJoCo: soft constraints.

``default`` leaves its contacts as they are, critically damped with a time constant of 20 ms;
``elastic`` has springs without damping that store the impact in about a tenth of a millimetre;
``stiff`` has the smallest time constant of the step that its manual allows.
"""

import math
from itertools import pairwise

import mujoco
import numpy as np
from contact_scenes import Array, Break, Capstan, Figures, Sheet

ELASTIC = "-1e6 0"
mujoco.set_mju_user_warning(lambda text: None)  # which would go into a file


def _head(step: float, solref: str, friction: float = 0.0, gravity: str = "0 0 0") -> str:
    """Begin of a model."""
    dim = 3 if friction else 1
    return (
        f'<mujoco><option timestep="{step}" gravity="{gravity}" integrator="discrete" '
        f'cone="elliptic" impratio="10"/><size memory="200M"/><default><geom condim="{dim}" '
        f'friction="{friction} 0 0" solref="{solref}"/></default>'
    )


def _begin(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def sheet_landing(scene: Sheet, step: float, setting: str) -> Figures:
    """A flexcomp grid with elasticity of shells; energy with what MuJoCo says it stores."""
    found = Figures()
    solref = {"default": "0.02 1", "elastic": ELASTIC}[setting]
    pitch = scene.side / (scene.nodes - 1)
    model, data = _begin(
        f'{_head(step, solref)}<worldbody><geom type="plane" size="1 1 .1"/>'
        f'<flexcomp name="sheet" type="grid" dim="2" count="{scene.nodes} {scene.nodes} 1" '
        f'spacing="{pitch} {pitch} {pitch}" mass="{scene.mass}" radius="{0.5 * scene.thickness}" '
        f'pos="0 0 {scene.height + 0.5 * scene.thickness}">'
        f'<contact selfcollide="none" condim="1" solref="{solref}"/>'
        f'<elasticity young="{scene.youngs_modulus}" poisson="{scene.poisson_ratio}" '
        f'thickness="{scene.thickness}" elastic2d="both"/></flexcomp></worldbody></mujoco>'
    )
    data.qvel[2::3] = -scene.speed

    def measure() -> None:
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        found.energy.append(float(data.energy.sum()))
        found.depths.append(0.5 * scene.thickness - float(data.flexvert_xpos[:, 2].min()))

    mujoco.mj_forward(model, data)
    measure()
    for _ in range(round(scene.t_end / step)):
        found.timed(lambda: mujoco.mj_step(model, data))
        measure()
    return found


def billiards(scene: Break, step: float, setting: str) -> Figures:
    """Free bodies."""
    found = Figures()
    solref = {"default": "0.02 1", "elastic": ELASTIC}[setting]
    balls, half = scene.ball_places, 0.5 * scene.box_side
    places = np.vstack([balls, scene.box_places])
    shapes = [f'type="sphere" size="{scene.radius}"'] * len(balls)
    shapes += [f'type="box" size="{half} {half} {half}"'] * scene.boxes
    bodies = "".join(
        f'<body pos="{x} {y} {z}"><freejoint/><inertial pos="0 0 0" mass="{mass}" '
        f'diaginertia="{inertia} {inertia} {inertia}"/><geom {shape}/></body>'
        for (x, y, z), mass, inertia, shape in zip(
            places, scene.masses, scene.inertias, shapes, strict=True
        )
    )
    model, data = _begin(f"{_head(step, solref)}<worldbody>{bodies}</worldbody></mujoco>")
    data.qvel[0] = scene.speed

    def measure() -> None:
        rates = data.qvel.reshape(-1, 6)
        found.of_bodies(scene, rates[:, :3], rates[:, 3:])
        at, turned = data.xpos[1:], data.xmat[1:].reshape(-1, 3, 3)
        count = len(balls)
        found.depths.append(scene.depth(at[:count], at[count:], turned[count:]))

    mujoco.mj_forward(model, data)
    measure()
    for _ in range(round(scene.t_end / step)):
        found.timed(lambda: mujoco.mj_step(model, data))
        measure()
    return found


def _rope(scene: Capstan, points: Array) -> str:
    """Chain of capsules on hinges, from the heavy end, which slides along the rope."""
    text, before, last = "", 0.0, 0.0
    radius = 0.5 * scene.diameter
    for k, (start, end) in enumerate(pairwise(points)):
        length = float(np.linalg.norm(end - start))
        angle = math.atan2(end[1] - start[1], end[0] - start[0])
        place = f"{start[0]:.12g} {start[1]:.12g} 0" if k == 0 else f"{last:.12g} 0 0"
        joint = (
            '<joint name="draw" type="slide" axis="-1 0 0"/>' if k == 0
            else f'<joint type="hinge" axis="0 0 1" stiffness="{scene.bending / length}"/>'
        )  # fmt: skip
        mass = scene.density * scene.area * length
        across, along = mass * length**2 / 12.0, 0.5 * mass * radius**2
        text += (
            f'<body pos="{place}" euler="0 0 {math.degrees(angle - before):.12g}">{joint}'
            f'<inertial pos="{0.5 * length} 0 0" mass="{mass}" diaginertia="{along} {across} '
            f'{across}"/><geom type="capsule" fromto="0 0 0 {length:.12g} 0 0" size="{radius}" '
            'contype="1" conaffinity="2"/>'
        )
        before, last = angle, length
    return text + "</body>" * (len(points) - 1)


def capstan(scene: Capstan, step: float, setting: str) -> Figures:
    """A chain that does not stretch, drawn by an actuator of given speed."""
    found = Figures()
    solref = {"default": "0.02 1", "stiff": f"{2.0 * step} 1"}[setting]
    points = scene.line()
    model, data = _begin(
        f'{_head(step, solref, scene.friction)}<worldbody><geom type="cylinder" '
        f'size="{scene.radius} .05" contype="2" conaffinity="1"/>{_rope(scene, points)}'
        '</worldbody><actuator><velocity joint="draw" kv="1e3"/></actuator></mujoco>'
    )
    tip = np.array([np.linalg.norm(points[-1] - points[-2]), 0.0, 0.0])
    mujoco.mj_forward(model, data)
    for k in range(round(scene.t_end / step)):
        t = (k + 1) * step
        force = np.array([0.0, -scene.load(t), 0.0])
        arm = data.xpos[-1] + data.xmat[-1].reshape(3, 3) @ tip - data.xipos[-1]
        data.xfrc_applied[-1] = np.concatenate([force, np.cross(arm, force)])
        data.ctrl[0] = scene.speed(t)
        found.timed(lambda: mujoco.mj_step(model, data))
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise RuntimeError(f"unstable at {t:g} s")
        found.pulls.append((t, float(data.actuator_force[0])))
        found.depths.append(-float(data.contact.dist.min(initial=0.0)))
    return found
