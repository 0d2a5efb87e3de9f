# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dissipation of contacts over a step, after ``primitives.steps``."""

from flexfem.contact.dissipation.data import KNOWN, Groups, Law, StepMotion
from flexfem.contact.dissipation.friction import rub
from flexfem.contact.dissipation.groups import collect
from flexfem.contact.dissipation.normal import damp
from flexfem.contact.primitives.data import Pairs, Response
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["dissipate"]


@kernel
def dissipate(pairs: Memory, response: Memory, law: Memory, motion: Memory, groups: Memory) -> None:
    """Write the groups of pairs that act in a step, with friction, and apply damping.

    Args:
        pairs: of :class:`Pairs`.
        response: their response to the step; its forces and slopes are multiplied by the factor of
            damping.
        law: of :class:`Law`.
        motion: the same step, of :class:`StepMotion`.
        groups: result, of :class:`Groups`.
    """
    own, out, result = unpack(Pairs, pairs), unpack(Response, response), unpack(Groups, groups)
    rule, step = unpack(Law, law), unpack(StepMotion, motion)
    first = number = found = 0
    result.losses[:] = 0.0
    while first < out.count[0]:
        while own.starts[number + 1] <= out.pairs[first]:
            number += 1
        end = first + 1
        while end < out.count[0] and out.pairs[end] < own.starts[number + 1]:
            end += 1
        if collect(own, out, first, end, result, found):
            last, result.every[found] = result.last[number], number
            result.rows[found, 0], result.rows[found, 1] = first, end
            if rule.damping > 0.0:
                damp(own, out, rule, step, result, found)
            if rule.static_friction > 0.0:
                rub(rule, step, result, found, last)
            last[KNOWN] = 1.0
            found += 1
        first = end
    result.count[0] = found
