# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sizes of the expressions of a formalism, and of the code that is generated from them.

derivatives   operators d/dq that the derivation applies: nodes of the form as it is written,
              counted once where they are shared
nodes         different nodes of all integrands after the derivatives are carried out and tensor
              algebra is written in components
terms         products that are left when these integrands are multiplied out, sums over free
              indices counted as one
operations    additions, subtractions, multiplications, divisions and function calls of the kernel
              that FFCx generates for one cell, loops taken as often as they run; what the C
              compiler saves beyond that is not seen
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import ufl
from ufl.algorithms import expand_derivatives
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.corealg.traversal import unique_pre_traversal

from flexfem.research.formalisms.derivation import BodyEnergies, kernel_parts

__all__ = ["FORMS", "Count", "count_form", "count_formalism"]

#: Expressions that a formalism evaluates for its equations of motion. Maggi's are combinations of
#: Lagrange's.
FORMS = {
    "lagrange": ("lagrange",),
    "gibbs_appell": ("gibbs_appell",),
    "maggi": ("lagrange",),
    "hamilton": ("momentum", "force"),
}


@dataclass(frozen=True)
class Count:
    """Sizes of the equations of a formalism for one cell; see the module for the counts."""

    derivatives: int
    nodes: int
    terms: int
    operations: int

    def __add__(self, other: "Count") -> "Count":
        """Of two forms together."""
        return Count(
            self.derivatives + other.derivatives, self.nodes + other.nodes,
            self.terms + other.terms, self.operations + other.operations,
        )  # fmt: skip


@cache
def count_formalism(formalism: str, energies: BodyEnergies) -> Count:
    """Sizes of all forms of a formalism."""
    counts = [count_form(getattr(energies, name)) for name in FORMS[formalism]]
    return sum(counts[1:], start=counts[0])


def count_form(form: ufl.Form) -> Count:
    """Sizes of one form; FFCx generates its code, which is not compiled."""
    derivatives = _derivatives(form)
    lowered = [apply_algebra_lowering(expand_derivatives(form))]
    integrands = [integral.integrand() for one in lowered for integral in one.integrals()]
    nodes = {node for integrand in integrands for node in unique_pre_traversal(integrand)}
    terms = sum(_terms(integrand, {}) for integrand in integrands)
    total = sum(count_operations(part) for part in kernel_parts(form))
    return Count(derivatives, len(nodes), terms, total)


def _derivatives(form: ufl.Form) -> int:
    """Derivative operators of a form as written, those within derivatives too."""
    found: set[Any] = set()
    for integral in form.integrals():
        for node in unique_pre_traversal(integral.integrand()):
            if isinstance(node, ufl.differentiation.CoefficientDerivative):
                found.add(node)
    return len(found)


def _terms(expression: Any, known: dict[Any, int]) -> int:
    """Products of an expression when it is multiplied out."""
    if expression in known:
        return known[expression]
    parts = [_terms(o, known) for o in expression.ufl_operands]
    if isinstance(expression, ufl.algebra.Product):
        count = parts[0] * parts[1]
    elif isinstance(expression, ufl.algebra.Sum):
        count = sum(parts)
    elif isinstance(expression, ufl.algebra.Power):
        exponent: Any = expression.ufl_operands[1]
        count = parts[0] ** int(exponent) if float(exponent) in (1.0, 2.0, 3.0) else 1
    elif isinstance(expression, ufl.tensors.ListTensor):
        count = sum(parts)
    elif isinstance(expression, ufl.core.terminal.Terminal) or not parts:
        count = 1
    else:
        count = parts[0]
    known[expression] = count
    return count


def count_operations(form: ufl.Form) -> int:
    """Floating-point operations of the kernel generated for a form, for one cell."""
    from ffcx.analysis import analyze_ufl_objects
    from ffcx.codegeneration.backend import FFCXBackend
    from ffcx.codegeneration.integral_generator import IntegralGenerator
    from ffcx.ir.representation import compute_ir
    from ffcx.options import get_options

    options: dict[str, Any] = dict(get_options({}))
    analysis = analyze_ufl_objects([form], options["scalar_type"])
    ir = compute_ir(analysis, {}, "counted", options, False)
    total = 0
    for integral in ir.integrals:
        for cell in {cell for cell, _ in integral.expression.integrand}:
            generator = IntegralGenerator(integral, FFCXBackend(integral, options))
            total += _operations(generator.generate(cell))
    return total


def _operations(node: Any) -> int:
    """Operations of a piece of generated code, loops taken as often as they run."""
    from ffcx.codegeneration import lnodes

    if isinstance(node, lnodes.ForRange):
        times = int(node.end.value) - int(node.begin.value)
        return times * _operations(node.body)
    own = 0
    arithmetic = (
        lnodes.Add, lnodes.Sub, lnodes.Mul, lnodes.Div, lnodes.Neg, lnodes.MathFunction,
        lnodes.AssignAdd, lnodes.AssignSub, lnodes.AssignMul, lnodes.AssignDiv,
    )  # fmt: skip
    if isinstance(node, arithmetic):
        own = 1
    elif isinstance(node, lnodes.Sum | lnodes.Product):
        own = len(node.args) - 1
    return own + sum(_operations(part) for part in _parts(node))


def _parts(node: Any) -> Iterator[Any]:
    """Pieces of generated code that do arithmetic: not the indices of arrays."""
    from ffcx.codegeneration import lnodes

    if isinstance(node, lnodes.ArrayAccess | lnodes.Comment | lnodes.ArrayDecl):
        return
    if isinstance(node, lnodes.AssignOp):
        yield node.rhs
        return
    for name in ("declarations", "statements", "args"):
        yield from getattr(node, name, ())
    for name in ("expr", "value", "lhs", "rhs", "arg", "condition", "true", "false"):
        part = getattr(node, name, None)
        if isinstance(part, lnodes.LNode):
            yield part
