# SPDX-License-Identifier: LGPL-3.0-or-later
"""FFCx language backend: cell kernels in C that evaluate several cells in one call.

FFCx's code for a beam is one long sequence of additions and products. The same statements in a
loop over ``LANES`` cells, whose data are interleaved, are vectorised by the C compiler: five times
the speed with eight lanes of 512 bits, three times with four.

FFCx imports this module by the name that its option ``language`` gives, and takes the generators of
integrals, forms, expressions and files from it. All but integrals are those of plain C.
Kernels are called by address with packed coefficients; DOLFINx cannot assemble with them.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
from ffcx.codegeneration import lnodes
from ffcx.codegeneration.backend import FFCXBackend
from ffcx.codegeneration.C import Formatter, expression, file, form
from ffcx.codegeneration.C.integral_template import declaration, factory
from ffcx.codegeneration.integral_generator import IntegralGenerator

from flexfem.kernels.lanes import LANES

__all__ = ["BatchFormatter", "expression", "file", "form", "integral"]

#: Arrays whose entry k of lane l is at ``k LANES + l``: the tensor and the coefficients.
_LANE_BY_LANE = ("A", "w")
_LOOP = """\
#pragma omp simd simdlen({lanes})
for (int lane = 0; lane < {lanes}; ++lane)
{{
{body}}}
"""


class BatchFormatter(Formatter):
    """Formatter of C code with the entries of tensor and coefficients moved to one lane.

    Raises:
        ValueError: the arrays are used in another way than by one index.
    """

    def __call__(self, node: lnodes.LNode) -> str:
        """C code of one node of FFCx's syntax tree."""
        if isinstance(node, lnodes.ArrayAccess) and node.array.name in _LANE_BY_LANE:
            (index,) = node.indices
            return f"{node.array.name}[({self(index)}) * {LANES} + lane]"
        if isinstance(node, lnodes.Symbol) and node.name in _LANE_BY_LANE:
            raise ValueError(f"the code that FFCx generates has changed: {node.name} without index")
        return super().__call__(node)


def _integral(ir: Any, domain: Any, options: dict[str, Any]) -> tuple[str, str]:
    """Declaration and code of an integral, as FFCx's generator for plain C returns them."""
    name = f"{ir.expression.name}_{domain.name}"
    statements = IntegralGenerator(ir, FFCXBackend(ir, options)).generate(domain)
    body = BatchFormatter(np.float64)(statements)
    others = ("float32", "complex64", "complex128")
    code = factory.format(
        factory_name=name,
        # the caller chooses the coefficients to be packed
        enabled_coefficients="NULL",
        enabled_coefficients_init="",
        tabulate_tensor=_LOOP.format(lanes=LANES, body=body),
        needs_facet_permutations="false",
        scalar_type="double",
        geom_type="double",
        coordinate_element_hash=f"UINT64_C({ir.expression.coordinate_element_hash})",
        tabulate_tensor_float64=f".tabulate_tensor_float64 = tabulate_tensor_{name},",
        **{f"tabulate_tensor_{kind}": f".tabulate_tensor_{kind} = NULL," for kind in others},
        domain=int(domain),
    )
    return declaration.format(factory_name=name), code


integral = SimpleNamespace(generator=_integral)
