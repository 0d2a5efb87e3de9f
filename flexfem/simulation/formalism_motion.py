# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of a mechanism by one formalism, or by several side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.equations import Equations, FieldSeries, Motion, Stepper
from flexfem.core.status import Status
from flexfem.formalisms.equations import MechanismEquations
from flexfem.formalisms.motion import FormalismMotion
from flexfem.integrators.hamilton_midpoint import HamiltonMidpoint
from flexfem.integrators.maggi_alpha import MaggiAlpha
from flexfem.integrators.vector_alpha import VectorAlpha
from flexfem.io.vtu_series import VtuSeries

__all__ = ["BodyPictures", "DrawnMotion", "SideBySide"]

#: Scheme in time of each formalism.
_SCHEMES: dict[str, Callable[[], Stepper]] = {
    "lagrange": VectorAlpha, "gibbs_appell": VectorAlpha, "maggi": MaggiAlpha,
    "hamilton": HamiltonMidpoint,
}  # fmt: skip
_VTK = {"interval": "line", "triangle": "triangle", "tetrahedron": "tetra"}


class BodyPictures(FieldSeries):
    """Series ``bodies_<cells>`` of the deformed bodies, one for each type of cell.

    Point data: ``displacement`` from the start, m. Cell data: ``body``, its number.
    """

    def __init__(
        self, model: MechanismEquations, start: FloatArray, folder: Path, comm: MPI.Comm,
        resume: float | None,
    ) -> None:  # fmt: skip
        """Open the series (collective); the first rank writes."""
        self._comm = comm
        self._series: dict[str, VtuSeries] = {}
        self._parts: dict[str, list[Any]] = {}
        for number, nodes in enumerate(model.nodes.values()):
            kind = _VTK[nodes.body.matter.cell]
            if kind not in self._series:
                self._series[kind] = VtuSeries(folder, f"bodies_{kind}", comm, resume=resume)
                self._parts[kind] = []
            corners = nodes.points.shape[1] // 3
            cells = np.asarray(nodes.space.dofmap.list)[:, :corners]
            used, local = np.unique(cells, return_inverse=True)
            self._parts[kind].append((number, nodes, used, local.reshape(cells.shape)))
        self._start = start

    def write(self, t: float, step: int, motion: Motion) -> None:
        """See :class:`flexfem.core.equations.FieldSeries`."""
        for kind, series in self._series.items():
            points, moved, cells, bodies, first = [], [], [], [], 0
            for number, nodes, used, local in self._parts[kind]:
                points.append(nodes.positions(motion.q)[used])
                moved.append(points[-1] - nodes.positions(self._start)[used])
                cells.append(local + first)
                bodies.append(np.full(len(local), number, dtype=np.int32))
                first += len(used)
            own = slice(None) if self._comm.rank == 0 else slice(0)
            series.write(
                t, step, np.concatenate(points)[own], np.concatenate(cells)[own], kind,
                {"displacement": np.concatenate(moved)[own]}, {"body": np.concatenate(bodies)[own]},
            )  # fmt: skip

    def close(self) -> None:
        """See :class:`flexfem.core.equations.FieldSeries`."""
        for series in self._series.values():
            series.close()


class DrawnMotion(FormalismMotion):
    """Equations of a mechanism with the scheme of their formalism and pictures of the bodies."""

    def __init__(self, model: MechanismEquations, formalism: str) -> None:
        """Bring the declared state to the constraints."""
        super().__init__(model, formalism)
        self.stepper = _SCHEMES[formalism]()

    def fields(self, folder: Path, comm: Any, resume: float | None) -> BodyPictures:
        """See :class:`flexfem.core.equations.Equations`."""
        return BodyPictures(self.model, self.start()[0], folder, comm, resume)


class SideBySide(Equations):
    """The same mechanism by several formalisms, advanced with the same steps.

    Columns are those of each formalism with its name before them; pictures are of the first.

    Attributes:
        motions: of the formalisms.
    """

    def __init__(self, model: MechanismEquations, formalisms: Sequence[str]) -> None:
        """Bring the declared state to the constraints."""
        self.motions = [DrawnMotion(model, name) for name in formalisms]
        sizes = [motion.summary() for motion in self.motions]
        self.size = sum(size["unknowns"] for size in sizes)
        self.multipliers = sum(size["multipliers"] for size in sizes)
        self.columns = [f"{m.formalism}_{name}" for m in self.motions for name in m.columns]
        self._together = _Together(self.motions)
        self.stepper = cast(Stepper, self._together)

    def start(self) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.core.equations.Equations`."""
        return self.motions[0].start()

    def observe(self, motion: Motion) -> Sequence[float]:
        """See :class:`flexfem.core.equations.Equations`."""
        pairs = zip(self.motions, self._together.steppers, strict=True)
        return [value for own, stepper in pairs for value in own.observe(stepper.motion)]

    def fields(self, folder: Path, comm: Any, resume: float | None) -> BodyPictures:
        """See :class:`flexfem.core.equations.Equations`."""
        return self.motions[0].fields(folder, comm, resume)

    def summary(self) -> Mapping[str, Any]:
        """See :class:`flexfem.core.equations.Equations`."""
        names = [motion.formalism for motion in self.motions]
        seconds = self._together.seconds.tolist()
        return {"wall_seconds_of_formalisms": dict(zip(names, seconds, strict=True))}

    def identity(self) -> Mapping[str, str]:
        """See :class:`flexfem.core.equations.Equations`."""
        return {**super().identity(), "mechanism": self.motions[0].model.mechanism.name}


class _Together:
    """Schemes of several formalisms as one.

    Attributes:
        steppers: one for each formalism.
        seconds: wall time of the accepted steps of each.
    """

    def __init__(self, motions: Sequence[DrawnMotion]) -> None:
        self._motions = motions
        self.steppers: list[Stepper] = [motion.stepper for motion in motions]  # type: ignore[misc]
        self.seconds = np.zeros(len(motions))

    @property
    def motion(self) -> Motion:
        """Accepted state of the first."""
        return self.steppers[0].motion

    @property
    def counters(self) -> dict[str, int]:
        """Sums over all."""
        names = self.steppers[0].counters
        return {name: sum(s.counters[name] for s in self.steppers) for name in names}

    def begin(self, equations: Equations, options: Any) -> Status:
        """See :class:`flexfem.core.equations.Stepper`."""
        self._options = options
        for motion, stepper in zip(self._motions, self.steppers, strict=True):
            status = stepper.begin(motion, options)
            if status is not Status.OK:
                return status
        return Status.OK

    def step(self, h: float) -> Status:
        """See :class:`flexfem.core.equations.Stepper`; all advance, or none does."""
        before = [(s, s.state()) for s in self.steppers]
        for k, (stepper, _) in enumerate(before):
            begin = time.perf_counter()
            status = stepper.step(h)
            self.seconds[k] += time.perf_counter() - begin
            if status is not Status.OK:
                for (done, state), motion in zip(before[:k], self._motions, strict=False):
                    done.restore(motion, self._options, state)
                return status
            stepper.motion.t = self.steppers[0].motion.t
        return Status.OK

    def state(self) -> Mapping[str, FloatArray]:
        """See :class:`flexfem.core.equations.Stepper`."""
        pairs = zip(self._motions, self.steppers, strict=True)
        return {f"{m.formalism}_{k}": v for m, s in pairs for k, v in s.state().items()}

    def restore(self, equations: Equations, options: Any, state: Mapping[str, FloatArray]) -> None:
        """See :class:`flexfem.core.equations.Stepper`."""
        self._options = options
        for motion, stepper in zip(self._motions, self.steppers, strict=True):
            start = f"{motion.formalism}_"
            own = {k.removeprefix(start): v for k, v in state.items() if k.startswith(start)}
            stepper.restore(motion, options, own)
