# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compile the loops that take longest before several processes of tests would all compile them.

``make test`` runs this beside the linters, which leave one core idle.
"""

import flexfem as ff
from tests.unit.particle_body import bar


def main() -> None:
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
    main()
