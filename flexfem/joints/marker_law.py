# SPDX-License-Identifier: LGPL-3.0-or-later
"""Law of a `Force`: calls of the user's function with the motion of markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, located
from flexfem._types import FloatArray, IntArray
from flexfem.core.laws import ElementMotion, Ends
from flexfem.core.pose import Pose

if TYPE_CHECKING:
    from flexfem.joints.ufl_marker_law import UFLMarkerLaw

__all__ = ["MarkerLaw"]


@dataclass(frozen=True, eq=False)
class MarkerLaw:
    """The `ElementLaw` of a force; its rows are the components of wrenches in the markers' axes.

    They are those of forces alone if the law returns no moments and all its markers are at nodes.

    Attributes:
        owner: class and name of the force.
        function: its law.
        states: number of states of an element.
        explicit: True if the law is called at accepted states alone.
        size: number of markers of an element.
        start: (elements, states) states at the start.
        single: True if there is one element, whose states the law gets without a first dimension.
        parameters: numbers for the law; None if it takes none.
        compiled: True to have it compiled.
        jacobian: function of its derivatives, None for differences, "ufl" for a law in UFL.
    """

    owner: str
    function: Callable[..., Any]
    states: int
    explicit: bool
    size: int
    start: FloatArray
    single: bool
    parameters: FloatArray | None
    compiled: bool
    jacobian: Callable[..., Any] | str | None
    _numbers: dict[bytes, IntArray] = field(default_factory=dict)
    _kinds: list[int] = field(default_factory=list)
    _seen: list[tuple[IntArray, ElementMotion, Ends]] = field(default_factory=list)

    @property
    def kinds(self) -> int:
        """2: forces and moments; 1 if the law returned forces alone when it was first tried."""
        return self._kinds[0] if self._kinds else 2

    def place(self, *, at_nodes: bool) -> None:
        """See :meth:`ElementLaw.place`."""
        if not at_nodes:
            self._kinds[:] = [2]

    def initial(self, elements: IntArray) -> FloatArray:
        """See :meth:`ElementLaw.initial`."""
        return np.array(self.start[elements])

    def forces(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`ElementLaw.forces`."""
        ends = self._ends(elements, motion)
        found = self._called(self._law, elements, motion, ends, z)
        forces, moments, rates = self._parts(found, elements)
        if not self._kinds:
            self._kinds.append(1 if moments is None else 2)
        wrenches = np.zeros((len(forces), self.kinds, 3))
        wrenches[:, 0] = forces
        if moments is not None:
            if self.kinds == 1:
                raise ReturnError("law must return moments always or never, got None at the start")
            wrenches[:, 1] = moments
        self._loops.wrench_components(wrenches, ends.rotations)
        local = wrenches.reshape(len(elements), -1)
        return local, rates.reshape(len(elements), self.states)

    @cached_property
    def _loops(self) -> ModuleType:
        """Compiled loops, which declarations of models do not need."""
        from flexfem.kernels.users import marker_motion

        return marker_motion

    @cached_property
    def _law(self) -> Callable[..., Any]:
        """The function of arrays, compiled where this is wanted."""
        if self._symbolic is not None:
            return self._symbolic.law
        if not self.compiled:
            return self.function
        from flexfem.kernels.users.compiled_law import compiled_law

        return compiled_law(self.function)

    @cached_property
    def _symbolic(self) -> UFLMarkerLaw | None:
        """The law if it is written in UFL."""
        if self.jacobian != "ufl":
            return None
        from flexfem.joints.ufl_marker_law import UFLMarkerLaw

        count = None if self.parameters is None else self.parameters.shape[-1]
        return UFLMarkerLaw(self.function, self.size, self.states, count)

    @cached_property
    def _jacobian(self) -> Callable[..., Any] | None:
        """The function of derivatives; None for differences."""
        if self._symbolic is not None:
            return self._symbolic.jacobian
        return self.jacobian if callable(self.jacobian) else None

    def _called(
        self, function: Callable[..., Any], elements: IntArray, motion: ElementMotion, ends: Ends,
        z: FloatArray,
    ) -> Any:  # fmt: skip
        """What a function of (t, ends, z[, parameters]) returns for some elements."""
        given = z[0] if self.single else z
        if self.parameters is None:
            return function(motion.time, ends, given)
        own = self.parameters
        return function(motion.time, ends, given, own[elements] if own.ndim == 2 else own)

    def _ends(self, elements: IntArray, motion: ElementMotion) -> Ends:
        """Motion of the markers, of which the last one is kept: states change alone in between."""
        if self._seen and self._seen[0][0] is elements and self._seen[0][1] is motion:
            return self._seen[0][2]
        ends = self._inertial(elements, motion)
        self._seen[:] = [(elements, motion, ends)]
        return ends

    def _inertial(self, elements: IntArray, motion: ElementMotion) -> Ends:
        """Motion of the markers in inertial axes."""
        poses, twists = motion.poses.reshape(-1, 12), motion.twists.reshape(-1, 6)
        count = len(poses)
        positions, rotations = np.empty((count, 3)), np.empty((count, 9))
        rates = np.empty((2, count, 3))
        self._loops.inertial_motion(poses, twists, positions, rotations, rates)
        key = elements.tobytes()
        if key not in self._numbers:
            first = self.size * elements[:, np.newaxis]
            self._numbers[key] = (first + np.arange(self.size)).ravel()
        return Ends(
            positions, rotations.reshape(count, 3, 3), rates[0], rates[1], self._numbers[key]
        )

    def _parts(
        self, found: Any, elements: IntArray
    ) -> tuple[FloatArray, FloatArray | None, FloatArray]:
        """Forces (m, 3), moments and rates of states that the law has returned.

        Raises:
            ReturnError: it has returned something else.
        """
        markers, states = len(elements) * self.size, self.states
        parts = found if isinstance(found, tuple) else (found,)
        if len(parts) > 3 or (states and len(parts) < 3):
            wanted = "forces, moments and rates of states" if states else "forces, or moments too"
            raise ReturnError(f"law must return {wanted}, got {len(parts)} values")
        forces = _shaped("forces", parts[0], (markers, 3))
        given = parts[1] if len(parts) > 1 else None
        moments = None if given is None else _shaped("moments", given, (markers, 3))
        shape = (states,) if self.single else (len(elements), states)
        rates = _shaped("rates of states", parts[2], shape) if states else np.zeros(shape)
        return forces, moments, rates

    def tried(self, element: int, poses: Sequence[Pose], t: float) -> None:
        """Call the law, and the function of derivatives, for an element at rest.

        Raises:
            ValueError: one fails, or does not return finite numbers of the right shapes.
        """
        frames = [np.concatenate([pose.position, pose.rotation.ravel()]) for pose in poses]
        rest, elements = np.zeros((1, len(poses), 6)), np.array([element])
        motion = ElementMotion(t, np.array([frames]), rest)
        z, function, what = self.initial(elements), self.function, "law"
        try:
            values = [*self.forces(elements, motion, z)]
            if callable(self.jacobian):
                function, what = self.jacobian, "jacobian"
            values += (
                [found] if (found := self.derivatives(elements, motion, z)) is not None else []
            )
        except FAILURES as error:
            raise ValueError(f"{self.owner}: {what}: {located(function, error)}") from error
        for value in values:
            if not np.isfinite(value).all():
                raise ValueError(
                    f"{self.owner}: law must return finite numbers at the start, got "
                    f"{_checks.show(value.ravel().tolist())}"
                )

    def derivatives(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> FloatArray | None:
        """See :meth:`ElementLaw.derivatives`: those of the user's function in the markers' axes."""
        if self._jacobian is None:
            return None
        size, n, count = self.size, self.states, len(elements)
        ends = self._ends(elements, motion)
        found = self._called(self._jacobian, elements, motion, ends, z)
        given = _shaped("jacobian", found, (count, 6 * size + n, 12 * size + n))
        by = given[:, :, : 12 * size].reshape(count, 6 * size + n, size, 4, 3)
        R = ends.rotations.reshape(count, size, 3, 3)
        v, w = (x.reshape(count, size, 3) for x in (ends.velocities, ends.angular_velocities))
        # axes that rotate carry the velocities with them
        turned = by[:, :, :, 1] + np.cross(v[:, np.newaxis], by[:, :, :, 2])
        turned += np.cross(w[:, np.newaxis], by[:, :, :, 3])
        columns = np.stack([by[:, :, :, 0], turned, by[:, :, :, 2], by[:, :, :, 3]], axis=2)
        local = np.einsum("erqmj,emji->erqmi", columns, R)
        place, rate = (
            np.moveaxis(local[:, :, k : k + 2], 2, 3).reshape(count, -1, 6 * size) for k in (0, 2)
        )
        out = np.concatenate([place, rate, given[:, :, 12 * size :]], axis=2)
        wrenches = out[:, : 6 * size].reshape(count, size, 2, 3, -1)
        out[:, : 6 * size] = -np.einsum("emji,emqjc->emqic", R, wrenches).reshape(
            count, 6 * size, -1
        )
        forces = self.forces(elements, motion, z)[0].reshape(count, size, -1, 3)
        kinds = forces.shape[2]
        for m in range(size):
            for q in range(kinds):
                at = slice(6 * m + 3 * q, 6 * m + 3 * q + 3)
                # a force fixed in inertial axes rotates in those of its marker
                out[:, at, 6 * m + 3 : 6 * m + 6] -= np.cross(
                    forces[:, m, q, np.newaxis], np.eye(3)
                )
        own = np.arange(6 * size).reshape(size, 2, 3)[:, :kinds].ravel()
        return out[:, np.append(own, 6 * size + np.arange(n))]


def _shaped(what: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Numbers of a shape that a function has returned.

    Raises:
        ReturnError: it has returned something else.
    """
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.shape == shape:
        return value
    try:
        values = _checks.numbers(value)
    except (TypeError, ValueError):
        raise ReturnError(
            f"law must return numbers, got {_checks.show(value)} for {what}"
        ) from None
    if values.shape != shape:
        raise ReturnError(f"law must return {what} of the shape {shape}, got {values.shape}")
    return values
