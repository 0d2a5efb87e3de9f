# SPDX-License-Identifier: LGPL-3.0-or-later
"""Copy of a model with its bodies, and all that is fixed to them, at other places."""

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, JointAction
from flexfem.core.marker import Ground, Marker, SurfaceMarker
from flexfem.core.pose import Pose
from flexfem.loads.gravity import Gravity
from flexfem.materials.thermal_strain import ThermalStrain
from flexfem.mesh.geometry.frames import Orientation
from flexfem.mesh.line_mesh import LineMesh, section_frames
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.mesh.nurbs.frames import control_frames
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.model import Model

__all__ = ["moved_model"]


def moved_model(model: Model, motions: Mapping[str, Pose]) -> Model:
    """A model whose bodies are moved rigidly, with their initial velocities.

    Markers, joints and probes move with the bodies. Loads keep their inertial directions.

    Args:
        model: the model.
        motions: of every body by its name, ``x`` to ``R x + p`` in inertial axes.
    """
    mesh = None if model.mesh is None else _moved_lines(model, motions)
    surface = None if model.surface is None else _moved_surface(model, motions)
    moved = Model(model.name, mesh=mesh, surface=surface)
    mover = _Mover(model, motions)
    if model.gravity is not None:
        moved.add(Gravity(model.gravity.acceleration))
    for thing in model.things:
        moved.add(mover.moved(thing))
    moved.release(*model.released)
    return moved


class _Mover:
    """Moves the objects of a model, each once: shared objects stay shared."""

    def __init__(self, model: Model, motions: Mapping[str, Pose]) -> None:
        self._model, self._motions = model, motions
        self._done: dict[int, Any] = {}

    def moved(self, thing: Any) -> Any:
        """The thing at its new place, or itself where nothing in it moves."""
        if id(thing) not in self._done:
            self._done[id(thing)] = self._move(thing)
        return self._done[id(thing)]

    def _move(self, thing: Any) -> Any:
        if isinstance(thing, Ground):
            return thing
        if isinstance(thing, Marker):
            return self._marker(thing)
        if isinstance(thing, RigidBody):
            return _moved_body(thing, self._motions[thing.name])
        if isinstance(thing, Body):
            return thing.moved(self._motions[thing.name])
        if isinstance(thing, FloatingBody):
            return _moved_body(thing, self._motions[thing.name])
        if isinstance(thing, Beam):
            return _moved_beam(self._model, thing, self._motions[thing.name])
        if isinstance(thing, (list, tuple)):
            values = [self.moved(value) for value in thing]
            if all(new is old for new, old in zip(values, thing, strict=True)):
                return thing
            return type(thing)(values)
        if isinstance(thing, Mapping):
            found = {key: self.moved(value) for key, value in thing.items()}
            return found if any(found[key] is not thing[key] for key in thing) else thing
        if isinstance(thing, Shell):
            return _moved_shell(thing, self._motions[thing.name])
        if not _has_fields(thing):
            return thing
        return self._parts(thing)

    def _parts(self, thing: Any) -> Any:
        """A thing that may hold markers or joints."""
        found = {name: (old, self.moved(old)) for name, old in vars(thing).items()}
        new = {name: now for name, (old, now) in found.items() if now is not old}
        if isinstance(thing, Joint) and not isinstance(thing, JointAction):
            turns = [
                np.eye(3) if isinstance(m, Ground) else self._motions[m.body].rotation
                for m in thing.markers
            ]
            new |= thing.turned(turns)
        if not new:
            return thing
        moved = copy(thing)
        _checks.assign(moved, **new)
        return moved

    def _marker(self, marker: Marker) -> Marker:
        motion = self._motions[marker.body]
        new: dict[str, Any] = {"rotation": motion.rotation @ marker.rotation}
        if isinstance(marker, SurfaceMarker):
            new["offset"] = motion.rotation @ marker.offset
        elif isinstance(marker.point, tuple):
            new["point"] = tuple(motion.apply(marker.point).tolist())
        moved = copy(marker)
        _checks.assign(moved, **{k: _frozen(v) for k, v in new.items()})
        return moved


def _frozen(value: Any) -> Any:
    return _checks.freeze(value) if isinstance(value, np.ndarray) else value


def _has_fields(thing: Any) -> bool:
    """Return True if this is an object of the package with attributes, no function or class."""
    return type(thing).__module__.startswith("flexfem.") and hasattr(thing, "__dict__")


def _moved_body[Body: (FloatingBody, RigidBody)](body: Body, motion: Pose) -> Body:
    moved = copy(body)
    _checks.assign(
        moved,
        position=_checks.freeze(motion.apply(body.position)),
        rotation=_checks.freeze(motion.rotation @ body.rotation),
        velocity=_checks.freeze(motion.rotation @ body.velocity),
        angular_velocity=_checks.freeze(motion.rotation @ body.angular_velocity),
    )
    return moved


def _moved_beam(model: Model, beam: Beam, motion: Pose) -> Beam:
    moved = copy(beam)
    _checks.assign(
        moved,
        curve=None if beam.curve is None else _moved_curve(beam.curve, motion),
        orientation=_moved_orientation(model, beam, motion),
        **_moved_velocities(beam, motion),
    )
    return moved


def _moved_shell(shell: Shell, motion: Pose) -> Shell:
    moved, strain = copy(shell), shell.prestrain
    if isinstance(strain, ThermalStrain):
        warmed = copy(strain)
        _checks.assign(warmed, **{k: _carried(v, motion) for k, v in vars(strain).items()})
        strain = warmed
    _checks.assign(
        moved,
        direction=_turned(shell.direction, motion),
        rest_curvature=_carried(shell.rest_curvature, motion),
        prestrain=strain if isinstance(strain, ThermalStrain) else _carried(strain, motion),
        **_moved_velocities(shell, motion),
    )
    return moved


def _moved_velocities(body: Beam | Shell, motion: Pose) -> dict[str, FloatArray]:
    """Velocities of the body's point at the inertial origin, which is another one now."""
    turn = motion.rotation
    spin = turn @ body.angular_velocity
    velocity = turn @ body.velocity - np.cross(spin, motion.position)
    return {"velocity": _checks.freeze(velocity), "angular_velocity": _checks.freeze(spin)}


def _turned(given: Orientation, motion: Pose) -> Orientation:
    """A direction, or a function of points that returns directions, of a moved body."""
    turn, back = motion.rotation, motion.inverse()
    if given is None:
        return None
    if not callable(given):
        directed: FloatArray = turn @ np.asarray(given)
        return directed
    function: Callable[[FloatArray], Any] = given
    return lambda points: np.asarray(function(back.apply(points))) @ turn.T


def _carried(given: Any, motion: Pose) -> Any:
    """A value, or a function of points and perhaps the time, of a moved body."""
    if not callable(given):
        return given
    back = motion.inverse()
    return lambda points, *time: given(back.apply(points), *time)


def _moved_orientation(model: Model, beam: Beam, motion: Pose) -> Orientation:
    """Directions of e2 that turn with the beam.

    Frames without a given direction start from one in inertial axes: those that they have are kept.
    """
    from scipy.spatial import cKDTree

    turn, back = motion.rotation, motion.inverse()
    if beam.orientation is not None:
        return _turned(beam.orientation, motion)
    if np.array_equal(turn, np.eye(3)):
        return None
    points, second = _second_axes(model, beam)
    tree = cKDTree(points)
    return lambda at: second[tree.query(back.apply(at))[1]] @ turn.T


def _second_axes(model: Model, beam: Beam) -> tuple[FloatArray, FloatArray]:
    """Points (k, 3) along a beam and its e2 there (k, 3)."""
    if beam.formulation == "nurbs":
        frames = control_frames(model.curve(beam), None, beam.vectors)
        return frames[:, :3], frames[:, 3:].reshape(-1, 3, 3)[:, :, 1]
    assert model.mesh is not None
    cells = model.mesh.cells[model.beam_cells(beam)]
    frames = section_frames(model.mesh.points, cells, None)
    return model.mesh.points[cells].reshape(-1, 3), frames[..., 1].reshape(-1, 3)


def _moved_curve(curve: NurbsCurve, motion: Pose) -> NurbsCurve:
    return NurbsCurve(curve.degree, curve.knots, motion.apply(curve.points), curve.weights)


def _moved_lines(model: Model, motions: Mapping[str, Pose]) -> LineMesh:
    """The mesh of the beams; nodes of no beam stay."""
    mesh = model.mesh
    assert mesh is not None
    points = mesh.points.copy()
    for beam in model.beams:
        nodes = np.unique(mesh.cells[model.beam_cells(beam)])
        points[nodes] = motions[beam.name].apply(mesh.points[nodes])
    return LineMesh(points, mesh.cells, mesh.line_groups, mesh.point_groups)


def _moved_surface(model: Model, motions: Mapping[str, Pose]) -> SurfaceMesh:
    """The mesh of the shells; nodes of no shell stay."""
    mesh = model.surface
    assert mesh is not None
    points = mesh.points.copy()
    midpoints = None if mesh.midpoints is None else mesh.midpoints.copy()
    for shell in model.shells:
        motion, nodes = motions[shell.name], mesh.body_nodes(shell.body)
        points[nodes] = motion.apply(mesh.points[nodes])
        if midpoints is not None:
            rows = mesh.body_rows(shell.body)
            midpoints[rows] = motion.apply(midpoints[rows])
    return SurfaceMesh(points, mesh.triangles, mesh.bodies, mesh.lines, mesh.nodes, midpoints)
