# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probes: what is recorded in the history at every step."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, noted
from flexfem._fields import Given, checked, declared, function
from flexfem._types import FloatArray
from flexfem.core.marker import OBSERVED, Observed
from flexfem.model.structure.structure import Structure


@dataclass(frozen=True, eq=False)
class MarkerState:
    """Motion of a marker at one instant, all in inertial axes.

    Axes at a node of a shell or of a :class:`UFLBody` are rotated with the elements around it at
    the end of each step, of shells with directors not about their normal; ``angular_velocity`` and
    ``angular_acceleration`` are nan there.

    Attributes:
        position: Shape (3,), metres.
        rotation: Marker axes to inertial axes, shape (3, 3).
        velocity: Shape (3,), m/s.
        angular_velocity: Shape (3,), rad/s.
        arc: Of a ``SlidingMarker``: arc length zeta from the carrier's start in the undeformed
            state, metres. The other attributes are those of the carrier's section there.
        arc_rate: Its time derivative, m/s.
        start: The rotation in the model as it was given, shape (3, 3); identity for a
            ``SlidingMarker``.
        acceleration: Shape (3,), m/s^2, as computed by the integrator at the time of the row, with
            vibrations that steps do not resolve; with ``energy_momentum`` it is a mean over the
            step; zero in statics, nan for a ``SlidingMarker``.
        angular_acceleration: Shape (3,), rad/s^2, in the same axes.
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    arc: float = 0.0
    arc_rate: float = 0.0
    start: FloatArray = field(default_factory=lambda: np.eye(3))
    acceleration: FloatArray = field(default_factory=lambda: np.zeros(3))
    angular_acceleration: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of_motions(
        cls, motions: FloatArray, starts: Iterable[FloatArray], arcs: Iterable[Sequence[float]]
    ) -> list[Self]:
        """States of several markers, whose arrays are parts of the given one.

        Args:
            motions: shape (n, 33), of each marker position, rotation row by row, velocity, spin,
                their rates, and :attr:`turn` row by row.
            starts: n of shape (3, 3), see the attribute.
            arcs: arc length and its rate of each marker.
        """
        found = []
        rotations, turns = motions[:, 3:12].reshape(-1, 3, 3), motions[:, 24:].reshape(-1, 3, 3)
        # to compare lengths, each array would be asked for more, which raises an error inside
        for start, (arc, rate), x, R, v, w, a, b, turn in zip(
            starts, arcs, motions[:, :3], rotations, motions[:, 12:15], motions[:, 15:18],
            motions[:, 18:21], motions[:, 21:24], turns, strict=False,
        ):  # fmt: skip
            state = object.__new__(cls)  # the constructor of frozen attributes takes longer
            own = state.__dict__
            own["position"] = x
            own["rotation"] = R
            own["velocity"] = v
            own["angular_velocity"] = w
            own["arc"] = arc
            own["arc_rate"] = rate
            own["start"] = start
            own["acceleration"] = a
            own["angular_acceleration"] = b
            own["turn"] = turn
            found.append(state)
        return found

    @cached_property
    def turn(self) -> FloatArray:
        """Rotation since the start in inertial axes, shape (3, 3), whatever the marker's axes."""
        return self.rotation @ self.start.T


class AnyProbe:
    """Base class of the probes that a model holds by name.

    Attributes:
        name: Unique name in the model.
        columns: Names of its columns in the history, unique in the model.
        unwrap: Columns that are angles (radians) and are made continuous along the history.
        markers: Markers whose motion it needs.
        smooth: True if its columns have derivatives.
    """

    smooth: ClassVar[bool] = False
    name: str
    columns: tuple[str, ...]
    unwrap: tuple[str, ...] = ()
    markers: tuple[Observed, ...] = ()

    @property
    def differentiable(self) -> tuple[str, ...]:
        """Columns that have derivatives, see :func:`flexfem.gradient`."""
        return self.columns if self.smooth else ()

    def check(self, model: Structure) -> None:
        """Check the names that the probe refers to.

        Raises:
            ValueError: The model has no such thing.
        """


def strings(owner: str, what: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return a checked tuple of names."""
    if isinstance(values, str):
        raise TypeError(f"{owner}: {what} must be a list of names, got {_checks.show(values)}")
    return tuple(_checks.text(owner, what, value) for value in values)


def check_columns(owner: str, columns: tuple[str, ...], unwrap: tuple[str, ...] = ()) -> None:
    """Raise for column names that cannot head the columns of a table."""
    if not columns:
        raise ValueError(f"{owner}: columns must hold at least one name, got none")
    for column in columns:
        if column == "t":
            raise ValueError(f'{owner}: column "t" is the time of the history')
        if "," in column:
            raise ValueError(f'{owner}: column "{column}" must not contain a comma')
        if columns.count(column) > 1:
            raise ValueError(f'{owner}: column "{column}" occurs twice')
    for column in unwrap:
        if column not in columns:
            raise ValueError(f'{owner}: unwrap "{column}" is none of its columns')


def name_columns(probe: Any, labels: Sequence[str]) -> None:
    """Give a probe, or a controller, the columns name_label.

    Raises:
        ValueError: The name is none for columns of a table.
    """
    columns = tuple(f"{probe.name}_{label}" for label in labels)
    check_columns(_checks.named(probe, probe.name), columns)
    _checks.assign(probe, columns=columns)


def observed(owner: str, what: str, value: Any) -> tuple[Observed, ...]:
    """Return checked markers, of one or several."""
    places = (value,) if isinstance(value, OBSERVED) else tuple(value)
    for marker in places:
        _checks.instance(owner, what, marker, OBSERVED)
    return places


#: Function of time and marker states that returns one number per column.
ProbeFunction = Callable[..., Sequence[float]]


@declared
class Probe(AnyProbe):
    """Columns of the history computed from the motion of markers.

    Attributes:
        name: Unique name in the model.
        markers: Markers whose states the function gets.
        columns: Names of the columns, unique in the model.
        function: `function(t, *states)` with time t (seconds) and one MarkerState per marker;
            returns one number per column.
        unwrap: Columns that are angles (radians) and are made continuous along the history.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: No columns, a column twice or named t, a name that would break the table, or an
            `unwrap` that is no column.
    """

    smooth: ClassVar[bool] = True
    name: str
    markers: Given[Observed | Sequence[Observed], tuple[Observed, ...]] = checked(observed)
    columns: Given[Sequence[str], tuple[str, ...]] = checked(strings)
    function: ProbeFunction = function()
    unwrap: Given[Sequence[str], tuple[str, ...]] = checked(strings, default=())

    def __post_init__(self) -> None:
        """Check the columns."""
        check_columns(_checks.named(self, self.name), self.columns, self.unwrap)

    def evaluate(self, t: float, states: Sequence[MarkerState]) -> FloatArray:
        """Return the values of the columns at time `t`, shape (number of columns,).

        In a run they are nan where the function fails.

        Raises:
            FunctionError: Outside of a run, where it fails or returns something else.
        """
        try:
            values = self.function(t, *states)
            return _checks.returned("function", values, (len(self.columns),))
        except FAILURES as error:
            noted(f'{type(self).__name__} "{self.name}"', self.function, error)
            return np.full(len(self.columns), np.nan)


class PositionProbe(Probe):
    """Inertial position of a marker in the columns name_x, name_y, name_z, metres."""

    def __init__(self, name: str, marker: Observed) -> None:
        """Create the probe.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: The name is empty or would break the table.
        """
        _checks.instance(_checks.named(self, name), "marker", marker, OBSERVED)
        super().__init__(name, marker, [f"{name}_{axis}" for axis in "xyz"], _position)


def _position(t: float, state: MarkerState) -> Sequence[float]:
    return state.position.tolist()  # type: ignore[no-any-return]
