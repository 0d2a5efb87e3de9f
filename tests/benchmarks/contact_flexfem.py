# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of ``contact_peers.py`` in flexfem: its cases as they are shipped."""

from typing import Any

import numpy as np
from contact_scenes import Break, Capstan, Figures, Sheet

from flexfem.case import load_case


def _run(name: str, step: float, t_end: float, **options: Any) -> tuple[Figures, Any]:
    """Run a case with steps of one size; what all scenes take of it, and its history.

    What setting up and one step take does not count, nor do compiling and loading of loops.
    """
    found, case = Figures(), load_case(name)
    case.run(dt=step, t_end=step, **options)
    found.aside(lambda: case.run(dt=step, t_end=step, **options))
    ended = found.timed(lambda: case.run(dt=step, t_end=t_end, **options))
    if ended.status != "ok":
        raise RuntimeError(ended.status)
    history = ended.history
    found.depths = (-history["gap"]).tolist()
    return found, history


def _energy(history: Any) -> list[float]:
    """Kinetic energy and what bodies and contacts store, J."""
    energy: list[float] = (history["energy_kinetic"] + history["energy_strain"]).tolist()
    return energy


def sheet_landing(scene: Sheet, step: float, setting: str) -> Figures:
    """Rotation-free shells."""
    found, history = _run("sheet_landing", step, scene.t_end, gravity=0.0)
    found.energy = _energy(history)
    return found


def billiards(scene: Break, step: float, setting: str) -> Figures:
    """Free bodies, boxes of which touch each other as well."""
    found, history = _run("billiards", step, scene.t_end)
    found.energy = _energy(history)
    found.momenta = list(np.column_stack([history[f"momentum_p{axis}"] for axis in "xyz"]))
    return found


def capstan(scene: Capstan, step: float, setting: str) -> Figures:
    """Beams."""
    found, history = _run("capstan", step, scene.t_end)
    found.pulls = list(zip(history["t"].tolist(), history["pull_fx"].tolist(), strict=True))
    return found
