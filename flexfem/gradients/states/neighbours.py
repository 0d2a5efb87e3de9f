# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models that differ from another one in one parameter, at the same state.

Derivatives by a number are extrapolated central differences, see ``core.differences``. Entries of
matrices of stiff bodies are 1e6 to 1e10 times what a slow mode feels of them: so much is rounding
over the step, which is as long as suits what is differentiated.

Those of residuals by places of nodes are ``(f(-2) - 8 f(-1) + 8 f(1) - f(2)) / (12 h)``, error
``h^4 f^(5) / 30`` (Fornberg, Math. Comp. 51 (1988) 699-706).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL, extrapolated
from flexfem.gradients.equations.node_maps import following
from flexfem.gradients.motion.parameters import (
    Build,
    NodePath,
    Values,
    flattened,
    plain,
    refusing,
)
from flexfem.gradients.motion.support import check_layout
from flexfem.gradients.states.eigenvectors import ComplexArray
from flexfem.model.model import Model
from flexfem.system.system import System

__all__ = [
    "NodeParameters", "Parameter", "by_name", "check_path_independent", "check_without_sliders",
    "derivatives_by", "derivatives_of_classes", "parameters_alone", "parameters_of", "place",
]  # fmt: skip

#: Step of differences by places of nodes, relative to displacements.
_NODES = 1e-3
#: Errors of derivatives relative to these, from which on functions are not smooth. What is less
#: than so many roundings over the size of the number, or than a part of the largest derivative, is
#: noise.
_ROUGH, _NOISE, _NOTHING = 1e-3, 1e6, 1e-9


@dataclass(frozen=True)
class Parameter:
    """One number among the parameters.

    Attributes:
        build: a model of all values.
        values: of all parameters.
        name: of this one.
        entry: number of the entry of an array, None for a number.
    """

    build: Build
    values: Values
    name: str
    entry: int | None = None
    count = 1

    @property
    def value(self) -> float:
        """Its value."""
        given = self.values[self.name]
        return float(given if self.entry is None else given[self.entry])

    @property
    def text(self) -> str:
        """Its name in messages."""
        return self.name if self.entry is None else f"{self.name}[{self.entry}]"

    @property
    def size(self) -> float:
        """What steps are relative to: its value, or a tenth if that is zero."""
        return abs(self.value) or 0.1

    def beside(self, offset: float) -> Model:
        """The model with another value.

        Raises:
            InputError: there is none with such a value.
        """
        moved: FloatArray = np.array(self.values[self.name])
        moved[() if self.entry is None else self.entry] = self.value + offset
        with refusing(self.text):
            return self.build(**plain({**self.values, self.name: moved}))


@dataclass(frozen=True)
class NodeParameters:
    """Places of the nodes of a group.

    Attributes:
        build: a model of all values.
        values: of all parameters.
        name: path to the nodes.
    """

    build: Build
    values: Values
    name: str

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return self.values[self.name].size

    def neighbours(self, by: FloatArray) -> Iterator[tuple[Model, float]]:
        """Models at the places of differences along displacements (n, 3), m, with weights.

        Raises:
            InputError: one is refused.
        """
        for place, weight in STENCIL:
            moved = self.values[self.name] + place * _NODES * by
            with refusing(self.name):
                model = self.build(**plain({**self.values, self.name: moved}))
            yield model, weight / _NODES


def derivatives_by(
    parameter: Parameter, difference: Callable[[float], ComplexArray], rounding: FloatArray
) -> ComplexArray:
    """Derivatives (n,) of functions by a number (collective).

    Args:
        parameter: the number.
        difference: ``(f(h) - f(-h)) / (2 h)``, (n,), of a step h, the same on all ranks.
        rounding: (n,) of f.

    Raises:
        InputError: differences do not settle as steps become short, as where f jumps.
    """

    def parts(step: float) -> FloatArray:
        return np.asarray(difference(step), dtype=np.complex128).view(np.float64)

    own, errors = extrapolated(parts, parameter.size, np.repeat(rounding, 2))
    found, off = (np.asarray(one).view(np.complex128) for one in (own, errors))
    noise = _NOISE * rounding / parameter.size + _NOTHING * np.abs(found).max(initial=0.0)
    if (np.abs(off) > _ROUGH * np.abs(found) + noise).any():
        raise InputError(
            f'gradient: the equations jump where "{parameter.text}" changes, and have no derivative'
        )
    return found


def derivatives_of_classes[T: np.generic](
    parameters: Sequence[Parameter], changes: Callable[[Parameter], npt.NDArray[T]],
    classes: Collection[tuple[int, ...]],
) -> dict[int, npt.NDArray[T]]:  # fmt: skip
    """Derivatives (parameters,) of each of some values, by its number (collective).

    Args:
        parameters: numbers.
        changes: derivatives of all classes by one of them.
        classes: numbers of equal values, of which the mean has derivatives.
    """
    found = np.array([changes(one) for one in parameters]).reshape(len(parameters), len(classes))
    rows = zip(classes, found.T, strict=True)
    return {number: row for numbers, row in rows for number in numbers}


def parameters_of(build: Build, values: Values) -> list[Parameter | NodeParameters]:
    """All numbers among the parameters, and nodes of groups with all of theirs."""
    flat_build, flat_values = flattened(build, values)
    found: list[Parameter | NodeParameters] = []
    for name, given in values.items():
        if NodePath.of(name):
            found.append(NodeParameters(build, values, name))
            continue
        entries = range(given.size) if given.ndim else (None,)
        found += [Parameter(flat_build, flat_values, name, entry) for entry in entries]
    return found


def parameters_alone(build: Build, values: Values) -> list[Parameter]:
    """All numbers among the parameters.

    Raises:
        InputError: some are nodes of a group.
    """
    found = []
    for one in parameters_of(build, values):
        if isinstance(one, NodeParameters):
            raise InputError(
                f"gradient: frequencies, responses and buckling loads have no derivatives by "
                f'"{one.name}" yet; take numbers on which a mesh depends'
            )
        found.append(one)
    return found


def by_name(row: FloatArray, values: Values) -> dict[str, float | FloatArray]:
    """Derivatives by the names of parameters, numbers or arrays.

    Args:
        row: in the order of :func:`parameters_of`.
        values: of all parameters.
    """
    found: dict[str, float | FloatArray] = {}
    at = 0
    for name, given in values.items():
        own = row[at : at + given.size].reshape(given.shape)
        found[name] = own.copy() if given.ndim else float(own)
        at += given.size
    return found


def place(base: System, other: System, name: str) -> None:
    """Bring the system of a neighbour to the state of another one (collective).

    Nodes follow their starts, fixed ones among them: strains of stiff bodies whose shape changes
    in place would be far larger than those of the state.

    Raises:
        InputError: it has another number of nodes or joints.
    """
    check_layout(base, other, name)
    for part, own in zip(base.parts, other.parts, strict=True):
        own.block.frames0[:] = following(part.block, own.block)
        own.block.reset()
    rows, own_rows = base.constraints, other.constraints
    own_rows.angles[:] = rows.angles
    own_rows.lines.restore_places(rows.lines.accepted_places())
    own_rows.lines.angles[:] = rows.lines.angles
    other.interface.update()


def check_path_independent(model: Model, system: System) -> None:
    """Refuse what has a memory, and what has no derivatives yet (collective).

    Raises:
        InputError: naming it.
    """
    kinds: Sequence[tuple[str, Sequence[object]]] = (
        ("Contact", model.contacts), ("Controller", model.controllers),
        ("ModalDamping", model.modal_dampings),
    )  # fmt: skip
    for kind, things in kinds:
        for thing in things:
            raise InputError(
                f'gradient: {kind} "{getattr(thing, "name", "")}" has no derivatives yet; leave '
                "it out"
            )
    rows = system.constraints
    found: dict[str, Callable[[], bool]] = {
        "force elements": lambda: bool(rows.elements.groups),
        "friction": lambda: (
            bool(len(rows.coupled) or len(rows.wrapped_rows)) or bool(rows.frictional.any())
        ),
        "stops and other unilateral forces": lambda: bool(rows.unilateral.any()),
        "redundant constraints": lambda: rows.relaxation != 0.0,
        "internal variables of elements": lambda: system.remembering,
    }
    for name, present in found.items():
        if any(system.comm.allgather(present())):
            raise InputError(f"gradient: there are no derivatives of {name} yet; leave them out")


def check_without_sliders(system: System) -> None:
    """Refuse sliders on lines, whose rows change from element to element (collective).

    Raises:
        InputError: there are some.
    """
    if any(system.comm.allgather(bool(system.constraints.lines.joints))):
        raise InputError(
            "gradient: there are no derivatives of frequencies, responses and buckling loads with "
            "sliders on lines yet; leave them out"
        )
