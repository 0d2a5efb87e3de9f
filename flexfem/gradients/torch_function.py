# SPDX-License-Identifier: LGPL-3.0-or-later
"""An analysis as a function of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._packages import require
from flexfem.gradients.motion.parameters import Build, Values, checked_values
from flexfem.gradients.products import Products, Wanted, products
from flexfem.gradients.states.analyses import Options
from flexfem.model.model import Model

__all__ = ["torch_function"]


def torch_function(
    model: Model | Build,
    of: Wanted,
    options: Options,
    *,
    ks_rho: float | None = None,
    comm: MPI.Intracomm | None = None,
) -> Callable[[Mapping[str, Any]], Any]:
    """An analysis as a function that PyTorch differentiates.

    It is called with tensors by the names of the parameters, in double precision; others than
    tensors are constants::

        tip = ff.torch_function(build, "final:tip_z", options)
        damping = torch.tensor(10.0, dtype=torch.float64, requires_grad=True)
        ((tip({"damping": damping}) + 0.3) ** 2).backward()

    Derivatives come from the adjoint by ``torch.autograd.Function``, one for any number of results
    and parameters; those forwards (``torch.autograd.forward_ad``) from the linearised motion. There
    are no second derivatives. On several ranks all of them make the same calls in the same order.

    Args:
        model: a function that builds the model from its parameters; or a model, whose parameters
            are paths into it ("spring.stiffness").
        of: numbers, see :func:`gradient`; or names of columns of a motion, for their values at all
            of its steps, (steps + 1,). One of them, or a list.
        options: those of the motion, the equilibria or the modes.
        ks_rho: of "ks", one over the unit of the column.
        comm: communicator, all ranks by default.

    Returns:
        Function of a dictionary of tensors () or (n,): the result, or with a list the results by
        name.

    Raises:
        InstallationError: PyTorch is missing: ``pip install flexfem[torch]``.
        TypeError, ValueError: as :func:`gradient`.
    """
    torch = require("torch")
    function, single = products(model, of, options, ks_rho, comm)

    def called(values: Mapping[str, Any]) -> Any:
        tensors = {}
        for name, value in values.items():
            if not isinstance(value, torch.Tensor):
                tensors[name] = torch.as_tensor(value, dtype=torch.float64)
            elif value.dtype == torch.float64:
                tensors[name] = value
            else:
                raise TypeError(f"torch_function: {name} must be of float64, got {value.dtype}")
        found = _function(torch).apply(function, tuple(tensors), *tensors.values())
        return found[0] if single else dict(zip(function.names, found, strict=True))

    return called


@cache
def _function(torch: Any) -> Any:
    """The class of PyTorch with all derivatives."""

    class Analysis(torch.autograd.Function):
        """Results of an analysis."""

        @staticmethod
        def forward(function: Products, names: tuple[str, ...], *tensors: Any) -> Any:
            found = function.value(_numbers(names, tensors))
            return tuple(torch.from_numpy(np.array(one)) for one in found)

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
            ctx.function, ctx.names, *tensors = inputs
            ctx.save_for_backward(*tensors)
            ctx.save_for_forward(*tensors)

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(ctx: Any, *weights: Any) -> Any:
            found = ctx.function.backward(
                _numbers(ctx.names, ctx.saved_tensors), [one.cpu().numpy() for one in weights]
            )
            return (None, None, *(torch.from_numpy(np.array(one)) for one in found.values()))

        @staticmethod
        def jvp(ctx: Any, _: None, __: None, *along: Any) -> Any:
            values = _numbers(ctx.names, ctx.saved_tensors)
            direction = _numbers(ctx.names, [
                torch.zeros_like(value) if way is None else way
                for value, way in zip(ctx.saved_tensors, along, strict=True)
            ])  # fmt: skip
            found = ctx.function.forward(values, direction)
            return tuple(torch.from_numpy(np.array(one)) for one in found)

    return Analysis


def _numbers(names: tuple[str, ...], tensors: Any) -> Values:
    """Tensors as parameters."""
    return checked_values({
        name: tensor.detach().cpu().numpy() for name, tensor in zip(names, tensors, strict=True)
    })  # fmt: skip
