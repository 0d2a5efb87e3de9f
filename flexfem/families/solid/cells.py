# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of solids of one law and kind on a rank: constant data, kernels and their calls."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, nan
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._checks import returned_number
from flexfem._faults import FAILURES, ReturnError, noted
from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.families.solid.forms import FIELDS, PAIRS, CellKind, SolidForms
from flexfem.families.solid.meshes.lagrange import (
    lattice,
    quadrature_weights,
    reference_points,
    shapes,
)
from flexfem.kernels.driver import CellKernel, Cells, Nodal, add_forces, cell_kernel, evaluate
from flexfem.kernels.ffcx import Kernel, compile_kernel
from flexfem.kernels.records import Float2D, Memory, Record

__all__ = ["CHUNK", "Kernels", "Motion", "SolidCells", "TimedParameter", "still"]

_NOTHING = np.zeros(1)
#: Iterations for the stretches across in plane stress, and their last change.
_THINNINGS, _THINNED = 40, 1e-13
#: Cells whose matrices are computed together.
CHUNK = 2048
#: Forms that are linear in steps, and the names of their columns.
_LINEAR = {
    "action": "column", "moments_action": "moments_column", "duals_action": "duals_column",
    "pulls_action": "pulls_column", "stiffening": "stiffening_column",
    "last_action": "last_column",
}  # fmt: skip
#: Time of the differences of parameters, s.
_MOMENT = 1e-6


class Motion(Record):
    """Positions, velocities and steps of both (n, 3) of nodes, inertial axes.

    The other positions are those at the start of a step, and at both ends of the step before.
    """

    points: Float2D
    velocity: Float2D
    step: Float2D
    rate: Float2D
    start: Float2D
    before: Float2D
    last: Float2D


#: Arrays of :class:`Motion` of the forms' coefficients.
_NODAL = {
    "position": "points", "velocity": "velocity", "step": "step", "rate": "rate",
    "_start": "start", "_before": "before", "_last": "last",
}  # fmt: skip


@dataclass(frozen=True)
class Kernels:
    """Kernels of a law in cells of a kind.

    Attributes:
        calls: by the names of the forms; columns are those of actions, for steps of sections.
        columns: first column and number of columns of the data of cells, by name.
        damped: True if there are viscous forces.
        dilatation: number of functions of the dilatation.
        fields: number of functions of each field.
        initial: (z,) internal variables of a point at the start.
        rate_dependent: True if internal variables change with time alone.
        comm: communicator; forms: that the kernels are made of.
    """

    calls: Mapping[str, CellKernel]
    columns: Mapping[str, tuple[int, int]]
    damped: bool
    dilatation: int
    fields: int
    initial: FloatArray
    rate_dependent: bool
    comm: MPI.Intracomm
    forms: SolidForms

    @classmethod
    def compiled(
        cls, comm: MPI.Intracomm, forms: SolidForms, without: Collection[str] = ()
    ) -> Kernels:
        """Compile the forms of a law (collective), ``without`` some of them."""
        law, kind = forms.law, forms.kind
        dilatation = _functions(kind.dilatation, kind.cell)
        averaged = _functions(kind.degree - 1, kind.cell)
        results = {"energy": 1, "fields": averaged * sum(FIELDS.values())}
        nodal = 3 * _functions(kind.degree, kind.cell)
        results |= dict.fromkeys(("force", "action"), nodal)
        if dilatation:
            results |= dict.fromkeys(
                ("moments", "duals", "moments_action", "duals_action"), dilatation
            )
        if kind.plane == "stress":
            scalars = forms.coefficients["stretch"].ufl_element().dim
            results |= {"pulls": scalars, "pulls_action": scalars}
        if forms.damped:
            results |= {"resistance": nodal, "loss": 1}
        if len(law.initial):
            results["advanced"] = forms.coefficients["history"].ufl_element().dim
        results = {name: size for name, size in results.items() if name not in without}
        columns, first = dict[str, tuple[int, int]](), 0
        for name, field in forms.coefficients.items():
            if name not in _NODAL:
                columns[name] = first, field.ufl_element().dim
                first += field.ufl_element().dim
        calls = _calls(comm, forms, results, columns)
        return cls(
            calls, columns, forms.damped, dilatation, averaged, law.initial, law.rate_dependent,
            comm, forms,
        )  # fmt: skip

    @cached_property
    def continuing(self) -> Mapping[str, CellKernel]:
        """Kernels of stresses that are continued along steps (collective the first time)."""
        kind, stresses = self.forms.kind, self.forms.coefficients["excess"].ufl_element().dim
        results = {"stresses": stresses, "stresses_action": stresses}
        results["stiffening"] = 3 * _functions(kind.degree, kind.cell)
        return _calls(self.comm, self.forms, results, self.columns)

    @cached_property
    def remembering(self) -> Mapping[str, CellKernel]:
        """Kernels of derivatives by internal variables (collective the first time)."""
        kind, count = self.forms.kind, self.forms.coefficients["history"].ufl_element().dim
        nodes = 3 * _functions(kind.degree, kind.cell)
        results = dict.fromkeys(
            ("advanced_action", "advanced_by_history", "power_by_history"), count
        )
        results |= dict.fromkeys(("force_action_of_history", "advanced_by_positions"), nodes)
        return _calls(self.comm, self.forms, results, self.columns)

    @cached_property
    def lasting(self) -> Mapping[str, CellKernel]:
        """Kernels of derivatives by the last step (collective the first time)."""
        count = 3 * _functions(self.forms.kind.degree, self.forms.kind.cell)
        return _calls(self.comm, self.forms, {"last_action": count}, self.columns)


def _functions(degree: int, cell: str) -> int:
    """Number of polynomials of a degree in a cell, 0 for a negative one."""
    return len(lattice(cell, degree)) if degree > 0 else int(degree == 0)


def _calls(
    comm: MPI.Intracomm, forms: SolidForms, results: Mapping[str, int],
    columns: Mapping[str, tuple[int, int]],
) -> dict[str, CellKernel]:  # fmt: skip
    """Kernels of forms with these numbers of results, by name (collective).

    Those that are linear in steps are also called "column", for steps of sections.
    """
    names, count = list(forms.coefficients), _functions(forms.kind.degree, forms.kind.cell)
    few = _functions(forms.kind.dilatation, forms.kind.cell)
    nodal = {name: (Nodal.POSITION, Motion.word(_NODAL[name])) for name in names if name in _NODAL}
    steps = {"step": (0, 3 * count), "rate": (3 * count, 3 * count)}
    if few:
        steps["dilatation_step"] = 6 * count, few
        steps["multiplier_step"] = 6 * count + few, few
    if "stretch" in forms.coefficients:
        steps["stretch_step"] = 6 * count, forms.coefficients["stretch"].ufl_element().dim
    still = {name: place for name, place in nodal.items() if name not in steps}
    calls = {}
    for name, size in results.items():
        fields = tuple(forms.coefficients.values())
        kernel: Kernel = compile_kernel(comm, getattr(forms, name), fields, batched=True)
        calls[name] = cell_kernel(kernel, size, names, nodal, columns)
        if name in _LINEAR:
            held = {of: place for of, place in columns.items() if of not in steps}
            calls[_LINEAR[name]] = cell_kernel(kernel, size, names, still, held, steps)
    return calls


@dataclass(frozen=True)
class TimedParameter:
    """Parameter of some cells that changes with time.

    Attributes:
        owner: solid and parameter for messages.
        name: of the parameter.
        rows: the cells.
        function: of time, s.
    """

    owner: str
    name: str
    rows: slice
    function: Callable[[float], float]

    def at(self, t: float) -> float:
        """Value at a time, s; nan in a run where the function fails."""
        try:
            value = returned_number(self.name, self.function(t))
            if isfinite(value):
                return value
            raise ReturnError(f"{self.name} is {value} at t = {t:.6g} s")
        except FAILURES as error:
            noted(self.owner, self.function, error)
            return nan


class SolidCells:
    """Cells of this rank with one law in one kind of cells.

    Attributes:
        kernels: of the law.
        nodes: (m, k) local nodes.
        mass: (m, k, k) products of shape functions with the density, kg.
        size: (m,) volumes at the start, m^3.
        body: (m,) number of the body.
        number: (m,) number of the cell in the family.
        timed: parameters that change with time.
        rest_moduli: (m, 2) shear and bulk modulus at small strains, Pa.
    """

    timed: Sequence[TimedParameter] = ()
    rest_moduli: FloatArray

    def __init__(
        self, kernels: Kernels, kind: CellKind, nodes: IndexArray, places: FloatArray,
        thickness: FloatArray, parameters: Mapping[str, FloatArray], body: IntArray,
        number: IntArray,
    ) -> None:  # fmt: skip
        """Prepare the data of the cells.

        Args:
            kernels: of the law.
            kind: of the cells.
            nodes: (m, k) local nodes.
            places: (m, g, 3) nodes of the geometry, m.
            thickness: (m,) of plane bodies, m; ones.
            parameters: (m, 1) or (m, 3) by name.
            body: see the attribute.
            number: see the attribute.
        """
        self.kernels, self.kind, self.nodes = kernels, kind, nodes
        self.body, self.number, self._places = body, number, places
        width = sum(count for _, count in kernels.columns.values())
        self._own = np.zeros((len(nodes), width))
        sides = self._sides(places, shapes(kind.cell, max(kind.geometry, 1), self._corners)[1])
        self._start = np.linalg.det(sides)
        d = kind.dimension
        if kind.geometry == 0:
            jacobians = sides[:, 0, :d, :d]
            self.data("inverse")[:] = np.linalg.inv(jacobians).reshape(-1, d * d)
            self.data("size")[:, 0] = thickness * np.linalg.det(jacobians)
        else:
            self.data("place")[:] = places.reshape(len(nodes), 3 * places.shape[1])
            self.data("size")[:, 0] = thickness
        for name, values in parameters.items():
            self.data(name)[:] = values
        self._weights, self._stiffened = quadrature_weights(kind.cell, kind.quadrature), False
        if kind.plane == "stress":
            self.data("stretch")[:] = 1.0
        if len(kernels.initial):
            self.data("history")[:] = np.tile(kernels.initial, len(self._weights))
        self._gradients = self._mean_gradients()
        self._plain = self._cells(self._own)

    def data(self, name: str) -> FloatArray:
        """Columns (m, c) of the data of the cells, to be written."""
        first, count = self.kernels.columns[name]
        return self._own[:, first : first + count]

    def _cells(self, own: FloatArray, first: int = 0, sections: FloatArray | None = None) -> Cells:
        """Cells from the first one in the format of the kernel driver."""
        count = len(own)
        corners = np.zeros((len(self._corners), 3))
        corners[:, : self.kind.dimension] = self._corners
        nodes = np.ascontiguousarray(self.nodes[first : first + count])
        return Cells(
            nodes=nodes, turned=np.zeros(count, dtype=np.bool_),
            turns=np.zeros((1, nodes.shape[1], 9)), own=own,
            section=np.zeros(count, dtype=np.int64),
            sections=np.empty((1, 0)) if sections is None else sections,
            corners=corners.reshape(1, -1),
        )  # fmt: skip

    @property
    def _corners(self) -> FloatArray:
        """Corners (c, d) of the reference cell."""
        return reference_points(self.kind.cell, 1)

    def _sides(self, places: FloatArray, gradients: FloatArray) -> FloatArray:
        """Derivatives (m, q, 3, 3) of places (m, k, 3), a unit normal last of plane ones."""
        sides = np.zeros((len(places), len(gradients), 3, 3))
        d = gradients.shape[2]
        sides[..., :d] = np.einsum("qkd,mka->mqad", gradients, places, optimize=True)
        sides[..., 2, d:] = 1.0
        return sides

    def _mean_gradients(self) -> FloatArray:
        """Derivatives (m, k, 3) of the shape functions by the places, in the middle of the cell."""
        kind, middle = self.kind, self._corners.mean(axis=0)[np.newaxis]
        own = shapes(kind.cell, kind.degree, middle)[1][0]
        sides = self._sides(self._places, shapes(kind.cell, max(kind.geometry, 1), middle)[1])
        inverse = np.linalg.inv(sides[:, 0])[:, : kind.dimension]
        found: FloatArray = np.einsum("kd,mda->mka", own, inverse, optimize=True)
        return found

    def with_masses(self, density: FloatArray, lumped: BoolArray) -> SolidCells:
        """Compute masses, volumes and what projects onto functions of the cells (collective).

        Args:
            density: (m,) kg/m^3.
            lumped: (m,) True for diagonal masses.
        """
        products = self._products("Lagrange", self.kind.degree)
        self.size: FloatArray = products.sum(axis=(1, 2))
        self.mass: FloatArray = density[:, np.newaxis, np.newaxis] * products
        diagonal = np.einsum("mii->mi", products)[lumped]
        diagonal = diagonal * (density * self.size)[lumped, np.newaxis]
        diagonal /= np.einsum("mii->m", products)[lumped, np.newaxis]
        self.mass[lumped] = diagonal[:, :, np.newaxis] * np.eye(self.nodes.shape[1])
        own = self._products("DG", self.kind.degree - 1)
        self._averages, self._parts = np.linalg.inv(own), own.sum(axis=2)
        if len(self.kernels.initial):
            self._volumes = self._tabulated(self.kernels.forms.volumes, len(self._weights))
        if self.kernels.dilatation:
            own = self._products("DG", self.kind.dilatation)
            self._projection = np.linalg.inv(own)
        return self

    def _products(self, family: str, degree: int) -> FloatArray:
        """Products (m, j, j) of functions of a degree."""
        count = _functions(degree, self.kind.cell)
        form = self.kernels.forms.products(family, degree)
        return self._tabulated(form, count**2).reshape(-1, count, count)

    def _tabulated(self, form: Any, size: int) -> FloatArray:
        """Results (m, s) of a form of the geometry alone (collective)."""
        kernels = self.kernels
        coefficients = kernels.forms.coefficients
        kernel = compile_kernel(kernels.comm, form, tuple(coefficients.values()), batched=True)
        call = cell_kernel(kernel, size, coefficients, {}, kernels.columns)
        return self._evaluated(call, self._plain, still(np.zeros((1, 3))))

    def _evaluated(self, call: CellKernel, cells: Cells, motion: Memory) -> FloatArray:
        """Results (m, s) of a kernel."""
        out = np.empty((len(cells.nodes), call.size))
        evaluate(call.memory, cells.memory, motion, _NOTHING, out)
        return out

    def _projected(self, values: FloatArray, first: int = 0) -> FloatArray:
        own = self._projection[first : first + len(values)]
        found: FloatArray = np.einsum("mij,mj->mi", own, values)
        return found

    def settle(self, motion: Memory, continued: FloatArray | None = None) -> None:
        """Set dilatation and multiplier for the positions, or continued ones with stresses."""
        self._stiffened = continued is not None
        if not len(self.nodes):
            return
        few = self.kernels.dilatation
        if self.kind.plane == "stress":
            self._thin(motion)
        if few:
            calls = self.kernels.calls
            if continued is None:
                dilatation = self._projected(self._evaluated(calls["moments"], self._plain, motion))
            else:
                dilatation = continued[:, :few]
            self.data("dilatation")[:] = dilatation
            duals = self._evaluated(calls["duals"], self._plain, motion)
            self.data("multiplier")[:] = self._projected(duals)
        if continued is not None:
            self.data("excess")[:] = continued[:, few:] - self._stresses("stresses", motion)

    def _thin(self, motion: Memory) -> None:
        """Find the stretches across for which the stresses there are zero, by Newton's method.

        Where that fails they are NaN, and so are the forces.
        """
        stretch, ones = self.data("stretch"), np.zeros((1, 6 * self.nodes.shape[1]))
        stretch[~np.isfinite(stretch).all(axis=1)] = 1.0
        cells = self._cells(self._own, 0, np.hstack([ones, np.ones((1, stretch.shape[1]))]))
        for _ in range(_THINNINGS):
            pulls = self._evaluated(self.kernels.calls["pulls"], self._plain, motion)
            slopes = self._evaluated(self.kernels.calls["pulls_column"], cells, motion)
            self._slopes = slopes
            with np.errstate(divide="ignore", invalid="ignore"):
                change = np.where(pulls == 0.0, 0.0, pulls / slopes)
            stretch -= np.clip(change, -stretch, 0.5 * stretch)
            if not (np.abs(change) > _THINNED * stretch).any():
                break
        else:
            stretch[(np.abs(change) > _THINNED * stretch).any(axis=1)] = np.nan

    def _thinned(self, motion: Memory) -> None:
        """Set the steps of the stretches across to those that follow from the steps of nodes."""
        if self.kind.plane == "stress" and len(self.nodes):
            self.data("stretch_step")[:] = 0.0
            pulls = self._evaluated(self.kernels.calls["pulls_action"], self._plain, motion)
            self.data("stretch_step")[:] = -pulls / self._slopes

    def continued(self, motion: Memory) -> FloatArray:
        """Dilatation and stresses (m, s) of settled cells continued along the steps."""
        calls, dilatation = self.kernels.calls, np.empty((len(self.nodes), 0))
        if self.kernels.dilatation and len(self.nodes):
            moved = self._evaluated(calls["moments_action"], self._plain, motion)
            self.data("dilatation_step")[:] = self._projected(moved)
            dilatation = self.data("dilatation") + self.data("dilatation_step")
        self._thinned(motion)
        stresses = self._stresses("stresses", motion) + self._stresses("stresses_action", motion)
        return np.hstack([dilatation, stresses])

    def _stresses(self, name: str, motion: Memory) -> FloatArray:
        """Stresses (m, 6 q) at the points of the quadrature, or their change."""
        values = self._evaluated(self.kernels.continuing[name], self._plain, motion)
        return values / np.repeat(self._weights, len(PAIRS))

    def energies(self, motion: Memory) -> FloatArray:
        """Energies (m,), J; of settled cells."""
        return self._evaluated(self.kernels.calls["energy"], self._plain, motion)[:, 0]

    def energy_at(self, points: FloatArray) -> float:
        """Energy of all cells at positions (n, 3), J."""
        motion = still(points)
        self.settle(motion)
        return float(self.energies(motion).sum())

    def force_at(self, points: FloatArray) -> FloatArray:
        """Elastic forces on the nodes (n, 3) at positions, N."""
        motion, forces = still(points), np.zeros_like(points)
        self.settle(motion)
        self.add_forces(motion, forces)
        return forces

    def set_time(self, t: float, span: float) -> bool:
        """Set parameters at a time and the time of the step, s; True if something depends on it."""
        self._set_parameters(t)
        if len(self.kernels.initial):
            self.data("span")[:] = span
        return len(self.kernels.initial) + len(self.timed) > 0

    def _set_parameters(self, t: float) -> None:
        for one in self.timed:
            self.data(one.name)[one.rows] = one.at(t)

    def powers(self, t: float, motion: Memory) -> FloatArray:
        """Rates (m,) of the energies by the change of parameters with time alone, W."""
        if not self.timed:
            return np.zeros(len(self.nodes))
        low, high = max(t - _MOMENT, 0.0), t + _MOMENT  # functions have no time before the start
        energies = []
        for at in (low, high):
            self._set_parameters(at)
            energies.append(self.energies(motion))
        self._set_parameters(t)
        rates: FloatArray = (energies[1] - energies[0]) / (high - low)
        return rates

    def advance(self, motion: Memory) -> None:
        """Take the internal variables at the end of the step, and end it."""
        if len(self.kernels.initial) and len(self.nodes):
            self.data("history")[:] = self.advanced(motion)
            self.data("span")[:] = 0.0

    def advanced(self, motion: Memory) -> FloatArray:
        """Internal variables (m, z q) at the end of the step."""
        values = self._evaluated(self.kernels.calls["advanced"], self._plain, motion)
        return values / self._point_weights

    @property
    def _point_weights(self) -> FloatArray:
        """(z q,) weight of the point of each internal variable."""
        weights: FloatArray = np.repeat(self._weights, len(self.kernels.initial))
        return weights

    def advanced_along(self, motion: Memory, change: FloatArray) -> FloatArray:
        """Their change (m, z q) by that at the beginning and along the steps of positions."""
        self.data("history_step")[:] = change
        call = self.kernels.remembering["advanced_action"]
        return self._evaluated(call, self._plain, motion) / self._point_weights

    def add_advanced_factors(self, motion: Memory, factors: FloatArray, target: FloatArray) -> None:
        """Add derivatives of their sum with factors (m, z q) by positions to nodes (n, 3)."""
        self.data("history_step")[:] = factors / self._point_weights
        call = self.kernels.remembering["advanced_by_positions"]
        add_forces(call.memory, self._plain.memory, motion, _NOTHING, 1.0, target)

    def advanced_factors(self, motion: Memory, factors: FloatArray) -> FloatArray:
        """The same derivatives (m, z q) by the internal variables at the beginning."""
        self.data("history_step")[:] = factors / self._point_weights
        call = self.kernels.remembering["advanced_by_history"]
        return self._evaluated(call, self._plain, motion)

    def add_forces_of_history(self, motion: Memory, change: FloatArray, target: FloatArray) -> None:
        """Add the change of the forces by that of the internal variables to nodes (n, 3)."""
        self.data("history_step")[:] = change
        call = self.kernels.remembering["force_action_of_history"]
        add_forces(call.memory, self._plain.memory, motion, _NOTHING, 1.0, target)

    def powers_of_history(self, motion: Memory) -> FloatArray:
        """Derivatives (m, z q) of the work of the forces on the steps by internal variables."""
        return self._evaluated(self.kernels.remembering["power_by_history"], self._plain, motion)

    @property
    def lost(self) -> FloatArray:
        """Energies (m,) that the internal variables have dissipated, J."""
        if not len(self.kernels.initial):
            return np.zeros(len(self.nodes))
        count, points = len(self.kernels.initial), len(self._weights)
        own = self.data("history").reshape(len(self.nodes), points, count)[:, :, -1]
        found: FloatArray = (own * self._volumes).sum(axis=1)
        return found

    def resistance(self, motion: Memory) -> FloatArray:
        """Viscous forces (m k, 3) on the nodes of the cells, N."""
        found = self._evaluated(self.kernels.calls["resistance"], self._plain, motion)
        return found.reshape(-1, 3)

    def add_forces(self, motion: Memory, target: FloatArray) -> None:
        """Add elastic and viscous forces to nodes (n, 3), N; of settled cells."""
        add_forces(
            self.kernels.calls["force"].memory, self._plain.memory, motion, _NOTHING, 1.0, target
        )

    def add_action(self, motion: Memory, factor: float, target: FloatArray) -> None:
        """Add a factor times the change of the forces along the steps; of settled cells."""
        calls = self.kernels.calls
        if self.kernels.dilatation and len(self.nodes):
            moved = self._evaluated(calls["moments_action"], self._plain, motion)
            self.data("dilatation_step")[:] = self._projected(moved)
            duals = self._evaluated(calls["duals_action"], self._plain, motion)
            self.data("multiplier_step")[:] = self._projected(duals)
        self._thinned(motion)
        add_forces(calls["action"].memory, self._plain.memory, motion, _NOTHING, factor, target)
        if self._stiffened:
            self.add_stiffening(motion, factor, target)

    def add_stiffening(self, motion: Memory, factor: float, target: FloatArray) -> None:
        """Add a factor times the change of the forces of excess stresses along the steps."""
        call = self.kernels.continuing["stiffening"]
        add_forces(call.memory, self._plain.memory, motion, _NOTHING, factor, target)

    def matrices(self, motion: Memory, first: int, stiffness: float, damping: float) -> FloatArray:
        """``stiffness K + damping C`` (r, 3 k, 3 k) of some cells from the first one.

        Column after column, as changes of the forces along unit steps: these cost about what a
        kernel of whole matrices does, whose compilation takes five times as long.
        """
        own = self._own[first : first + CHUNK].copy()
        width, thin = 3 * self.nodes.shape[1], self.kind.plane == "stress"
        fields = self._slopes.shape[1] if thin else 2 * self.kernels.dilatation
        # behind the steps of the nodes those of fields in the cells, which follow from them
        steps = np.zeros((width + fields, 2 * width + fields))
        steps[:width, :width] = stiffness * np.eye(width)
        steps[:width, width : 2 * width] = damping * np.eye(width)
        steps[width:, 2 * width :] = np.eye(fields)
        cells, nodal = (self._cells(own, first, rows) for rows in (steps, steps[:width]))
        every = self._columns(self.kernels.calls["column"], cells, motion)
        found, by_fields = np.split(every, [width], axis=2)
        if thin:
            pulls = self._columns(self.kernels.calls["pulls_column"], nodal, motion)
            slopes = self._slopes[first : first + len(own), :, np.newaxis]
            found = found - by_fields @ (pulls / slopes)
        elif fields:
            by_multiplier = stiffness * by_fields[:, :, self.kernels.dilatation :]
            found = found + by_fields @ self._dilated(cells, motion, first, by_multiplier)
        if self._stiffened:
            call = self.kernels.continuing["stiffening_column"]
            found = found + self._columns(call, nodal, motion)
        return found

    def _dilated(
        self, cells: Cells, motion: Memory, first: int, by_multiplier: FloatArray
    ) -> FloatArray:
        """Changes (r, 2 s, 3 k) of dilatation and multiplier along the steps of nodes."""
        width, few = 3 * self.nodes.shape[1], self.kernels.dilatation
        duals = self._columns(self.kernels.calls["duals_column"], cells, motion)
        by_steps, by_dilatation = duals[:, :, :width], duals[:, :, width : width + few]
        inverse = self._projection[first : first + len(cells.nodes)]
        theta = inverse @ self._swelling(cells, motion, by_multiplier)
        return np.concatenate([theta, inverse @ (by_steps + by_dilatation @ theta)], axis=1)

    def _swelling(self, cells: Cells, motion: Memory, by_multiplier: FloatArray) -> FloatArray:
        """Changes (r, s, 3 k) of the moments along the steps of nodes, the first of the sections.

        They are also those of the forces by the multiplier (r, 3 k, s).
        """
        return np.swapaxes(by_multiplier, 1, 2)

    def _columns(self, call: CellKernel, cells: Cells, motion: Memory) -> FloatArray:
        """Results (r, s, c) of a kernel along the steps of all sections."""
        out = np.empty((len(cells.nodes), call.size, len(cells.sections)))
        for column in range(out.shape[2]):
            cells.section[:] = column
            out[:, :, column] = self._evaluated(call, cells, motion)
        return out

    def chunks(self) -> Sequence[int]:
        """First cells of those whose matrices are computed together."""
        return range(0, len(self.nodes), CHUNK)

    def fields(self, motion: Memory) -> FloatArray:
        """Fields (m, j, 13) at the nodes of degree p - 1; see ``forms.FIELDS``."""
        values = self._evaluated(self.kernels.calls["fields"], self._plain, motion)
        own = values.reshape(len(values), self.kernels.fields, sum(FIELDS.values()))
        found: FloatArray = np.einsum("mij,mjc->mic", self._averages, own)
        return found

    def means(self, fields: FloatArray, chosen: IntArray) -> FloatArray:
        """Means (c, 13) over the volumes of some cells (c,) of their fields (c, j, 13)."""
        parts = self._parts[chosen] / self.size[chosen, np.newaxis]
        found: FloatArray = np.einsum("mj,mjc->mc", parts, fields)
        return found

    def deformations(self, points: FloatArray) -> FloatArray:
        """Deformation gradients (m, 3, 3) in the middle of the cells."""
        F: FloatArray = np.einsum(
            "mka,mkb->mab", points[self.nodes], self._gradients, optimize=True
        )
        if self.kind.dimension == 2:
            F[:, 2, 2] = 1.0
        return F

    def stretches(self, points: FloatArray) -> FloatArray:
        """Least change of volume J (m,) at the corners of the cells."""
        gradients = shapes(self.kind.cell, self.kind.degree, self._corners)[1]
        now = np.linalg.det(self._sides(points[self.nodes], gradients))
        ratio: FloatArray = (now / self._start).min(axis=1)
        return ratio


def still(points: FloatArray) -> Memory:
    """Positions (n, 3) of nodes at rest."""
    rest = np.zeros_like(points)
    memory: Memory = Motion(
        points=np.ascontiguousarray(points),
        velocity=rest,
        step=rest,
        rate=rest,
        start=rest,
        before=rest,
        last=rest,
    ).memory
    return memory
