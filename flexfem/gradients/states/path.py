# SPDX-License-Identifier: LGPL-3.0-or-later
"""The path of equilibria to be differentiated: the states of all rows of its history."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.analyses.statics import StaticOptions
from flexfem.core.status import Status
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import equations_at
from flexfem.gradients.motion.support import check_alike
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.neighbours import check_path_independent, place
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.model import Model
from flexfem.options import target_values
from flexfem.simulation.equilibria.equilibrium import rest
from flexfem.simulation.equilibria.targets import LOAD
from flexfem.simulation.run.setup import set_up
from flexfem.simulation.statics import StaticSteps
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.statics.equilibrium import Equilibrium, Limits, Snapshot
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import Shifts, System

__all__ = ["Direction", "Equilibria", "NearPath"]

#: Largest Newton step at the end of each load step of a path that is differentiated.
TOLERANCE = 1e-10


@dataclass(frozen=True)
class _Record:
    """State of a row: snapshot, continuous angles of joints, places of sliders with theirs."""

    snapshot: Snapshot
    angles: FloatArray
    places: FloatArray
    line_angles: FloatArray


@dataclass(frozen=True)
class Direction:
    """Change of an equilibrium with a parameter.

    Attributes:
        blocks: (n_owned, width) local twists of each block.
        multipliers: (r,) of all rows of this rank, scaled.
    """

    blocks: BlockVectors
    multipliers: FloatArray


class Equilibria:
    """Equilibria under increasing loads with their states.

    Attributes:
        system, equilibrium: at the last equilibrium, or the one that was returned to.
        recorder: of the columns of the history.
        columns: names of these.
        history: columns by name, on the first rank; the others have none.
        times: (n,) load factors of all rows.
    """

    def __init__(self, model: Model, options: StaticOptions, comm: MPI.Intracomm) -> None:
        """Compute the path (collective).

        Raises:
            InputError: a mistake in the model, or something that has no derivatives.
            StoppedError: a load step failed.
        """
        _check_options(options)
        self.options = replace(
            options, tolerance=min(options.tolerance, TOLERANCE), output=None, quiet=True
        )
        steps = StaticSteps(model, self.options, comm, None)
        self.serial, self.system = steps.serial, steps.system
        self.equilibrium = steps.equilibrium
        check_path_independent(model, self.system)
        self._records: list[_Record] = []
        self._run(steps)
        self.recorder = ProbeRecorder(self.system, self.serial, depth=1)
        self.columns = self.recorder.columns
        self.history: Mapping[str, FloatArray] = steps.recorder.history()
        self.times = np.array([one.snapshot.t for one in self._records])

    def _run(self, steps: StaticSteps) -> None:
        status, at = steps.status, "at the start"
        if status is Status.OK:
            steps.record_start()
            self._keep()
            steps.begin()
        while status is Status.OK and not steps.done:
            status = steps.take(lambda: False)
            at = f"after {steps.at}"
            self._keep()
        steps.recorder.close()
        if status is not Status.OK:
            raise StoppedError(f"gradient: no equilibrium was found {at}: {status.value}")

    def _keep(self) -> None:
        """Store the present equilibrium."""
        rows = self.system.constraints
        places = rows.lines.accepted_places(), rows.lines.angles.copy()
        self._records.append(_Record(self.equilibrium.keep(), rows.angles.copy(), *places))

    @property
    def model(self) -> Model:
        """The model with its probes."""
        return self.serial.model

    @property
    def accepted(self) -> None:
        """None: the forces of rows are the multipliers."""
        return None

    @property
    def rows(self) -> int:
        """Number of equilibria."""
        return len(self._records)

    @property
    def fixed(self) -> BoolArray:
        """(n,) rows with load factors that depend on no parameter.

        Those of steps along the path do, and that at which a column has its value.
        """
        found = np.full(self.rows, self.options.arc_length == 0.0)
        found[0], found[-1] = True, self.stop is None
        return found

    @property
    def stop(self) -> str | None:
        """Column at whose value the path ends; None if it ends at a load factor."""
        return None if self.options.stop_column == "none" else self.options.stop_column

    def by_load(self) -> FloatArray:
        """This rank's part of the derivative of the equations by the load factor (collective).

        At the present state.
        """
        END_POINT.evaluate(self.system, self.shifts)
        return self.vector(*self.equilibrium.loading.derivative(self.shifts))

    def columns_at(self, t: float) -> FloatArray:
        """Columns at the present state as if the load factor were another one (collective).

        On the first rank; the others have none.
        """
        return _columns(self.recorder, t)

    @property
    def shifts(self) -> Shifts:
        """Factors of the equations, with the scale of their residuals."""
        return self.equilibrium.shifts

    @property
    def size(self) -> int:
        """Size of this rank's part of a vector, see :meth:`vector`."""
        blocks: int = sum(part.block.sizes[0] for part in self.system.parts)
        return blocks + int(self.system.constraints.owned_count)

    def go_to(self, row: int) -> None:
        """Return to the equilibrium of a row of the history (collective)."""
        record = self._records[row]
        self.equilibrium.restore(record.snapshot)
        rows = self.system.constraints
        rows.angles[:] = record.angles
        rows.lines.restore_places(record.places)
        rows.lines.angles[:] = record.line_angles
        self.system.interface.update()

    def vector(self, blocks: BlockVectors, values: FloatArray) -> FloatArray:
        """This rank's part of a vector: the blocks one after the other, then its own rows.

        Args:
            blocks: (n_owned, width) of each block.
            values: (r,) of all rows of this rank.
        """
        parts = [
            part.block.hold(own.copy()).ravel()
            for part, own in zip(self.system.parts, blocks, strict=True)
        ]
        return np.concatenate([*parts, values[self.system.constraints.owned_rows]])

    def assemble(self) -> TangentSolver:
        """The solver with the exact matrix at the present state, not factorised (collective)."""
        END_POINT.evaluate(self.system, self.shifts)
        self.equilibrium.assemble()
        return self.equilibrium.tangent

    def matrix(self) -> PETSc.Mat:
        """The exact matrix at the present state in one piece (collective)."""
        return self.assemble().matrix.convert("aij", PETSc.Mat())

    def residual(self) -> FloatArray:
        """This rank's part of the equations at the present state, scaled (collective)."""
        return self.vector(*equations_at(self.system, self.shifts))

    def tangent(self) -> TangentSolver:
        """Solver with the exact matrix at the present state (collective).

        Raises:
            StoppedError: it is singular.
        """
        tangent = TangentSolver(self.system)
        END_POINT.evaluate(self.system, self.shifts)
        tangent.assemble(self.shifts)
        self.system.counters.factorizations += 1
        if not tangent.factor():
            raise StoppedError(SINGULAR)
        return tangent

    def direction(
        self, tangent: TangentSolver, blocks: BlockVectors, values: FloatArray
    ) -> Direction:
        """Change of the present equilibrium for that of its equations (collective).

        Args:
            tangent: solver with the matrix there.
            blocks: (n_owned, width) of each block.
            values: (r,) of all rows of this rank.

        Raises:
            StoppedError: the equations are singular.
        """
        if not tangent.solve(blocks, values):
            raise StoppedError(SINGULAR)
        steps = [-part.block.owned_step for part in self.system.parts]
        return Direction(steps, -tangent.multiplier_step)


#: Message of equilibria without derivatives.
SINGULAR = (
    "gradient: the equations of an equilibrium are singular: something can move without stiffness, "
    "or it is a critical point"
)


class NearPath:
    """A neighbour of the model, at equilibria of the path or beside them.

    Attributes:
        system, serial, equilibrium: those of the neighbour.
    """

    def __init__(self, path: Equilibria, model: Model, name: str) -> None:
        """Build it (collective).

        Args:
            path: the path.
            model: the neighbour.
            name: of the parameter in which it differs.
        """
        self._path, self._name, options = path, name, path.options
        check_alike(path.model, model, name)
        self.serial: NumberedModel
        self.system: System
        self.serial, self.system = set_up(
            model, path.system.comm, options.split_above, kernels=options.kernels
        )
        self.equilibrium: Equilibrium = rest(
            self.serial, self.system, TangentSolver(self.system), Limits(),
            span=options.t_end, grow=True, gravity_grows=options.gravity_load == "proportional",
            stabilise=False,
        )  # fmt: skip
        self.recorder = ProbeRecorder(self.system, self.serial, depth=1)

    def go_to_present(self) -> None:
        """Take over the present equilibrium of the path (collective)."""
        path, base = self._path, self._path.system
        place(base, self.system, self._name)
        self.system.constraints.multipliers[:] = base.constraints.multipliers
        self.equilibrium.loading.set(path.equilibrium.loading.t)

    def residual(self) -> tuple[BlockVectors, FloatArray]:
        """Equations of blocks and of all rows (r,) of this rank, scaled as the path's (collective).

        At the state to which the neighbour was brought.
        """
        return equations_at(self.system, self._path.shifts)

    def move(self, direction: Direction, factor: float) -> None:
        """Move along a multiple of the change of the equilibrium (collective)."""
        for part, steps in zip(self.system.parts, direction.blocks, strict=True):
            part.block.owned_step[:] = steps
        self.equilibrium.move(factor, direction.multipliers, 0.0)
        self.equilibrium.strains = self.system.present
        self.system.interface.update()

    def assemble(self) -> TangentSolver:
        """The solver with the exact matrix, scaled as that of the path (collective)."""
        END_POINT.evaluate(self.system, self._path.shifts)
        self.equilibrium.tangent.assemble(self._path.shifts)
        return self.equilibrium.tangent

    def columns(self) -> FloatArray:
        """Columns of the history, on the first rank; the others have none (collective)."""
        rows = self.system.constraints
        rows.forces[:] = rows.multipliers / self._path.shifts.scale
        return _columns(self.recorder, self._path.equilibrium.loading.t)


def _columns(recorder: ProbeRecorder, t: float) -> FloatArray:
    """Columns at a time, on the first rank; the others have none (collective)."""
    recorder.record(t)
    for _, values in recorder.flush():
        return values
    return np.zeros(0)


def _check_options(options: StaticOptions) -> None:
    """Refuse linear solutions, and options by which rows are those of critical points or columns.

    Raises:
        InputError: naming the option.
    """
    for name in ("linear", "critical_points", "branch", "restart"):
        given = getattr(options, name)
        if given != getattr(StaticOptions, name):
            raise InputError(
                f"gradient: equilibria with {name} {given!r} have no derivatives yet; take load "
                "steps"
            )
    for name in target_values(options.output_at):
        if name != LOAD:
            raise InputError(
                f"gradient: output_at names the column {name}, at whose values load factors depend "
                "on parameters; name load factors"
            )
