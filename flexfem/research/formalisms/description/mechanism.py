# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declaration of mechanisms whose equations come from energies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._fields import ZERO, Array, ArrayOrNone, declared, instance, rotation, vector
from flexfem._types import BoolArray, FloatArray
from flexfem.research.formalisms.description.frame_motion import FrameMotion
from flexfem.research.formalisms.description.frames import Frame, PlanarFrame, SpatialFrame
from flexfem.research.formalisms.description.joints import AppliedForce, Constraint, End

__all__ = ["FORMALISMS", "EnergyBody", "Mechanism"]

#: Names of the formalisms.
FORMALISMS = ("lagrange", "gibbs_appell", "maggi", "hamilton")


def _first_section(x: FloatArray) -> BoolArray:
    """Nodes with the smallest first coordinate: a frame fixed to one end of a body."""
    first = x[:, 0].min()
    return np.asarray(x[:, 0] < first + 1e-9 * max(np.ptp(x[:, 0]), 1e-300))


@declared(eq=True)
class EnergyBody:
    """Elastic body in a floating frame, described by its energies.

    Args:
        name: of the body.
        matter: its material, see `flexfem.research.formalisms.description.matter`.
        frame: `PlanarFrame` or `SpatialFrame`.
        mesh: function of an MPI communicator that returns a DOLFINx mesh in local coordinates (m);
            it is called with a communicator of one process.
        held: function of the nodes' local coordinates (n, 3) that returns flags of the elastic
            coordinates that are fixed, (n,) for whole nodes or (n, components); they fix the frame
            to the body. None fixes the nodes with the smallest first coordinate.
        origin: start of the frame, m.
        rotation: of the frame at the start, 3x3; None for the inertial axes.
        velocity: of the origin at the start, m/s.
        angular_velocity: of the frame at the start, inertial axes, rad/s.
        motion: of the frame if it is prescribed, from ``origin`` and ``rotation`` on; velocities
            follow from it. None for a frame that moves freely under forces and joints.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a value is not admissible.
    """

    name: str
    matter: Any
    frame: Frame = instance((PlanarFrame, SpatialFrame))
    mesh: Callable[[Any], Any]
    held: Callable[[FloatArray], Any] | None = None
    origin: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)
    motion: FrameMotion | None = instance(FrameMotion, default=None)

    part_of: ClassVar[str] = "flexfem.research.Mechanism"

    def __post_init__(self) -> None:
        """Check the functions, and the frame's motion against its kind."""
        owner = _checks.named(self, self.name)
        for name in ("place", "inertia", "strain_energy"):
            if not hasattr(self.matter, name):
                raise TypeError(f"{owner}: matter has no '{name}', got {self.matter!r}")
        for what in ("mesh", "held"):
            value = getattr(self, what)
            if not callable(value) and (what == "mesh" or value is not None):
                raise TypeError(f"{owner}: {what} must be a function, got {value!r}")
        if self.motion is not None and (self.velocity.any() or self.angular_velocity.any()):
            raise ValueError(f"{owner}: its motion is prescribed, leave out its velocities")
        if isinstance(self.frame, PlanarFrame):
            flat = self.rotation[2, 2] > 1.0 - 1e-12
            still = not (self.velocity[2] or self.angular_velocity[:2].any() or self.origin[2])
            if not (flat and still):
                raise ValueError(f"{owner}: it starts out of the plane of its frame")

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the frame and their rates at the start."""
        if self.motion is not None:
            g, gd, _ = self.prescribed(0.0)
            return g, gd
        g = self.frame.start(self.origin, self.rotation)
        return g, self.frame.start_rates(g, self.velocity, self.angular_velocity)

    def prescribed(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates of a frame with prescribed motion, their rates and second rates at t."""
        assert self.motion is not None
        declared = self.frame.start(self.origin, self.rotation)
        return self.motion.coordinates(f'EnergyBody "{self.name}"', self.frame, declared, t)

    def holds(self, x: FloatArray) -> BoolArray:
        """Fixed elastic coordinates, (n, components), of nodes at x (n, 3).

        Raises:
            ValueError: the function of the user returns something else.
        """
        mask = np.asarray((self.held or _first_section)(x), dtype=bool)
        shape = (len(x), self.matter.components)
        if mask.shape == shape[:1]:
            mask = np.repeat(mask[:, None], shape[1], axis=1)
        if mask.shape != shape:
            raise ValueError(
                f'EnergyBody "{self.name}": held must return {shape[0]} or {shape[0]} x {shape[1]} '
                f"truth values, got shape {mask.shape}"
            )
        return mask


@dataclass(frozen=True, repr=False)
class Mechanism:
    """Bodies described by energies, joints and forces.

    Args:
        name: of the mechanism.
        bodies: see `EnergyBody`.
        joints: see `Constraint`.
        forces: see `AppliedForce`.
        gravity: acceleration, m/s^2.
        formalism: one of `FORMALISMS`, which sets up its equations of motion.
        observed: end whose position a simulation records; None for the last body's frame.
    """

    name: str
    bodies: Sequence[EnergyBody]
    joints: Sequence[Constraint] = ()
    forces: Sequence[AppliedForce] = ()
    gravity: Any = (0.0, 0.0, 0.0)
    formalism: str = "lagrange"
    observed: End | None = None

    drivers: ClassVar[dict[str, str]] = {
        "dynamics": "flexfem.research.formalisms.runs.comparison:simulate_mechanism"
    }

    def __repr__(self) -> str:
        """Return the name in messages."""
        return f'Mechanism "{self.name}"'

    def __str__(self) -> str:
        """Bodies, joints and forces, one a line."""
        gravity = ", ".join(f"{value:.5g}" for value in self.gravity)
        lines = [f"{self!r}, equations by {self.formalism}", f"  gravity ({gravity}) m/s^2"]
        lines.append(f"  bodies: {len(self.bodies)}")
        for body in self.bodies:
            what = f"{type(body.matter).__name__} in a {type(body.frame).__name__}"
            at = ", ".join(f"{value:.5g}" for value in body.origin)
            moved = ", its motion prescribed" if body.motion is not None else ""
            lines.append(f"    {body.name}  {what} at ({at}) m{moved}")
        for title, acting in (("joints", self.joints), ("forces", self.forces)):
            lines += [f"  {title}: {len(acting)}"] if acting else []
            for one in acting:
                lines.append(f"    {one.name}  {' - '.join(str(end) for end in one.ends)}")
        return "\n".join(lines)

    def validate(self) -> None:
        """Check that everything named exists, and that functions of time can be called.

        Raises:
            TypeError: something has the wrong type.
            ValueError: a name is unknown or used twice, the formalism is unknown, or a function
                fails at t = 0.
        """
        owner = _checks.named(self, self.name)
        if self.formalism not in FORMALISMS:
            raise ValueError(
                f"{owner}: formalism must be one of {', '.join(FORMALISMS)}, got {self.formalism!r}"
            )
        _checks.vector(owner, "gravity", self.gravity)
        if not self.bodies:
            raise ValueError(f"{owner}: it has no bodies")
        for body in self.bodies:
            _checks.instance(owner, "a body", body, EnergyBody)
        for joint in self.joints:
            _checks.instance(owner, "a joint", joint, Constraint)
        for force in self.forces:
            _checks.instance(owner, "a force", force, AppliedForce)
        acting: list[Constraint | AppliedForce] = [*self.joints, *self.forces]
        names = [body.name for body in self.bodies] + [one.name for one in acting]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f'{owner}: the name "{name}" is used twice')
        known = {body.name for body in self.bodies}
        ends = [(one.owner, end) for one in acting for end in one.ends]
        if self.observed is not None:
            ends.append((f"{owner}, observed", self.observed))
        for user, end in ends:
            if end.body not in known:
                raise ValueError(f'{user}: there is no body "{end.body}"')
        for body in self.bodies:
            if body.motion is not None:
                owner = f'EnergyBody "{body.name}"'
                _call(owner, body.prescribed)
                body.motion.check(owner, body.frame)
        for joint in self.joints:
            if joint.motion is not None:
                _call(joint.owner, joint.motion)
        for force in self.forces:
            _call(force.owner, force.force)


def _call(owner: str, function: Callable[[float], object]) -> None:
    """Call a function of time at the start, before anything is compiled on all ranks together.

    Raises:
        ValueError: it fails.
    """
    try:
        function(0.0)
    except FAILURES as error:
        raise ValueError(f"{owner}: {located(function, error)}") from error
