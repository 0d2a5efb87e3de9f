# SPDX-License-Identifier: LGPL-3.0-or-later
"""An analysis as a function of JAX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._packages import require
from flexfem.gradients.motion.parameters import Build, Values, checked_values
from flexfem.gradients.products import Products, Wanted, products
from flexfem.gradients.states.analyses import Options
from flexfem.model.model import Model

__all__ = ["jax_function"]

#: A function of values by name: a result, or several by name.
JaxFunction = Callable[[Mapping[str, Any]], Any]


def jax_function(
    model: Model | Build,
    of: Wanted,
    options: Options,
    *,
    mode: str = "reverse",
    ks_rho: float | None = None,
    comm: MPI.Intracomm | None = None,
) -> JaxFunction:
    """An analysis as a function that JAX differentiates, compiles around and maps.

    It is called with values of the parameters by name::

        tip = ff.jax_function(build, "final:tip_z", options)
        jax.grad(lambda p: (tip(p) + 0.3) ** 2)({"damping": 10.0})

    Values come from ``jax.pure_callback``, derivatives from the adjoint by ``jax.custom_vjp``, one
    for any number of results and parameters, or from the linearised motion by ``jax.custom_jvp``.
    There are no second derivatives. On several ranks all of them make the same calls in the same
    order. JAX must have double precision: ``jax.config.update("jax_enable_x64", True)``.

    Args:
        model: a function that builds the model from its parameters; or a model, whose parameters
            are paths into it ("spring.stiffness").
        of: numbers, see :func:`gradient`; or names of columns of a motion, for their values at all
            of its steps, (steps + 1,). One of them, or a list.
        options: those of the motion, the equilibria or the modes.
        mode: "reverse" for ``jax.grad``, ``jax.vjp`` and ``jax.jacrev``; "forward" for ``jax.jvp``
            and ``jax.jacfwd``.
        ks_rho: of "ks", one over the unit of the column.
        comm: communicator, all ranks by default.

    Returns:
        Function of a dictionary of numbers or arrays (n,): the result, or with a list the results
        by name.

    Raises:
        InstallationError: JAX is missing: ``pip install flexfem[jax]``.
        TypeError, ValueError: as :func:`gradient`. Errors inside a call are in a message of JAX.
    """
    jax = require("jax")
    if mode not in ("reverse", "forward"):
        raise ValueError(
            f'jax_function: mode must be "reverse" or "forward", got {_checks.show(mode)}'
        )
    function, single = products(model, of, options, ks_rho, comm)
    own = _reverse(jax, function) if mode == "reverse" else _forward(jax, function)

    def called(values: Mapping[str, Any]) -> Any:
        if not jax.config.jax_enable_x64:
            raise ValueError(
                'jax_function: JAX must have double precision: jax.config.update("jax_enable_x64", '
                "True)"
            )
        given = {name: jax.numpy.asarray(value, dtype=float) for name, value in values.items()}
        found = own(given)
        return found[0] if single else dict(zip(function.names, found, strict=True))

    return called


def _reverse(jax: Any, function: Products) -> Callable[..., Any]:
    """With derivatives by the adjoint."""

    @jax.custom_vjp
    def own(values: Mapping[str, Any]) -> Any:
        return _value(jax, function, values)

    def before(values: Mapping[str, Any]) -> Any:
        return _value(jax, function, values), values

    def after(values: Mapping[str, Any], weights: Sequence[Any]) -> Any:
        def called(at: Mapping[str, Any], by: Sequence[Any]) -> Values:
            return function.backward(_numbers(at), [np.asarray(one) for one in by])

        like = {name: _like(jax, value.shape) for name, value in values.items()}
        return (jax.pure_callback(called, like, values, weights, vmap_method="sequential"),)

    own.defvjp(before, after)
    found: Callable[..., Any] = own
    return found


def _forward(jax: Any, function: Products) -> Callable[..., Any]:
    """With derivatives by the linearised motion."""

    @jax.custom_jvp
    def own(values: Mapping[str, Any]) -> Any:
        return _value(jax, function, values)

    @own.defjvp
    def tangent(at: Sequence[Any], along: Sequence[Any]) -> Any:
        def called(values: Mapping[str, Any], direction: Mapping[str, Any]) -> Any:
            return function.forward(_numbers(values), _numbers(direction))

        like = [_like(jax, shape) for shape in function.shapes]
        change = jax.pure_callback(called, like, at[0], along[0], vmap_method="sequential")
        return own(at[0]), change

    found: Callable[..., Any] = own
    return found


def _value(jax: Any, function: Products, values: Mapping[str, Any]) -> Any:
    """The results."""

    def called(at: Mapping[str, Any]) -> Any:
        return function.value(_numbers(at))

    like = [_like(jax, shape) for shape in function.shapes]
    return jax.pure_callback(called, like, values, vmap_method="sequential")


def _like(jax: Any, shape: tuple[int, ...]) -> Any:
    return jax.ShapeDtypeStruct(shape, np.float64)


def _numbers(values: Mapping[str, npt.ArrayLike]) -> Values:
    """Arrays of JAX as parameters."""
    return checked_values({name: np.asarray(value) for name, value in values.items()})
