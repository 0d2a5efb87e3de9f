# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shell triangles assembled from UFL forms equal those of the hand-written kernels."""

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.families.common.node_pairs import NodePairs
from flexfem.families.shells.strain_kernels import StrainKernels
from flexfem.families.shells.ufl_triangles import UFLDirectorTriangles, UFLRotationFreeTriangles
from flexfem.forms.strain_forms import director_strains, rotation_free_strains
from tests.unit import test_director_triangles as directors
from tests.unit import test_rotation_free as rotation_free

pytestmark = pytest.mark.serial

#: Round-off of sums of some hundred products; a derivative that lacks a term differs by 1e-2.
SAME = 1e-12


def assert_same(one, other):
    np.testing.assert_allclose(one, other, rtol=0.0, atol=SAME * np.abs(other).max())


@rotation_free.KINDS
@pytest.mark.parametrize("given", [False, True])
def test_rotation_free_triangles(kind, given):
    fast, _, points = rotation_free.shell(**kind)
    made = UFLRotationFreeTriangles.of(fast, StrainKernels(MPI.COMM_SELF, rotation_free_strains()))
    rng = np.random.default_rng(7)
    steps = rng.normal(size=points.shape)
    assert_same(made.strains(points), fast.strains(points))
    assert_same(made.strain_rates(points, steps), fast.strain_rates(points, steps))
    assert_same(made.energies(points), fast.energies(points))
    # continued stresses are those of other strains than the present ones
    assumed = fast.strains(points) + 0.1 * rng.normal(size=(len(fast.starts), 6)) if given else None
    response = fast.response(points, assumed=assumed)
    for call in ("forces", "action"):
        found = np.zeros((2, *points.shape))
        for residual, triangles in zip(found, (made, fast), strict=True):
            if call == "forces":
                triangles.add_forces(points, residual, 0.7, response=response)
            else:
                triangles.add_action(points, steps, residual, (0.7, 0.2), response)
        assert_same(*found)
    both = made, fast
    assert_same(*(triangles.tangents(points, (0.7, 0.2), response) for triangles in both))
    pairs = NodePairs(len(points), [fast.patches.nodes])
    sums = np.zeros((2, len(pairs.rows), 3, 3))
    for blocks, triangles in zip(sums, both, strict=True):
        triangles.add_tangents(points, pairs.index[0], blocks, (0.7, 0.2), response)
    assert_same(*sums)


@pytest.mark.parametrize("given", [False, True])
def test_director_triangles(given):
    fast, _, _, frames = directors.shell()
    made = UFLDirectorTriangles.of(fast, StrainKernels(MPI.COMM_SELF, director_strains()))
    rng = np.random.default_rng(7)
    steps = rng.normal(size=(len(frames), 6))
    assert_same(made.changes(frames), fast.changes(frames))
    assert_same(made.rates(frames, steps), fast.rates(frames, steps))
    assert_same(made.energies(frames), fast.energies(frames))
    starts = fast.starts + 0.1 * rng.normal(size=fast.starts.shape) if given else None
    for call in ("forces", "action"):
        found = np.zeros((2, len(frames), 6))
        for residual, triangles in zip(found, (made, fast), strict=True):
            if call == "forces":
                triangles.add_forces(frames, residual, 0.7, starts)
            else:
                triangles.add_action(frames, steps, residual, (0.7, 0.2), starts)
        assert_same(*found)
    both = made, fast
    assert_same(*(triangles.tangents(frames, (0.7, 0.2), starts) for triangles in both))
    pairs = NodePairs(len(frames), [fast.nodes])
    sums = np.zeros((2, len(pairs.rows), 6, 6))
    for blocks, triangles in zip(sums, both, strict=True):
        triangles.add_tangents(frames, pairs.index[0], blocks, (0.7, 0.2), starts)
    assert_same(*sums)
