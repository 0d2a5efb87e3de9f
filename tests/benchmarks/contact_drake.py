# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of ``contact_peers.py`` in Drake: compliant point contact, convex solver of first order.

``lagged`` has springs without damping that store the impact in about a millimetre;
``sap`` is Drake's convex approximation. There are no shells.
"""

import numpy as np
from contact_scenes import Break, Figures
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

STIFFNESS = 1e7


def _plant(step: float, solver: str) -> tuple[DiagramBuilder, MultibodyPlant]:
    """Builder and empty plant without gravity."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=step, contact_model="point", discrete_contact_approximation=solver
    )
    plant, _ = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    return builder, plant


def _elastic() -> ProximityProperties:
    """Of surfaces without friction and damping."""
    found = ProximityProperties()
    AddContactMaterial(
        dissipation=0.0, point_stiffness=STIFFNESS, properties=found,
        friction=CoulombFriction(0.0, 0.0),
    )  # fmt: skip
    return found


def billiards(scene: Break, step: float, setting: str) -> Figures:
    """Free bodies."""
    found = Figures()
    builder, plant = _plant(step, setting)
    surface, side = _elastic(), scene.box_side
    ball = SpatialInertia.SolidSphereWithMass(scene.mass, scene.radius)
    box = SpatialInertia.SolidBoxWithMass(scene.box_mass, side, side, side)
    places = np.vstack([scene.ball_places, scene.box_places])
    count, bodies = len(scene.ball_places), []
    for k in range(len(places)):
        body = plant.AddRigidBody(f"body_{k}", ball if k < count else box)
        shape = Sphere(scene.radius) if k < count else Box(side, side, side)
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, f"shape_{k}", surface)
        bodies.append(body)
    plant.Finalize()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for body, place in zip(bodies, places, strict=True):
        plant.SetFreeBodyPose(context, body, RigidTransform(place))
    start = SpatialVelocity([0.0, 0.0, 0.0], [scene.speed, 0.0, 0.0])
    plant.SetFreeBodySpatialVelocity(context, bodies[0], start)

    def measure() -> None:
        rates = plant.GetVelocities(context).reshape(-1, 6)
        found.of_bodies(scene, rates[:, 3:], rates[:, :3])
        poses = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
        at = np.array([pose.translation() for pose in poses])
        turned = np.array([pose.rotation().matrix() for pose in poses[count:]])
        found.depths.append(scene.depth(at[:count], at[count:], turned))

    simulator.Initialize()
    measure()
    for k in range(round(scene.t_end / step)):
        found.timed(lambda k=k: simulator.AdvanceTo((k + 1) * step))
        measure()
    return found
