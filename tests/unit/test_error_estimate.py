# SPDX-License-Identifier: LGPL-3.0-or-later
"""Change of the acceleration-like variable that errors of steps are estimated from."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.integrators.generalized_alpha import step_laws
from flexfem.simulation.motion.stepping import Simulation

H = 0.02


@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
def test_the_change_is_that_of_acceptance(integrator):
    """Index 2 moves positions by an increment of its own, which is no part of the integrated one.

    Two bodies that swing fast about two axes; the change is compared with that of the
    accepted variable, in the axes of the nodes.
    """
    model = ff.Model("pendulum")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "bob", 2.0, (0.02, 0.03, 0.04), position=(0.5, 0.0, 0.0),
            velocity=(0.0, 0.0, -4.5), angular_velocity=(0.0, 9.0, 0.0),
        ),
        ff.RigidBody(
            "tip", 1.0, (0.02, 0.01, 0.03), position=(0.5, 0.4, 0.0),
            velocity=(0.0, 0.0, -4.5), angular_velocity=(0.0, 9.0, 0.0),
        ),
        ff.Spherical("hinge", ff.Ground(), ff.Marker("bob", offset=(-0.5, 0.0, 0.0))),
        ff.Spherical("elbow", ff.Marker("bob"), ff.Marker("tip", offset=(0.0, -0.4, 0.0))),
    )  # fmt: skip
    options = ff.RunOptions(dt=H, t_end=1.0, integrator=integrator)
    simulation = Simulation(model, options)
    (part,) = simulation.system.parts
    block, owned = part.block, slice(0, part.block.owned)
    for _ in range(3):
        before = block.state()["auxiliary"].copy()
        assert simulation._scheme.solve(simulation.system, simulation._policy, H).value == "ok"
        block.jump_to_step(step_laws(options.rho_inf, H).accept, 1.0)
        step, R = block.step[owned].copy(), block.frames[owned, 3:].reshape(-1, 3, 3).copy()
        simulation._scheme.accept(simulation.system, H)
        change = (block.state()["auxiliary"] - before)[owned]
        if block.inertial:
            change[:, :3] = np.einsum("nji,nj->ni", R, change[:, :3])
        # round-off; with the increment of index 2 it is off by 0.36
        np.testing.assert_allclose(step, change, rtol=1e-9, atol=1e-9 * np.abs(change).max())
