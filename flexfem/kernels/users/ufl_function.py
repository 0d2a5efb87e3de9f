# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of numbers that users write in UFL, compiled by FFCx with their exact derivatives."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from ufl.algorithms.analysis import extract_type
from ufl.constantvalue import ConstantValue
from ufl.core.expr import Expr
from ufl.core.multiindex import MultiIndex
from ufl.core.terminal import Terminal

from flexfem import _checks
from flexfem._faults import ReturnError
from flexfem._types import FloatArray
from flexfem.kernels.compiled import kernel
from flexfem.kernels.ffcx import compile_arguments, tabulate
from flexfem.kernels.ffcx_options import compile_options, quick_compiler, without_variables

__all__ = ["UFLFunction", "uses_ufl"]


def uses_ufl(function: Callable[..., Any]) -> bool:
    """True for a function in which something of UFL is named."""
    names = inspect.getclosurevars(function)
    return any(_is_ufls(value) for value in (*names.globals.values(), *names.nonlocals.values()))


def _is_ufls(value: object) -> bool:
    home = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return str(home).partition(".")[0] == "ufl"


class UFLFunction:
    """Lists of numbers as functions of other numbers.

    Attributes:
        x: UFL vector of the arguments, for the expressions.
        sizes, addresses: of each list, its length and the address of its kernel; the kernel adds
            one number more in front.
    """

    def __init__(self, count: int) -> None:
        """A function of ``count`` numbers; :meth:`compile` says which one."""
        domain = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
        self._constant = ufl.Constant(domain, (count,))
        self.x = ufl.variable(self._constant)
        self.sizes, self.addresses = list[int](), list[int]()

    @classmethod
    def of_vector(cls, what: str, function: Callable[[Any], Any], count: int) -> UFLFunction:
        """Value and gradient, its two lists, of a function of a UFL vector with ``count`` entries.

        Args:
            what: name of the function in messages.
            function: returns a UFL scalar.
            count: number of entries.

        Raises:
            ReturnError: it returns something else.
            ValueError: the expression depends on something else than the vector.
        """
        made = cls(count)
        found = function(ufl.as_vector([made.x[i] for i in range(count)]))
        try:
            value = ufl.as_ufl(found)
        except Exception as error:  # UFL raises many kinds
            raise ReturnError(
                f"{what} must return a UFL scalar, got {_checks.show(found)}"
            ) from error
        if value.ufl_shape != ():
            raise ReturnError(f"{what} must return a UFL scalar, got shape {value.ufl_shape}")
        made.compile([value], made.slopes([value]))
        return made

    def slopes(self, values: Sequence[Expr]) -> list[Expr]:
        """Derivatives of each value by each argument, value by value."""
        slopes = ufl.diff(ufl.as_vector(values), self.x)
        return [slopes[i, k] for i in range(len(values)) for k in range(len(self.x))]

    def compile(self, *lists: Sequence[Expr]) -> None:
        """Compile lists of expressions; cached on disk by FFCx.

        Raises:
            ValueError: they depend on something else than the arguments.
        """
        from ffcx.codegeneration.jit import compile_expressions

        # FFCx needs an argument in each, which constant values and derivatives do not have
        vectors = [without_variables(ufl.as_vector([self.x[0], *values])) for values in lists]
        known = (ConstantValue, MultiIndex)
        for vector in vectors:
            for one in extract_type(vector, Terminal):
                if not isinstance(one, known) and one != self._constant:
                    raise ValueError(f"depends on {one}, which is none of its arguments")
        # every rank for itself, as laws are called: processes wait for one another's files
        options = compile_options(MPI.COMM_SELF, compile_arguments(batched=False))
        with quick_compiler():
            compiled, self._module, _ = compile_expressions(
                [(vector, np.zeros((1, 1))) for vector in vectors],
                options=options["form_compiler_options"],
                **options["jit_options"],
            )
        cast = self._module.ffi.cast
        self.sizes = [len(values) for values in lists]
        self.addresses = [int(cast("uintptr_t", e.tabulate_tensor_float64)) for e in compiled]

    def evaluate(self, which: int, x: FloatArray) -> FloatArray:
        """A list's numbers (e, size) at arguments (e, n), in C order."""
        out = np.zeros((len(x), 1 + self.sizes[which]))
        _tabulate(self.addresses[which], x, out)
        return out[:, 1:]


@kernel
def _tabulate(address: int, x: FloatArray, out: FloatArray) -> None:
    """Add the numbers at ``address`` for each row of x to rows of ``out``."""
    for e in range(len(x)):
        tabulate(address, out[e], x[e], x[e], x[e])  # type: ignore[call-arg]
