# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of a rod with itself: plectoneme of a twisted rod, from the case ``plectoneme``.

Moment and tension of the ends of two strands that wind about each other depend on their angle alone
(Clauvelin, Audoly, Neukirch 2008), and so does their curvature, sin(angle)^2 over the radius of
their axes about that of the plectoneme.
"""

import math

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.result import Result

#: Middle of one of the strands, in the length of the rod.
STRAND = 0.35


def results(full: bool = True) -> list[Result]:
    """The case as it is; tests check its geometry and formulas alone, as the run takes minutes."""
    del full
    case = load_case("plectoneme")
    values = case.values({})
    model = case.model()
    model.add(ff.StrainProbe("strand", "rod", STRAND))
    step, elements, diameter = values["dt"], values["elements"], values["diameter"]
    outcome = ff.simulate(
        model,
        ff.RunOptions(dt=step, t_end=values["t_end"], integrator="energy_momentum", quiet=True),
    )
    if outcome.status != "ok":
        raise RuntimeError(f"plectoneme: {outcome.status}")
    history = outcome.history
    found = case.results(history, diameter=diameter, youngs_modulus=values["youngs_modulus"])
    radius = 0.5 * (diameter + float(history["contact_gap"][-1]))
    curvature = math.hypot(history["strand_kappa2"][-1], history["strand_kappa3"][-1])
    angle = math.degrees(math.asin(math.sqrt(curvature * radius)))
    made = history["energy_balance"].max() / history["energy_strain"].max()
    force = max(np.abs(history[f"contact_f{axis}"]).max() for axis in "xyz")
    name, mesh = "plectoneme of a twisted rod", f"{elements} elements, h = {1e3 * step:g} ms"
    theory, law = "Clauvelin et al. 2008, by the tension", "conserved"
    return [
        # formulas for small angles are off by 3 %
        Result(name, "moment at the ends, N m", found["torque_of_plectoneme"], theory,
               found["torque"], mesh, 1e-2),
        # vertices and chords that touch each other bend the strands unevenly
        Result(name, "angle of the strands by their curvature, degrees", found["angle"], theory,
               angle, mesh, 3e-2),
        # whatever the mesh; a passage of the rod through itself changes the sum by two: without
        # contact it is six
        Result(name, "largest difference of twist and writhe from the turns of the end", 0.0,
               "Calugareanu 1961", found["link_error"], mesh, 1e-6),
        # the loop falls on itself; what the scheme dissipates, 2e-3, is not in it
        Result(name, "largest energy balance over the strain energy", 0.0, law, made, mesh, 1e-9),
        Result(name, "largest force of the contact on the whole rod over the sum of sizes", 0.0,
               "forces equal and opposite", force / history["contact_normal"].max(), mesh, 1e-12),
    ]  # fmt: skip
