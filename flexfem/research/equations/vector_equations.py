# SPDX-License-Identifier: LGPL-3.0-or-later
"""Systems that are equations of motion in a vector of coordinates, with or without multipliers.

Small systems, the same on every rank, that are no assembly of bodies and joints: theories of one
structure, formalisms to be compared. They go through the same command line, the same integrator
options and the same output folder as multibody models.

What a case builds is a *source* of such equations: NumPy data that ``validate()`` checks, and
whose ``equations(comm)`` does the expensive part when the run starts::

    class Pendulum:
        drivers = {"dynamics": DRIVER}

        def validate(self) -> None: ...

        def equations(self, comm) -> VectorEquations: ...
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from flexfem._types import FloatArray, IntArray
from flexfem.core.status import Status

__all__ = ["DRIVER", "Motion", "Picture", "Stepper", "VectorEquations"]

#: Module that integrates the motion of a source of equations.
DRIVER = "flexfem.research.equations.run.simulate:simulate_equations"


@dataclass(frozen=True, eq=False)
class Picture:
    """Mesh and fields at one instant, for a series of ParaView files.

    Attributes:
        points: (n, 3), m.
        cells: (k, nodes of a cell), numbers of points.
        cell_type: "vertex", "line", "triangle" or "quad".
        point_data, cell_data: arrays by name, (n, ...) and (k, ...).
    """

    points: FloatArray
    cells: IntArray
    cell_type: str
    point_data: Mapping[str, FloatArray] = field(default_factory=dict)
    cell_data: Mapping[str, FloatArray] = field(default_factory=dict)


class Motion:
    """State of the equations at one instant.

    Attributes:
        t: time, s.
        q: coordinates.
        v, a: velocities and accelerations, (n,).
        multipliers: (m,).
    """

    def __init__(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
    ) -> None:
        """Keep the arrays as they are."""
        self.t, self.q, self.v, self.a, self.multipliers = t, q, v, a, multipliers


class VectorEquations:
    """Base class: ``r(t, q, v, a) + G^T lambda = 0`` and ``Phi(t, q) = 0``.

    Coordinates are numbers that velocities are the derivatives of, unless :meth:`add` is
    overridden: then ``q`` may hold rotations, and ``v`` be the rates of the increments that
    :meth:`add` takes.

    Attributes:
        size: number n of equations, velocities and accelerations.
        multipliers: number m of constraints.
        linear: at a given time the equations are linear in all unknowns, so that one Newton
            iteration solves them.
        constant: they are linear, and their matrices do not depend on time either.
        columns: names of the columns of the history.
        angles: columns that are angles (rad) and are made continuous along the history.
        stepper: another scheme in time than generalized-alpha, None for that.
    """

    size: int
    multipliers: int = 0
    linear: bool = False
    constant: bool = False
    columns: Sequence[str]
    angles: Sequence[str] = ()
    stepper: "Stepper | None" = None

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates and velocities at t = 0."""
        raise NotImplementedError

    def residual(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
    ) -> FloatArray:
        """Dynamic equations, then constraints, (n + m,)."""
        raise NotImplementedError

    def tangent(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray,
        dv: float, da: float,
    ) -> Any:  # fmt: skip
        """Derivative of the residual, (n + m, n + m), an array or a SciPy sparse matrix.

        By the increment of the coordinates, where velocities grow ``dv`` (1/s) and accelerations
        ``da`` (1/s^2) times as much, then by the multipliers.
        """
        raise NotImplementedError

    def add(self, q: FloatArray, increment: FloatArray) -> FloatArray:
        """Coordinates after an increment (n,)."""
        return q + increment

    def observe(self, motion: Motion) -> Sequence[float]:
        """One number per column."""
        raise NotImplementedError

    def pictures(self, motion: Motion) -> Mapping[str, Picture]:
        """Return the pictures by the names of their series, which are the same at all instants."""
        return {}

    def summary(self) -> Mapping[str, Any]:
        """More entries of ``summary.json``."""
        return {}

    def identity(self) -> Mapping[str, str]:
        """Return the texts that a checkpoint must agree with, by the names of the compared data."""
        return {
            "equations": type(self).__name__,
            "unknowns": f"{self.size} + {self.multipliers}",
            "columns": ",".join(self.columns),
        }


class Stepper(Protocol):
    """A scheme in time for equations.

    Attributes:
        motion: the accepted state.
        counters: "newton_iterations", "factorizations" and "residual_evaluations" so far.
    """

    motion: Motion
    counters: dict[str, int]

    def begin(self, equations: VectorEquations, options: Any) -> Status:
        """Start consistently at t = 0; ``options`` are the ``RunOptions``.

        Raises:
            InputError: the start violates the constraints, or the options do not apply here.
        """

    def step(self, h: float) -> Status:
        """Advance by one step; the state is left as it was unless the status is OK."""

    def state(self) -> Mapping[str, FloatArray]:
        """All that the next step depends on."""

    def restore(
        self, equations: VectorEquations, options: Any, state: Mapping[str, FloatArray]
    ) -> None:
        """Continue from the return value of :meth:`state`."""
