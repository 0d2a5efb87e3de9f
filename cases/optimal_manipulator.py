# SPDX-License-Identifier: LGPL-3.0-or-later
"""Torques that lead the flexible manipulator of ``parallel_manipulator`` along its path.

The torques fed forward in ``parallel_manipulator`` are those of rigid links; the flexible ones lead
the end effector off its path. Here each drive has a cubic spline over time (B-spline with equal
intervals) of ``--coefficients`` in addition. They are found by least squares of the errors off the
path at all steps, in units of ``--precision``, and of the torques in addition, in units of
``--effort``, by the method of Levenberg and Marquardt with the derivatives of all errors from the
linearised motion (``flexfem.identify``): the three drives move two coordinates, and only the second
part says how they share the work. At any time four coefficients of each drive act, so that four
models give the derivatives by all of them. All options of ``parallel_manipulator`` but ``closure``
are here as well; give the same ``--t-end`` and ``--duration``.

``iterations.csv`` has the root of the mean square of the error, ``parameters.csv`` the coefficients
(N m), the folder ``start`` the motion without them.

History: that of ``parallel_manipulator``, where tau_1, tau_2, tau_3 are the torques in all, N m:
P_x, P_y, P_vx, P_vy, P_ax, P_ay, error_x, error_y, tau_1, tau_2, tau_3, angle_1, angle_2, angle_3,
angle_4, angle_5, angle_6, rate_1, rate_2, rate_3, rate_4, rate_5, rate_6, acceleration_1,
acceleration_2, acceleration_3, acceleration_4, acceleration_5, acceleration_6, angle_error_1,
angle_error_2, angle_error_3, angle_error_4, angle_error_5, angle_error_6, rate_error_1,
rate_error_2, rate_error_3, rate_error_4, rate_error_5, rate_error_6, acceleration_error_1,
acceleration_error_2, acceleration_error_3, acceleration_error_4, acceleration_error_5,
acceleration_error_6, transverse_1, transverse_3, transverse_5, rotation_1, rotation_3, rotation_5,
axial_1, axial_3, axial_5, elongation_1, elongation_3, elongation_5; and more_1, more_2, more_3, the
torques in addition, N m.

Expected: with 201 coefficients the end effector is off its path by 0.037 um at most instead of 7.7
um after two motions (one step of the method), by torques of 0.7 mN m at most in addition to 147.
Run: ``mpirun -n 2 python cases/optimal_manipulator.py``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

import flexfem as ff

Array = npt.NDArray[np.float64]
BASE = ff.load_case("parallel_manipulator")
ERRORS, MORE = ("error_x", "error_y"), ("more_1", "more_2", "more_3")


def spline(coefficients: Array, duration: float) -> Callable[[float], float]:
    """Cubic spline over a time, at whose ends it is its first and its last coefficient."""
    inner = np.linspace(0.0, duration, len(coefficients) - 2)
    knots = np.concatenate([[0.0] * 3, inner, [duration] * 3])
    curve = BSpline(knots, coefficients, 3)
    return lambda t: float(curve(min(max(t, 0.0), duration)))


def corrected(base: ff.Model, duration: float, *, lean: bool = False, **given: Array) -> ff.Model:
    """The manipulator with torques in addition, by drives; if lean, with their columns alone."""
    more = {name: spline(values, duration) for name, values in given.items()}
    drives = [thing for thing in base.things if isinstance(thing, ff.Actuator)]
    nothing: Callable[[float], float] = lambda t: 0.0  # noqa: E731
    sums: list[Callable[[float], float]] = [
        lambda t, one=one: one.force(t) + more[one.name](t) for one in drives
    ]
    sums += [nothing] * (len(MORE) - len(sums))
    parts = [more.get(f"drive_{name[-1]}", nothing) for name in MORE]
    model = ff.Model("optimal_manipulator", mesh=base.mesh)
    for thing in base.things:
        if isinstance(thing, ff.Actuator):
            model.add(replace(thing, force=sums[drives.index(thing)]))
        elif thing.name == "torques":
            model.add(ff.Probe("more", (), MORE, lambda t: [one(t) for one in parts]))
            if not lean:
                model.add(ff.Probe("torques", (), thing.columns, lambda t: [s(t) for s in sums]))
        elif not lean or thing.name == "end_effector" or not hasattr(thing, "columns"):
            model.add(thing)
    model.released = list(base.released)
    return model


def best(
    base: ff.Model, limits: tuple[float, float, float, int], search: ff.ParameterSearch,
    options: ff.RunOptions, report: Callable[[Mapping[str, float]], None],
) -> ff.FoundParameters:  # fmt: skip
    """Coefficients with the least errors."""
    duration, precision, effort, motions = limits
    lean = partial(corrected, base, duration, lean=True)

    def error(values: Mapping[str, Any]) -> Array:
        history = ff.simulate(lean(**values), options).history
        return np.hypot(*(history[name] for name in ERRORS)) if history else np.zeros(1)

    before = error(search.start)
    rows = round(options.t_end / options.dt) + 1
    measured = {name: np.zeros(rows) for name in (*ERRORS, *MORE)}
    noise = dict.fromkeys(ERRORS, precision) | dict.fromkeys(MORE, effort)
    found = ff.identify(lean, measured, search.start, options, noise=noise, most=motions)
    after = error(found.values)
    for one in (before, after):
        report({"rms_error": float(np.sqrt(np.mean(one**2))), "largest_error": float(one.max())})
    return ff.FoundParameters(
        found.values,
        {"largest_error_before": float(before.max()), "motions": float(found.motions),
         "improvement": float(before.max() / after.max()) if after.max() else 0.0},
    )  # fmt: skip


def build(
    *, coefficients: int, precision: float, effort: float, motions: int, **given: Any
) -> ff.ParameterSearch:
    """The search for the coefficients of all drives."""
    base, duration = BASE.build(**given, closure="multipliers"), given["duration"]
    drives = [thing.name for thing in base.things if isinstance(thing, ff.Actuator)]
    return ff.ParameterSearch(
        "optimal_manipulator", partial(corrected, base, duration),
        {name: np.zeros(coefficients) for name in drives},
        partial(best, base, (duration, 1e-6 * precision, effort, motions)),
    )  # fmt: skip


CASE = ff.Case(
    name="optimal_manipulator",
    summary="torques for which a flexible 3-RRR manipulator keeps its path, by least squares",
    description=__doc__,
    build=build,
    options=(
        ff.Option("coefficients", int, 67, "of the spline of each drive", minimum=8),
        ff.Option("precision", float, 0.1, "error that weighs as much as --effort", unit="um",
                  above=0.0),
        ff.Option("effort", float, 0.1, "torque in addition that weighs so much", unit="N m",
                  above=0.0),
        ff.Option("motions", int, 2, "most motions whose derivatives are taken", minimum=1),
        *(replace(one, default={"mode": "torque", "elements": 3}.get(one.name, one.default))
          for one in BASE.options if one.name != "closure"),
    ),
    dt=2e-3,
    t_end=0.5,
    tolerance=1e-9,
    presets={"links": {"floating": {"elements": 3}, "fem": {"elements": 3, "stiffening": False}}},
    smoke={"coefficients": 8, "motions": 1, "elements": 2, "samples": 21, "t_end": 4e-3},
    results=BASE.results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
