# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced data of an elastic body in a floating frame of reference.

A point of the body, at rest at r in the body's axes, is at ``r + sum_j Phi_j(r) eta_j`` when the
body is deformed. The coordinates eta are, interface by interface, its displacement and its
rotation from rest (small, body axes), then the amplitudes of internal functions, which leave all
interfaces where they are. Rigid motions are therefore among them if there is an interface.
All integrals over the body that its equations of motion contain are combinations of the constant
ones kept here (inertia shape integrals; Shabana 2013, Dynamics of Multibody Systems, chapter 5).

Needs NumPy only: the reduction of meshes is in the other modules of this package.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NoReturn

import numpy as np

from flexfem import _checks
from flexfem._fields import Array, declared, vector
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.reduction.body_line import BodyLine
from flexfem.reduction.elastic_polynomial import ElasticPolynomial
from flexfem.reduction.law_expansion import COUNT, cauchy_stress

__all__ = ["Interface", "Recovery", "ReducedBody", "interface_motions"]

#: Largest relative deviation from exact conditions that counts as round-off. What a direct solver
#: leaves for a slender body is near 1e-9; a wrong sign or unit makes a deviation near one.
_ROUND_OFF = 1e-5
#: Ratio of masses of motions of an interface that is round-off: that of displacements is 1e-10.
_NO_MASS = 1e-20


@declared
class Interface:
    """Frame that is tied to a region of the body, and at rest has the body's axes.

    Attributes:
        name: unique name in the body.
        position: (3,) of the frame at rest, body axes, m.

    Raises:
        TypeError: one of them has the wrong type.
        ValueError: the name is empty, or the position is not three finite numbers.
    """

    name: str
    position: Array = vector()


def interface_motions(interfaces: Sequence[Interface], held: BoolArray) -> FloatArray:
    """(6 k, 6) coordinates of interfaces in unit displacements along and rotations about the axes.

    Rows of fixed coordinates are zero.
    """
    motions = np.zeros((6 * len(interfaces), 6))
    for i, interface in enumerate(interfaces):
        x, y, z = interface.position
        rows = motions[6 * i : 6 * i + 6]
        rows[:] = np.eye(6)
        rows[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    motions[held] = 0.0
    return motions


@dataclass(frozen=True, eq=False)
class Recovery:
    """This rank's part of the surface for pictures, and its displacement per coordinate.

    Attributes:
        points: (p, 3) at rest, body axes, m.
        cells: (t, 3) triangles or (t, 2) lines, as indices of points.
        displacement: (p, 3, n) displacement of the points per coordinate, in nonlinear bodies also
            per product of rotations, see ``ElasticPolynomial``.
        stress: (t, 6, n) mean stress xx, yy, zz, yz, xz, xy of the cells per coordinate, Pa; None
            if the body has none.
        gradient: (t, 9, n) mean displacement gradient of the cells, rows of ``grad u``, per
            function: of nonlinear bodies in the place of the stress.
        law: derivatives of their energy at rest, see ``law_expansion``, Pa.
    """

    points: FloatArray
    cells: IntArray
    displacement: FloatArray
    stress: FloatArray | None = None
    gradient: FloatArray | None = None
    law: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the arrays against each other.

        Raises:
            TypeError: an array does not consist of numbers.
            ValueError: shapes that do not belong together, values that are not finite, or cells
                of points that there are not.
        """
        points = _checks.array("Recovery", "points", self.points, (-1, 3))
        corners = np.shape(self.cells)[-1] if np.ndim(self.cells) == 2 else 0
        if corners not in (2, 3):
            raise ValueError(
                f"Recovery: cells must be triangles or lines, got {_checks.show(self.cells)}"
            )
        cells = _checks.indices("Recovery", "cells", self.cells, len(points), corners)
        moves = _checks.array("Recovery", "displacement", self.displacement, (len(points), 3, -1))
        stress = self.stress
        if stress is not None:
            shape = (len(cells), 6, moves.shape[2])
            stress = _checks.array("Recovery", "stress", stress, shape)
        gradient, law = self.gradient, self.law
        if gradient is not None:
            shape = (len(cells), 9, moves.shape[2])
            gradient = _checks.array("Recovery", "gradient", gradient, shape)
            law = _checks.array("Recovery", "law", law, (COUNT,))
        _checks.assign(
            self,
            points=points,
            cells=_checks.freeze(cells.reshape(-1, corners), np.int64),
            displacement=moves,
            stress=stress,
            gradient=gradient,
            law=law,
        )

    def stresses(self, strains: FloatArray) -> FloatArray:
        """Mean stresses (t, 6) of the cells, Pa, in the axes of the frame; zeros if there are none.

        Args:
            strains: (n,) coordinates without motions that cause no stress.
        """
        if self.gradient is not None and self.law is not None:
            return cauchy_stress(self.law, self.gradient @ strains)
        if self.stress is None:
            return np.zeros((len(self.cells), 6))
        linear: FloatArray = self.stress @ strains
        return linear


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """Elastic body with n = 6 k + m coordinates, k interfaces and m internal functions.

    Equal on all ranks, save the recovery.

    Attributes:
        interfaces: frames that joints, loads and probes attach to; there may be none.
        mass: kg.
        moments: (3, n+1) integrals of rho r (column 0) and rho Phi_j (column j); kg m, kg.
        products: (3, 3, n+1, n+1); [a, b, i, j] is the integral of rho Phi_ia Phi_jb, Phi_0 = r.
        stiffness: (n, n), of the coordinates.
        damping: (n, n), of the coordinates' rates.
        held: (6 k,) interface coordinates that the body does not have, those out of the plane of
            a plane mesh: zero in all other arrays, to be locked.
        frequencies: (m,) angular frequencies of the body in its internal functions, that is with
            all interfaces at rest, ascending, rad/s.
        acceleration_stiffness: (12, n, n) stiffness by unit fields of acceleration with which the
            frame moves: 3 that are uniform, e_a, then 9 that are linear, r_b e_a at 3 + 3 a + b;
            minus the geometric stiffness of the stress under the body force rho times the field,
            all interfaces clamped (without any: the force less its rigid part). [a, i, j] is the
            work of this force on the displacement of second order that belongs to eta_i eta_j
            (Wallrapp and Schwertassek 1991); None if not requested.
        interface_stiffness: (6 k, n, n) geometric stiffness of the stress by a unit of each
            interface coordinate; None if not requested.
        recovery: data for pictures; None if not requested.
        lines: lines of the body by name, on which sliders run (``Carrier``).
        polynomial: nonlinear elastic forces in the coordinates without the first interface's; None
            of linear bodies.
    """

    interfaces: tuple[Interface, ...]
    mass: float
    moments: FloatArray
    products: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    held: BoolArray
    frequencies: FloatArray
    acceleration_stiffness: FloatArray | None = None
    interface_stiffness: FloatArray | None = None
    recovery: Recovery | None = None
    lines: Mapping[str, BodyLine] = field(default_factory=dict)
    polynomial: ElasticPolynomial | None = None

    part_of: ClassVar[str] = "FloatingBody"

    def __post_init__(self) -> None:
        """Check the data against each other.

        Raises:
            TypeError: a field has the wrong type.
            ValueError: shapes that do not belong together, values that are not finite, matrices
                that are not symmetric or not definite, rigid motions that cost energy, or held
                coordinates that move something.
        """
        owner = "ReducedBody"
        interfaces = tuple(self.interfaces)
        for interface in interfaces:
            _checks.instance(owner, "interface", interface, Interface)
        names = [interface.name for interface in interfaces]
        if len(set(names)) < len(names):
            raise ValueError(f"{owner}: names of interfaces must differ, got {names}")
        frequencies = _checks.array(owner, "frequencies", self.frequencies, (-1,))
        k, n = len(interfaces), 6 * len(interfaces) + len(frequencies)
        shapes: dict[str, tuple[int, ...]] = {
            "moments": (3, n + 1),
            "products": (3, 3, n + 1, n + 1),
            "stiffness": (n, n),
            "damping": (n, n),
            "acceleration_stiffness": (12, n, n),
            "interface_stiffness": (6 * k, n, n),
        }
        fields: dict[str, object] = {
            name: _checks.array(owner, name, value, shape)
            for name, shape in shapes.items()
            if (value := getattr(self, name)) is not None or shape[0] == 3 or len(shape) == 2
        }
        held = np.asarray(self.held)
        if held.dtype != np.bool_ or held.shape != (6 * k,):
            raise ValueError(
                f"{owner}: held must hold {6 * k} truth values, got {_checks.show(self.held)}"
            )
        fields |= {
            "interfaces": interfaces,
            "frequencies": frequencies,
            "mass": _checks.number(owner, "mass", self.mass, positive=True),
            "held": _checks.freeze(held, np.bool_),
        }
        _checks.assign(self, **fields)
        self._check_recovery()
        self._check_lines()
        self._check_polynomial()
        self._check_symmetry()
        self._check_held()
        self._check_rigid_motions()

    def __repr__(self) -> str:
        """Mass, interfaces and modes in one line; its arrays are long."""
        names = ", ".join(interface.name for interface in self.interfaces) or "none"
        highest = f" up to {self.frequencies[-1]:.5g} rad/s" if self.modes else ""
        return f"ReducedBody({self.mass:.5g} kg; interfaces: {names}; modes: {self.modes}{highest})"

    @property
    def size(self) -> int:
        """Number of coordinates, n."""
        return len(self.stiffness)

    @property
    def functions(self) -> int:
        """Number of functions in pictures: of the coordinates, then of products of rotations."""
        return self.size + (0 if self.polynomial is None else 6 * self.polynomial.turning)

    @property
    def modes(self) -> int:
        """Number of internal functions, m."""
        return len(self.frequencies)

    @property
    def mass_matrix(self) -> FloatArray:
        """(n, n) mass matrix of the coordinates while the body's frame is at rest."""
        matrix: FloatArray = np.einsum("aaij->ij", self.products[:, :, 1:, 1:])
        return matrix

    @property
    def mass_centre(self) -> FloatArray:
        """(3,) at rest, body axes, m."""
        return self.moments[:, 0] / self.mass

    @property
    def inertia(self) -> FloatArray:
        """(3, 3) inertia tensor at rest about the origin of the body's axes, kg m^2."""
        second = self.products[:, :, 0, 0]
        tensor: FloatArray = np.trace(second) * np.eye(3) - second
        return tensor

    @property
    def rigid_motions(self) -> FloatArray:
        """(n, 6) coordinates of unit displacements along and unit rotations about the axes.

        Zero without interfaces, and in rows of fixed coordinates.
        """
        motions = np.zeros((self.size, 6))
        motions[: len(self.held)] = interface_motions(self.interfaces, self.held)
        return motions

    @property
    def free_rigid_motions(self) -> BoolArray:
        """(6,) rigid motions without fixed coordinates; those of a plane are three."""
        if not self.interfaces:
            return np.zeros(6, dtype=np.bool_)
        free: BoolArray = ~self.held.reshape(-1, 6).any(axis=0)
        return free

    def interface(self, name: str) -> int:
        """Index of the interface of this name.

        Raises:
            ValueError: there is none.
        """
        names = [interface.name for interface in self.interfaces]
        if name not in names:
            raise ValueError(
                f"ReducedBody: no interface {_checks.show(name)}; there are "
                f"{', '.join(names) or 'none'}"
            )
        return names.index(name)

    def _check_recovery(self) -> None:
        if self.recovery is None:
            return
        _checks.instance("ReducedBody", "recovery", self.recovery, Recovery)
        count = self.recovery.displacement.shape[2]
        if count != self.functions:
            raise ValueError(
                f"ReducedBody: recovery must have {self.functions} functions, got {count}"
            )

    def _check_lines(self) -> None:
        _checks.instance("ReducedBody", "lines", self.lines, Mapping)
        for name, line in self.lines.items():
            _checks.text("ReducedBody", "name of a line", name)
            _checks.instance("ReducedBody", f'line "{name}"', line, BodyLine)
            count = line.displacement.shape[2]
            if count != self.functions:
                raise ValueError(
                    f'ReducedBody: line "{name}" must have {self.functions} functions, got {count}'
                )

    def _check_polynomial(self) -> None:
        if self.polynomial is None:
            return
        _checks.instance("ReducedBody", "polynomial", self.polynomial, ElasticPolynomial)
        turning, count = max(len(self.interfaces) - 1, 0), self.size - min(6, len(self.held))
        found = self.polynomial.turning, self.polynomial.size
        if found != (turning, count):
            raise ValueError(
                f"ReducedBody: polynomial must have {count} coordinates and {turning} interfaces "
                f"that turn, got {found[1]} and {found[0]}"
            )
        # at a right angle about an axis all that moves is the product of rotations of this axis
        own = np.diagonal(self.mass_matrix)[: len(self.held)].reshape(-1, 6)[1:, 3:]
        least = self.polynomial.turned_masses[:, [0, 3, 5]].min(axis=1, initial=np.inf)
        every = zip(self.interfaces[1:], least, own.max(axis=1, initial=0.0), strict=True)
        for interface, mass, rotating in every:
            if not mass > _NO_MASS * rotating:
                raise ValueError(
                    f'ReducedBody: interface "{interface.name}" has no inertia where it is turned '
                    "by a right angle; reduce the body once more"
                )

    def _check_symmetry(self) -> None:
        whole = self.products.transpose(0, 2, 1, 3).reshape(3 * (self.size + 1), -1)
        matrices = {"products": whole, "stiffness": self.stiffness, "damping": self.damping}
        for name, matrix in matrices.items():
            diagonal = np.diagonal(matrix)
            alone = np.abs(matrix[diagonal <= 0.0]).max(initial=0.0)
            if alone > _ROUND_OFF * diagonal.max(initial=0.0):
                _refuse(name, "positive semidefinite", f"a diagonal is {diagonal.min():.3g}")
            scale = _diagonal_scale(matrix)
            scaled = scale[:, None] * matrix * scale
            _check_small(name, "symmetric", scaled - scaled.T, 1.0)
            try:  # all diagonals are scaled to one
                np.linalg.cholesky(scaled + _ROUND_OFF * np.eye(len(scaled)))
            except np.linalg.LinAlgError:
                smallest = float(np.linalg.eigvalsh(scaled)[0])
                _refuse(name, "positive semidefinite", f"its smallest eigenvalue is {smallest:.3g}")
        for name in ("acceleration_stiffness", "interface_stiffness"):
            stack = getattr(self, name)
            if stack is not None:
                size = float(np.abs(stack).max(initial=0.0))
                _check_small(name, "symmetric", stack - stack.swapaxes(1, 2), size)

    def _check_held(self) -> None:
        rows = np.flatnonzero(self.held)
        if not len(rows):
            return
        values = {
            "moments": self.moments[:, 1 + rows],
            "products": self.products[:, :, 1 + rows],
            "stiffness": self.stiffness[rows],
            "damping": self.damping[rows],
        }
        for name, value in values.items():
            if value.any():
                _refuse(name, "zero for held coordinates", f"it is {np.abs(value).max():.3g}")

    def _check_rigid_motions(self) -> None:
        """Rigid motions, where all interfaces have them, cost no energy and move all masses."""
        free = np.flatnonzero(self.free_rigid_motions)
        rigid = self.rigid_motions[:, free]
        scale = _diagonal_scale(self.stiffness)[:, None]
        force = scale * (self.stiffness @ rigid)
        size = np.abs(rigid / np.where(scale > 0.0, scale, 1.0)).max(axis=0, initial=1e-300)
        _check_small("stiffness", "free of rigid motions", force / size, 1.0)
        shifts = free[free < 3]
        moved = self.moments[:, 1:] @ rigid[:, : len(shifts)]
        _check_small(
            "moments",
            "the mass times a uniform displacement",
            moved / self.mass - np.eye(3)[:, shifts],
            1.0,
        )


def _diagonal_scale(matrix: FloatArray) -> FloatArray:
    """Factors of rows and columns that make all diagonals one; zero for diagonals that are zero."""
    diagonal = np.diagonal(matrix)
    positive = diagonal > 0.0
    scale: FloatArray = np.where(positive, 1.0 / np.sqrt(np.where(positive, diagonal, 1.0)), 0.0)
    return scale


def _check_small(name: str, what: str, defect: FloatArray, size: float) -> None:
    largest = float(np.abs(defect).max(initial=0.0))
    if largest > _ROUND_OFF * size:
        _refuse(name, what, f"it deviates by {largest / size:.3g} of its size")


def _refuse(name: str, what: str, instead: str) -> NoReturn:
    raise ValueError(f"ReducedBody: {name} must be {what}, but {instead}")
