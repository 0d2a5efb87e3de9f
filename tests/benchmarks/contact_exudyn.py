# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of ``contact_peers.py`` in Exudyn: penalties, implicit generalized-alpha.

``elastic`` has springs without damping that store the impact in about a tenth of a millimetre, a
whole one for the balls; ``soft`` in ten times as much. Exudyn cuts steps where it finds no
solution.
"""

import math
import warnings
from collections.abc import Callable
from typing import Any

import exudyn as exu
import exudyn.beams
import exudyn.graphics
import exudyn.itemInterface as item
import exudyn.shells
import numpy as np
from contact_scenes import Array, Break, Capstan, Figures, Sheet
from exudyn.utilities import InertiaCuboid, InertiaSphere

warnings.simplefilter("ignore", DeprecationWarning)
POSITION, VELOCITY = exu.OutputVariableType.Position, exu.OutputVariableType.Velocity


def _system() -> Any:
    """An empty system."""
    container = exu.SystemContainer()
    system = container.AddSystem()
    system.variables["container"] = container  # which must outlive it
    return system


def _contact(system: Any, low: list[float], high: list[float]) -> Any:
    """Contact without friction of all that is added to it, inside of a box."""
    contact = system.AddGeneralContact()
    contact.SetFrictionPairings(np.zeros((1, 1)))
    contact.SetSearchTreeCellSize([10, 10, 10])
    contact.SetSearchTreeBox(low, high)
    return contact


def _run(
    system: Any, found: Figures, step: float, t_end: float, measure: Callable[[float], None],
    spectral_radius: float = 0.9,
) -> Figures:  # fmt: skip
    """Solve, and measure after every step."""

    def after(_: Any, t: float) -> bool:
        found.aside(lambda: measure(t))
        return True

    system.Assemble()
    measure(0.0)
    system.SetPostStepUserFunction(after)
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = round(t_end / step), t_end, 0
    time.generalizedAlpha.spectralRadius = spectral_radius
    time.newton.useModifiedNewton = True
    time.discontinuous.iterationTolerance = 1e-5
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    found.timed(lambda: system.SolveDynamic(settings))
    return found


def sheet_landing(scene: Sheet, step: float, setting: str) -> Figures:
    """Thin plates of absolute nodal coordinates, balls at their nodes; energy of motion alone."""
    found, system = Figures(), _system()
    stiffness = {"elastic": 3e4, "soft": 3e2}[setting]
    half, z = 0.5 * scene.side, scene.height + 0.5 * scene.thickness
    mesh = exudyn.shells.ShellMesh(
        vertices=[[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]],
        numberOfElementsX=scene.nodes - 1, numberOfElementsY=scene.nodes - 1,
        youngsModulus=scene.youngs_modulus, poissonsRatio=scene.poisson_ratio,
        density=scene.density, thickness=scene.thickness,
    )  # fmt: skip
    mesh.CreateANCFThinPlateElements(system)
    contact = _contact(system, [-0.3, -0.3, -0.1], [0.3, 0.3, 0.3])
    for node in mesh.nodeNumbers:
        rates = [0.0] * len(system.GetNode(node)["referenceCoordinates"])
        rates[2] = -scene.speed
        system.SetNodeParameter(node, "initialVelocities", rates)
        marker = system.AddMarker(item.MarkerNodePosition(nodeNumber=node))
        contact.AddSphereWithMarker(marker, 0.5 * scene.thickness, stiffness, 0.0, 0)
    ground = system.AddObject(item.ObjectGround())
    floor = exudyn.graphics.CheckerBoard([0, 0, 0], size=1, nTiles=1)
    contact.AddTrianglesRigidBodyBased(
        system.AddMarker(item.MarkerBodyRigid(bodyNumber=ground)), stiffness, 0.0, 0,
        *exudyn.graphics.ToPointsAndTrigs(floor),
    )  # fmt: skip

    def measure(t: float) -> None:
        rates = np.array([system.GetNodeOutput(node, VELOCITY) for node in mesh.nodeNumbers])
        places = np.array([system.GetNodeOutput(node, POSITION) for node in mesh.nodeNumbers])
        found.energy.append(0.5 * float(scene.masses @ (rates**2).sum(axis=1)))
        found.depths.append(0.5 * scene.thickness - float(places[:, 2].min()))

    return _run(system, found, step, scene.t_end, measure)


def billiards(scene: Break, step: float, setting: str) -> Figures:
    """Spheres, and boxes as triangles, which do not touch each other."""
    found, system = Figures(), _system()
    stiffness = {"elastic": 1e7, "soft": 1e5}[setting]
    contact = _contact(system, [-1.0, -2.0, -1.0], [4.0, 2.0, 1.0])
    side, nodes = [scene.box_side] * 3, []

    def add(inertia: Any, place: Array, speed: float = 0.0) -> int:
        body = system.CreateRigidBody(
            inertia=inertia, referencePosition=place, initialVelocity=[speed, 0, 0],
            gravity=[0, 0, 0],
        )  # fmt: skip
        nodes.append(system.GetObject(body)["nodeNumber"])
        return int(system.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[-1])))

    for k, place in enumerate(scene.ball_places):
        ball = InertiaSphere(scene.mass, scene.radius)
        marker = add(ball, place, scene.speed if k == 0 else 0.0)
        contact.AddSphereWithMarker(marker, scene.radius, stiffness, 0.0, 0)
    for place in scene.box_places:
        marker = add(InertiaCuboid(scene.box_mass / scene.box_side**3, side), place)
        contact.AddTrianglesRigidBodyBased(
            marker, stiffness, 0.0, 0,
            *exudyn.graphics.ToPointsAndTrigs(exudyn.graphics.Brick([0, 0, 0], side)),
        )  # fmt: skip
    count = len(scene.ball_places)

    def read(kind: Any) -> Array:
        return np.array([system.GetNodeOutput(node, kind) for node in nodes])

    def measure(t: float) -> None:
        found.of_bodies(scene, read(VELOCITY), read(exu.OutputVariableType.AngularVelocity))
        turned = read(exu.OutputVariableType.RotationMatrix).reshape(-1, 3, 3)
        places = read(POSITION)
        found.depths.append(scene.depth(places[:count], places[count:], turned[count:]))

    return _run(system, found, step, scene.t_end, measure)


def _rope(system: Any, scene: Capstan) -> tuple[int, int, list[int]]:
    """Cables along the rope; its first and last node, and all elements."""
    cable = item.ObjectANCFCable2D(
        physicsMassPerLength=scene.density * scene.area, physicsBendingStiffness=scene.bending,
        physicsAxialStiffness=scene.youngs_modulus * scene.area, useReducedOrderIntegration=1,
        physicsAxialDamping=scene.damping * scene.youngs_modulus * scene.area,
        physicsBendingDamping=scene.damping * scene.bending,
    )  # fmt: skip
    around = scene.radius + 0.5 * scene.diameter
    count = math.ceil(scene.free_length / (around * scene.angle / scene.elements))
    end = around * np.array([math.cos(scene.angle), math.sin(scene.angle), 0.0])
    ahead = np.array([-math.sin(scene.angle), math.cos(scene.angle), 0.0])
    line, arc = exudyn.beams.GenerateStraightLineANCFCable2D, exudyn.beams
    light = line(system, [around, -scene.free_length, 0], [around, 0, 0], count, cable)
    wound = arc.GenerateCircularArcANCFCable2D(
        system, [around, 0, 0], around, 0.5 * math.pi, scene.angle, scene.elements, cable,
        nodeNumber0=light[0][-1], setCurvedReferenceConfiguration=False,
    )  # fmt: skip
    heavy = line(
        system, end, end + scene.free_length * ahead, count, cable, nodeNumber0=wound[0][-1]
    )
    return light[0][0], heavy[0][-1], [*light[1], *wound[1], *heavy[1]]


def capstan(scene: Capstan, step: float, setting: str) -> Figures:
    """Cables of absolute nodal coordinates with its contact of cables and circles."""
    found, system = Figures(), _system()
    stiffness, viscous, segments = {"stiff": (1e7, 1e3, 4), "soft": (1e6, 1e2, 4)}[setting]
    first, last, cables = _rope(system, scene)
    around = scene.radius + 0.5 * scene.diameter
    ground = system.AddObject(item.ObjectGround())
    drum = system.AddMarker(item.MarkerBodyRigid(bodyNumber=ground))
    for cable in cables:
        shape = item.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=segments)
        states = [0.1] * segments + [-2] * segments + [0] * segments
        data = item.NodeGenericData(initialCoordinates=states, numberOfDataCoordinates=len(states))
        system.AddObject(
            item.ObjectContactFrictionCircleCable2D(
                markerNumbers=[drum, system.AddMarker(shape)], nodeNumber=system.AddNode(data),
                numberOfContactSegments=segments, contactStiffness=stiffness,
                contactDamping=1e-4 * stiffness, frictionVelocityPenalty=viscous,
                frictionCoefficient=scene.friction, circleRadius=around, useSegmentNormals=False,
            )
        )  # fmt: skip
    system.AddLoad(
        item.LoadForceVector(
            markerNumber=system.AddMarker(item.MarkerNodePosition(nodeNumber=first)),
            loadVectorUserFunction=lambda _, t, __: [0.0, -scene.load(t), 0.0],
        )
    )
    ahead = (-math.sin(scene.angle), math.cos(scene.angle))
    origin = system.AddNode(item.NodePointGround())
    fixed = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=origin, coordinate=0))
    drives = []
    for k, part in enumerate(ahead):
        marker = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=last, coordinate=k))
        drives.append(
            system.AddObject(
                item.ObjectConnectorCoordinate(
                    markerNumbers=[fixed, marker],
                    offsetUserFunction=lambda _, t, *__, part=part: part * scene.drawn(t),
                )
            )
        )

    def measure(t: float) -> None:
        kind = exu.OutputVariableType.Force
        force = [float(np.ravel(system.GetObjectOutput(drive, kind))[0]) for drive in drives]
        found.pulls.append((t, abs(float(np.dot(force, ahead)))))
        places = [system.GetObjectOutputBody(cable, POSITION, [0, 0, 0]) for cable in cables]
        found.depths.append(around - min(float(np.hypot(*place[:2])) for place in places))

    return _run(system, found, step, scene.t_end, measure, spectral_radius=0.5)
