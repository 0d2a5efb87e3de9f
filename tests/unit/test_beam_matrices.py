# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of linear beams over a step, written by hand, against those that are generated."""

import numpy as np
import pytest

import flexfem as ff
from flexfem._types import FloatArray
from flexfem.families.beam_se3.elements import SE3Beams
from flexfem.families.beam_se3.group import BeamGroup
from flexfem.lie import se3, so3
from flexfem.simulation.run.setup import set_up
from flexfem.system.system import BlockPart, System

pytestmark = pytest.mark.serial
#: Enough for more than one batch of lanes, the last of which is not full.
CELLS = 11
#: dv/dn and dw/dn and k, and the factor: no term dominates.
SHIFTS, SCALE = np.array([700.0, 7e3, 1.0]), 0.3


def _section(random: np.random.Generator) -> ff.Section:
    """A full stiffness matrix, and a mass centre beside the axis."""
    root, mass = random.normal(size=(6, 6)), 2.0
    stiffness = 1e3 * (root @ root.T + np.eye(6))
    centre = 0.1 * random.normal(size=3)
    first = mass * so3.skew(centre)
    rotary = np.diag([0.05, 0.03, 0.02]) - first @ so3.skew(centre)
    inertia = np.block([[mass * np.eye(3), first.T], [first, rotary]])
    return ff.Section.general(stiffness, inertia)


def _moving(random: np.random.Generator, *, turned: bool) -> tuple[System, BlockPart]:
    """A beam of two sections, strongly deformed, in motion; a cell beyond a corner has own axes."""
    points, half = np.zeros((CELLS + 1, 3)), CELLS // 2
    points[: half + 1, 0] = 0.1 * np.arange(half + 1)
    points[half + 1 :, 0] = 0.1 * half
    points[half + 1 :, int(turned)] += 0.1 * np.arange(1, CELLS + 1 - half)
    cells = np.array([[k, k + 1] for k in range(CELLS)])
    model = ff.Model("rod", mesh=ff.LineMesh(points, cells, {"rod": np.arange(CELLS)}))
    first, second = _section(random), _section(random)
    model.add(
        ff.Gravity((1.0, 2.0, -9.81)),
        ff.Beam("rod", lambda s: first if s < 0.55 else second, orientation=(0.0, 0.0, 1.0)),
    )
    system = set_up(model, None, 10_000)[1]
    (part,) = system.parts
    block = part.block
    block.increment[:] = 0.2 * random.normal(size=block.increment.shape)
    block.frames[:] = se3.retract(block.frames, 0.1 * random.normal(size=block.velocity.shape))
    for rates in (block.velocity, block.acceleration):
        rates[:] = random.normal(size=rates.shape)
    return system, part


def _matrices(group: BeamGroup, system: System, part: BlockPart) -> FloatArray:
    out = np.empty((3, CELLS, 144))
    group.step_matrices(part.block, system.gravity, SHIFTS, SCALE, out)
    return out


@pytest.mark.parametrize("turned", [False, True])
def test_matrices_by_hand_are_the_generated_ones(turned: bool) -> None:
    """By velocity, by acceleration and all in all."""
    system, part = _moving(np.random.default_rng(1), turned=turned)
    assert isinstance(part.elements, SE3Beams)
    ((_, group),) = part.elements.groups
    assert bool(group.turned.any()) is turned
    by_hand = _matrices(group, system, part)
    group._linear = None
    generated = _matrices(group, system, part)
    for own, other in zip(by_hand, generated, strict=True):
        # of the largest entry; a term left out is 1e-3 of it at least, rounding 1e-15
        assert np.abs(own - other).max() < 2e-13 * np.abs(other).max()


def test_damped_beams_have_generated_matrices() -> None:
    """The written ones have no damping: with it they would be wrong."""
    mesh = ff.LineMesh.straight({"rod": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, elements=2)
    model = ff.Model("rod", mesh=mesh)
    section = ff.Section.rectangle(0.03, 0.02, ff.Material(2e9, 0.3, 1000.0))
    model.add(ff.Beam("rod", section, damping=1e-3))
    (part,) = set_up(model, None, 10_000)[1].parts
    assert isinstance(part.elements, SE3Beams)
    assert part.elements.linear._linear is None
