# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams with laws of their own in motion: closed forms, policies, mixtures, failure."""

import importlib.util
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

SPEC = importlib.util.spec_from_file_location(
    "nonlinear_beam", Path(__file__).parents[2] / "cases" / "nonlinear_beam.py"
)
MODULE = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(MODULE)
VALUES = {"EA": 3e4, "GA": 1e4, "GJ": 2.0, "EI": 2.0, "k0": 2.0, "T": 0.05, "sign": 1.0}
LAW = ff.BeamLaw(MODULE.energy, dissipation=MODULE.dissipation, parameters=VALUES)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("law", "sign"), [("softening", 1.0), pytest.param("stiffening", -1.0, marks=pytest.mark.slow)]
)
def test_end_moment_bends_to_the_curvature_of_the_law(law, sign):
    model = MODULE.CASE.model(elements=3, law=law, moment=0.6, retardation=0.3)
    options = ff.RunOptions(dt=2e-2, t_end=12.0, tolerance=1e-9)
    outcome = ff.simulate(model, options)
    assert outcome.status == "ok"
    kappa = 0.6 * 2.0 / np.sqrt(1.0 - sign * 0.36)
    angle = kappa  # times the length of 1 m
    expected = [np.sin(angle) / kappa, 0.0, (1.0 - np.cos(angle)) / kappa, angle]
    found = [outcome.history[name][-1] for name in ("tip_x", "tip_y", "tip_z", "tip_angle")]
    # the motion has died out to 1e-7; the linear law gives 1.2 rad, and chords for arcs are off by
    # 1e-2 with three elements
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.serial
def test_policies_agree_and_frozen_factorises_once():
    histories = {}
    for policy in ("updated", "frozen", "auto"):
        model = MODULE.CASE.model(elements=4, law="softening", moment=0.8, retardation=0.02)
        options = ff.RunOptions(dt=5e-3, t_end=0.8, iteration_matrix=policy, tolerance=1e-9)
        outcome = ff.simulate(model, options)
        assert outcome.status == "ok"
        histories[policy] = outcome.history
        if policy == "frozen":
            assert outcome.summary["factorizations"] == 1
            assert outcome.summary["fallbacks"] == 0
        if policy == "updated":
            # quadratic convergence: a term missing in the tangent costs iterations
            assert outcome.summary["newton_iterations"] <= 4.0 * outcome.summary["steps"]
    for policy in ("frozen", "auto"):
        for name, column in histories["updated"].items():
            # both stop at steps below 1e-9; another law is 1e-2 and more
            np.testing.assert_allclose(histories[policy][name], column, atol=2e-8)


def _pendulum() -> ff.Model:
    """Three links with a linear law and two kinds of parameters of another."""
    model = ff.Model("links", mesh=ff.build_mesh("chain", links=3, elements=3))
    linear = ff.Section.general((3e4, 1e4, 1e4, 2.0, 2.0, 2.0), (1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3))
    sections = [linear.with_law(LAW), linear, linear.with_law(LAW.with_parameters(sign=-1.0, k0=9))]
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for k, section in enumerate(sections, start=1):
        model.add(ff.Beam(f"link_{k}", section))
        before = ff.Ground() if k == 1 else ff.Marker(f"link_{k - 1}", "end")
        after = ff.Marker(f"link_{k}", "start")
        model.add(ff.Revolute(f"hinge_{k}", before, after, axis=(0.0, 1.0, 0.0)))
    model.add(ff.PositionProbe("tip", ff.Marker("link_3", "end")))
    return model


def test_mixture_of_laws_whole_and_split():
    histories = []
    for split_above, policy in ((4000, "auto"), (1, "auto"), (1, "updated")):
        options = ff.RunOptions(
            dt=5e-3, t_end=0.1, tolerance=1e-10, split_above=split_above, iteration_matrix=policy
        )
        outcome = ff.simulate(_pendulum(), options)
        assert outcome.status == "ok"
        # the first rank has the history
        histories.append(MPI.COMM_WORLD.bcast(dict(outcome.history)))
    for other in histories[1:]:
        for name, column in histories[0].items():
            # a cell without its neighbour's group on another rank falls out of the sum: 1e-3
            np.testing.assert_allclose(other[name], column, atol=1e-9)
    # it does move
    assert np.ptp(histories[0]["tip_z"]) > 1e-2


@pytest.mark.serial
def test_law_that_breaks_down_ends_the_run_with_what_it_has(tmp_path):
    """The stiffening law has no stress beyond k0 = 2 1/m; the end is turned by up to 4 rad."""
    section = ff.Section.general(
        law=LAW.with_parameters(sign=-1.0), inertia=(0.8, 0.8, 0.8, 1e-4, 5e-5, 5e-5)
    )
    mesh = ff.LineMesh(
        np.linspace([0.0, 0, 0], [1.0, 0, 0], 4), [[0, 1], [1, 2], [2, 3]], {"beam": [0, 1, 2]}
    )
    model, end = ff.Model("turned", mesh=mesh), ff.Marker("beam", "end")
    model.add(
        ff.Beam("beam", section),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PrescribedRotation(
            "drive", ff.Ground((1.0, 0.0, 0.0)), end, lambda t: (0.0, -4.0 * t**3, 0.0)
        ),
        ff.PositionProbe("tip", end),
    )
    outcome = ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=1.0, output=tmp_path / "results"))
    assert outcome.status != "ok"
    # 4 t^3 = 2 rad at 0.794 s; a NaN taken for convergence would go on
    assert 0.7 < outcome.history["t"][-1] < 0.85
    assert all(np.isfinite(column).all() for column in outcome.history.values())
    assert (tmp_path / "results" / "beams.pvd").exists()


@pytest.mark.serial
def test_fields_show_the_resultants_of_the_law(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    model = MODULE.CASE.model(elements=3, law="softening", moment=0.6, retardation=0.3)
    options = ff.RunOptions(dt=2e-2, t_end=12.0, every=600, output=tmp_path)
    assert ff.simulate(model, options).status == "ok"
    last = pyvista.read(sorted((tmp_path / "beams").glob("*.vtu"))[-1])
    moment = 0.6 * 5e7 * np.pi * 0.03**4 / 64.0 * 2.0
    # the stiffness at zero strain times the curvature would show 1.25 times the moment
    np.testing.assert_allclose(last.cell_data["bending_moment"], moment, rtol=1e-5)
    np.testing.assert_allclose(np.abs(last.cell_data["strain"][:, 4]), 1.5, rtol=1e-5)
