# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion of a beam with assumed modes: base prescribed, or free."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import se3
from flexfem.research.equations.vector_equations import Motion, Picture, VectorEquations
from flexfem.research.moving_base.base import FreeBase, PrescribedBase
from flexfem.research.moving_base.basis import Basis
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.inertia import Inertia, rigid_inertia
from flexfem.research.moving_base.initial import Shape, coordinates_of
from flexfem.research.moving_base.rotations import rotation_matrices

__all__ = ["FreeBaseEquations", "PrescribedBaseEquations", "Setting"]

_TIP = ("u2", "u3", "theta1", "s")


@dataclass(frozen=True, eq=False)
class Setting:
    """Data besides the integrals from which equations are made.

    Attributes:
        effects: effects that the theory takes into account.
        damping_ratio: of every function with the base at rest, or one for each, lowest frequency
            first; those that are not given are the last one.
        displacement, velocity: relative to the base at the start.
    """

    effects: Effects = field(default_factory=Effects)
    damping_ratio: float | Sequence[float] = 0.0
    displacement: Shape | None = None
    velocity: Shape | None = None

    def damping_ratios(self, basis: Basis) -> FloatArray:
        """One for each function.

        Raises:
            ValueError: there are more than functions.
        """
        given = np.atleast_1d(np.asarray(self.damping_ratio, dtype=np.float64))
        if len(given) > basis.size:
            raise ValueError(f"damping_ratio: {len(given)} ratios for {basis.size} functions")
        return np.concatenate([given, np.full(basis.size - len(given), given[-1])])

    def start(self, basis: Basis) -> tuple[FloatArray, FloatArray]:
        """Modal coordinates and their rates at the start."""
        return (
            coordinates_of(basis, "displacement", self.displacement),
            coordinates_of(basis, "velocity", self.velocity),
        )


class _BeamEquations(VectorEquations):
    """Common parts of both kinds of equations."""

    def __init__(self, basis: Basis, inertia: Inertia, setting: Setting) -> None:
        self.basis, self.inertia = basis, inertia
        self._effects, self._start = setting.effects, setting.start(basis)
        # in proportion to critical damping of every mode: the basis is mass-orthonormal
        ratios = setting.damping_ratios(basis)
        self._damping = np.diag(2.0 * ratios * basis.frequencies)

    def _tip(self, q: FloatArray) -> list[float]:
        """u2, u3, theta1 and s of the tip."""
        s, u2, u3, twist = (self.basis.node_fields[:4, -1] @ q).tolist()
        return [u2, u3, twist, s]

    def frame(self, motion: Motion) -> FloatArray:
        """Position and rotation of the base, (12,)."""
        raise NotImplementedError

    def amplitudes(self, motion: Motion) -> FloatArray:
        """Modal coordinates, (n,)."""
        raise NotImplementedError

    def pictures(self, motion: Motion) -> Mapping[str, Picture]:
        """The deformed axis, with displacement, rotations and section axes, in inertial axes."""
        frame, q = self.frame(motion), self.amplitudes(motion)
        x, R = frame[:3], frame[3:].reshape(3, 3)
        fields = self.basis.node_fields @ q
        moved = fields[:3].T.copy()
        if self._effects.stiffening:
            moved[:, 0] -= 0.5 * (self.basis.node_shortening @ q) @ q
        nodes = self.basis.nodes
        straight = nodes[:, None] * np.array([1.0, 0.0, 0.0])
        cells = np.stack([np.arange(len(nodes) - 1), np.arange(1, len(nodes))], axis=1)
        sections = R @ rotation_matrices(self._effects.rotations, fields[3:].T)
        data = {
            "displacement": moved @ R.T,
            "rotation": fields[3:].T @ R.T,
            **{f"e{i + 1}": sections[:, :, i] for i in range(3)},
        }
        return {"beams": Picture(x + (straight + moved) @ R.T, cells, "line", data)}

    def summary(self) -> Mapping[str, Any]:
        """Frequencies of the functions with the base at rest, Hz."""
        return {"frequencies": self.basis.frequencies / (2.0 * np.pi)}

    def identity(self) -> Mapping[str, str]:
        """See :meth:`VectorEquations.identity`."""
        digits = (np.linalg.norm(a) for a in vars(self.inertia).values())
        own = " ".join(f"{x:.6e}" for x in (*digits, np.linalg.norm(self.basis.stiffness)))
        return {**super().identity(), "integrals": own}


class PrescribedBaseEquations(_BeamEquations):
    """``M q'' + (G + D) q' + K q = F`` with the scalars of the base's motion in G, K, F.

    Columns ``u2, u3`` (m), ``theta1`` (rad) and ``s`` (m) of the tip, components along the axes
    of the base.
    """

    linear, columns = True, _TIP

    def __init__(
        self, basis: Basis, inertia: Inertia, base: PrescribedBase, setting: Setting
    ) -> None:
        """Keep the integrals in the form in which the base's motion enters."""
        super().__init__(basis, inertia, setting)
        self._base, self.size = base, basis.size
        n = basis.size
        # by columns: one product with a short vector a step
        self._B = inertia.B1.reshape(6, n * n)
        self._pairs = np.triu_indices(6)
        factors = np.where(self._pairs[0] == self._pairs[1], 0.5, 1.0)
        self._A1 = factors[:, None] * inertia.A1[self._pairs]
        self._A2 = factors[:, None] * inertia.A2[self._pairs].reshape(len(factors), n * n)
        self._time, self._now = np.nan, (np.empty(0),) * 3

    def matrices(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """G, K (n, n) and F (n,) at a time, without damping."""
        if t != self._time:
            n = self.size
            nu, rate = self._base.twist(t), self._base.rate(t)
            squares = nu[self._pairs[0]] * nu[self._pairs[1]]
            moving = (nu @ self._B).reshape(n, n)
            K = self.basis.stiffness + (rate @ self._B - squares @ self._A2).reshape(n, n)
            F = squares @ self._A1 - rate @ self.inertia.B0
            self._time, self._now = t, (moving - moving.T, K, F)
        return self._now

    def start(self) -> tuple[FloatArray, FloatArray]:
        """As given, relative to the base."""
        return self._start

    def residual(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
    ) -> FloatArray:
        """See :meth:`VectorEquations.residual`."""
        G, K, F = self.matrices(t)
        r: FloatArray = self.inertia.M @ a + (G + self._damping) @ v + K @ q - F
        return r

    def tangent(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray,
        dv: float, da: float,
    ) -> FloatArray:  # fmt: skip
        """See :meth:`VectorEquations.tangent`."""
        G, K, _ = self.matrices(t)
        return K + dv * (G + self._damping) + da * self.inertia.M

    def observe(self, motion: Motion) -> Sequence[float]:
        """See :meth:`VectorEquations.observe`."""
        return self._tip(motion.q)

    def frame(self, motion: Motion) -> FloatArray:
        """Position and rotation of the base."""
        return self._base.frame(motion.t)

    def amplitudes(self, motion: Motion) -> FloatArray:
        """Modal coordinates."""
        return motion.q


class FreeBaseEquations(_BeamEquations):
    """A free rigid base with a beam: Lagrange's equations of the kinetic energy cut off.

    The configuration holds the frame of the base (12 numbers) and q; velocities are those of the
    root and the base's angular velocity along a1, a2, a3, and q'. With the momenta
    ``p = A(q) nu + B(q) q'``: ``p' + ad(nu)^T p = 0`` and
    ``(B(q)^T nu + M q')' = dT/dq - H q``.

    Columns as with a prescribed base, then position of the base ``base_x, base_y, base_z`` (m),
    linear and angular momentum about the inertial origin ``px, py, pz`` (kg m/s), ``lx, ly, lz``
    (kg m^2/s) in inertial axes, and the ``energy`` (J), all of which are constant.
    """

    columns = (
        *_TIP, "base_x", "base_y", "base_z", "px", "py", "pz", "lx", "ly", "lz", "energy",
    )  # fmt: skip

    def __init__(self, basis: Basis, inertia: Inertia, base: FreeBase, setting: Setting) -> None:
        """Add the base's own inertia to that of the beam."""
        super().__init__(basis, inertia, setting)
        self._base, self.size = base, 6 + basis.size
        self._A0 = inertia.A0 + rigid_inertia(
            base.mass, np.asarray(base.centre), np.asarray(base.inertia)
        )

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Base axes along the inertial ones, the beam as given."""
        eta, rate = self._start
        q = np.concatenate([np.zeros(3), np.eye(3).reshape(-1), eta])
        return q, np.concatenate([self._base.velocity, self._base.angular_velocity, rate])

    def add(self, q: FloatArray, increment: FloatArray) -> FloatArray:
        """The base moves in its own axes."""
        turned = se3.compose(q[:12], se3.exp(increment[:6]))
        return np.concatenate([turned, q[12:] + increment[6:]])

    def masses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A (6, 6) and B (6, n) with modal coordinates q."""
        i = self.inertia
        return self._A0 + i.A1 @ q + 0.5 * (i.A2 @ q) @ q, i.B0 + i.B1 @ q

    def momentum(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Linear and angular momentum about the root in base axes, (6,)."""
        A, B = self.masses(q)
        p: FloatArray = A @ v[:6] + B @ v[6:]
        return p

    def residual(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray
    ) -> FloatArray:
        """See :meth:`VectorEquations.residual`."""
        i, eta, nu, rate = self.inertia, q[12:], v[:6], v[6:]
        A, B = self.masses(eta)
        dA, dB = i.A1 @ rate + (i.A2 @ rate) @ eta, i.B1 @ rate  # rates of A and B
        p = A @ nu + B @ rate
        base = A @ a[:6] + B @ a[6:] + dA @ nu + dB @ rate
        base[:3] += np.cross(nu[3:], p[:3])
        base[3:] += np.cross(nu[3:], p[3:]) + np.cross(nu[:3], p[:3])
        force = 0.5 * np.einsum("r,s,rsi->i", nu, nu, i.A1 + i.A2 @ eta)
        force += np.einsum("r,i,rij->j", nu, rate, i.B1)
        modal = i.M @ a[6:] + B.T @ a[:6] + dB.T @ nu - force
        modal += self.basis.stiffness @ eta + self._damping @ rate
        return np.concatenate([base, modal])

    def tangent(
        self, t: float, q: FloatArray, v: FloatArray, a: FloatArray, multipliers: FloatArray,
        dv: float, da: float,
    ) -> FloatArray:  # fmt: skip
        """See :meth:`VectorEquations.tangent`; central differences, exact but for rounding.

        The residual does not depend on the frame and is a polynomial of the third degree.
        """
        n, zero = self.size, np.zeros(0)
        out = np.empty((n, n))
        size = 1e-4 / (1.0 + dv + da)
        for j in range(n):
            step = np.zeros(n)
            step[j] = size
            up, down = (
                self.residual(
                    t, np.concatenate([q[:12], q[12:] + sign * step[6:]]),
                    v + sign * dv * step, a + sign * da * step, zero,
                )
                for sign in (1.0, -1.0)
            )  # fmt: skip
            out[:, j] = (up - down) / (2.0 * size)
        return out

    def observe(self, motion: Motion) -> Sequence[float]:
        """See :meth:`VectorEquations.observe`."""
        x, R, eta = motion.q[:3], motion.q[3:12].reshape(3, 3), motion.q[12:]
        p = self.momentum(eta, motion.v)
        linear = R @ p[:3]
        angular = R @ p[3:] + np.cross(x, linear)
        rate = motion.v[6:]
        _, B = self.masses(eta)
        kinetic = 0.5 * (motion.v[:6] @ p + motion.v[:6] @ B @ rate + rate @ self.inertia.M @ rate)
        energy = kinetic + 0.5 * eta @ self.basis.stiffness @ eta
        return [*self._tip(eta), *x, *linear, *angular, energy]

    def frame(self, motion: Motion) -> FloatArray:
        """Position and rotation of the base."""
        return motion.q[:12]

    def amplitudes(self, motion: Motion) -> FloatArray:
        """Modal coordinates."""
        return motion.q[12:]
