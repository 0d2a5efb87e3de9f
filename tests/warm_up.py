# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compile the loops that take longest before several processes of tests would all compile them.

``make test`` runs both parts beside the linters, which leave one core idle.
"""

import sys

import numpy as np

import flexfem as ff
from tests.contract.line_examples import SLIDING, PlacedOnLine
from tests.unit.particle_body import bar


def sliding() -> None:
    """Rows of a joint that slides on a line, with their derivatives."""
    joint = PlacedOnLine(SLIDING["Sliding"], "se3", np.random.default_rng(1))
    joint.evaluate()
    joint.hessian(np.ones(joint.rows.size))
    joint.rows.second_rates()


def floating() -> None:
    """A short motion of bodies in floating frames of all kinds."""
    for stiffening in (False, True):
        reduced = bar(stiffening=stiffening)
        for frame in ("left", "mean_axes"):
            model = ff.Model("warm_up")
            model.add(
                ff.FloatingBody("bar", reduced, frame=frame, stiffening=stiffening),
                ff.Spherical("pin", ff.Ground(), ff.Marker("bar", "left")),
                ff.EnergyProbe("energy"),
            )
            options = ff.RunOptions(dt=1e-3, t_end=3e-3, iteration_matrix="updated", quiet=True)
            ff.simulate(model, options)


if __name__ == "__main__":
    {"sliding": sliding, "floating": floating}[sys.argv[1]]()
