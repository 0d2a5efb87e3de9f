# SPDX-License-Identifier: LGPL-3.0-or-later
"""A control of least effort by one gradient, against the solution in closed form."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import expm

import flexfem as ff

#: Two masses of 1 kg with a spring of 1 N/m between, from rest to rest 1 m away within 2 s.
END, STEPS, KNOTS = 2.0, 800, 41
APART = 100.0  # m, so that they do not meet
TIMES = np.linspace(0.0, END, KNOTS)
OF = ["final:x1", "final:x2", "final:v1", "final:v2"]


def build(force):
    """Masses on a line, the first one pulled by a force that is linear between its knots."""
    model, axis = ff.Model("masses"), (1.0, 0.0, 0.0)
    first, second = ff.Marker("first"), ff.Marker("second")
    model.add(
        ff.RigidBody("first", 1.0, (1.0, 1.0, 1.0)),
        ff.RigidBody("second", 1.0, (1.0, 1.0, 1.0), position=(APART, 0.0, 0.0)),
        ff.Prismatic("guide_1", ff.Ground(), first, axis=axis),
        ff.Prismatic("guide_2", ff.Ground((APART, 0.0, 0.0)), second, axis=axis),
        ff.SpringDamper("spring", first, second, stiffness=1.0, damping=0.0, rest_length=APART),
        ff.PointForce("pull", first, axis, amplitude=ff.Table(TIMES, force)),
        ff.Probe(
            "state", (first, second), ("x1", "x2", "v1", "v2"),
            lambda t, a, b: (a.position[0], b.position[0] - APART, a.velocity[0], b.velocity[0]),
        ),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_least_effort():
    """The least integral of the force squared is ``d^T W^-1 d`` with the Gramian W."""
    options = ff.RunOptions(dt=END / STEPS, t_end=END, rho_inf=1.0, quiet=True)
    found = ff.gradient(build, OF, {"force": np.zeros(KNOTS)}, options)
    # the motion is linear in the force: the least effort follows from one gradient
    ends = np.array([found.gradient[one]["force"] for one in OF])
    h = END / (KNOTS - 1)
    effort = h * (np.diag(np.r_[1 / 3, np.full(KNOTS - 2, 2 / 3), 1 / 3]))
    effort += h / 6.0 * (np.eye(KNOTS, k=1) + np.eye(KNOTS, k=-1))
    multipliers = np.linalg.solve(ends @ np.linalg.solve(effort, ends.T), [1.0, 1.0, 0.0, 0.0])
    force = np.linalg.solve(effort, ends.T @ multipliers)

    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2] = np.eye(2), [[-1.0, 1.0], [1.0, -1.0]]
    b, wanted = np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 1.0, 0.0, 0.0])
    # Van Loan's exponential of the Gramian
    both = expm(np.block([[-A, np.outer(b, b)], [np.zeros((4, 4)), A.T]]) * END)
    gramian = both[4:, 4:].T @ both[:4, 4:]
    factors = np.linalg.solve(gramian, wanted)
    exact = np.array([b @ expm(A.T * (END - t)) @ factors for t in TIMES])
    # steps of 2.5 ms are off by 1e-5 in the motion at the end, which is a small difference of what
    # forces do; the best forces that are linear between knots are off by h^2 u''/12, 2.5e-3 of
    # the largest, and effort by the square of it; a missing share of a knot is 1e-2 and more
    assert abs(force @ effort @ force - wanted @ factors) < 1e-4 * (wanted @ factors)
    assert np.abs(force - exact).max() < 3e-3 * np.abs(exact).max()

    history = ff.simulate(build(force), options).history
    end = [float(history[one][-1]) for one in ("x1", "x2", "v1", "v2")] if history else None
    # rounding of the solution for the multipliers
    assert np.abs(np.subtract(MPI.COMM_WORLD.bcast(end), wanted)).max() < 1e-8
