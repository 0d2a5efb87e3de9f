# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled cell kernels."""

from mpi4py import MPI

import basix.ufl
import numba
import numpy as np
import pytest
import ufl
from ffcx.codegeneration import lnodes

from flexfem.forms.beam import beam_forms
from flexfem.forms.beam_law import constant_field, interval_mesh
from flexfem.kernels.ffcx import compile_kernel, tabulate
from flexfem.kernels.ffcx_backend import BatchFormatter
from flexfem.kernels.lanes import LANES


@numba.njit
def _call(address, tensor, data, constants, points):
    tabulate(address, tensor, data, constants, points)


@pytest.mark.three_ranks
@pytest.mark.parametrize("damped", [False, True])
def test_batched_kernel_treats_every_lane_as_the_kernel_of_one_cell(damped):
    forms = beam_forms(damped)
    given = MPI.COMM_WORLD, forms.residual, tuple(forms.coefficients.values())
    kernel, batched = compile_kernel(*given), compile_kernel(*given, batched=True)
    data = np.random.default_rng(7).normal(size=(kernel.offsets[-1], LANES))
    gravity, points = np.array([0.1, 0.2, -9.81]), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    together = np.ones((12, LANES))
    _call(batched.address, together, data, gravity, points)
    for lane in range(LANES):
        alone = np.ones(12)  # kernels add to what is there
        _call(kernel.address, alone, data[:, lane].copy(), gravity, points)
        # the same operations in the same order, but for contractions to fused products: an index
        # moved to a wrong lane changes every digit
        np.testing.assert_allclose(together[:, lane], alone, rtol=1e-10, atol=1e-10)


@pytest.mark.serial
def test_batched_kernels_may_branch():
    mesh = interval_mesh()
    space = ufl.FunctionSpace(mesh, basix.ufl.element("Lagrange", "interval", 1))
    f = constant_field(mesh)
    value = ufl.conditional(ufl.gt(f, 0.0), f, -3.0 * f)
    form = value / ufl.CellVolume(mesh) * ufl.TestFunction(space) * ufl.dx(mesh, degree=0)
    kernel = compile_kernel(MPI.COMM_WORLD, form, (f,), batched=True)
    data, found = np.linspace(-1.0, 1.0, LANES).reshape(1, LANES), np.zeros((2, LANES))
    _call(kernel.address, found, data, np.zeros(1), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    # one branch for all lanes gives some the wrong factor
    expected = 0.5 * np.where(data > 0.0, data, -3.0 * data)
    np.testing.assert_allclose(found, np.tile(expected, (2, 1)), rtol=1e-14)


@pytest.mark.serial
def test_code_of_another_shape_is_refused():
    tensor, data = (lnodes.Symbol(name, dtype=lnodes.DataType.SCALAR) for name in "Aw")
    index = lnodes.Symbol("i", dtype=lnodes.DataType.INT)
    code = BatchFormatter(np.float64)(lnodes.AssignAdd(tensor[0], data[index * 3 + 1]))
    assert code == f"A[(0) * {LANES} + lane] += w[(i * 3 + 1) * {LANES} + lane];\n"
    pointer = lnodes.Symbol("v", dtype=lnodes.DataType.SCALAR)
    with pytest.raises(ValueError, match="FFCx"):
        BatchFormatter(np.float64)(lnodes.VariableDecl(pointer, data + 3))
