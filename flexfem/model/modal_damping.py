# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of the modes of a model."""

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, located
from flexfem._fields import Given, checked, declared, whole_number
from flexfem._types import FloatArray
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell
from flexfem.model.structure.structure import Structure

__all__ = ["ModalDamping"]

#: Number of damped modes where nothing else is said.
_MODES = 10


def _ratio(owner: str, what: str, value: Any) -> Any:
    """Return checked ratios, or a function as it is."""
    return value if callable(value) else _checked(owner, what, np.atleast_1d(value))


def _checked(owner: str, what: str, value: Any) -> FloatArray:
    """Return ratios (k,) from 0 to below 1."""
    ratios = _checks.array(owner, what, value, (np.size(value),))
    if not len(ratios) or (ratios < 0.0).any() or (ratios >= 1.0).any():
        got = _checks.show(np.asarray(value).tolist())
        raise ValueError(f"{owner}: {what} must be numbers from 0 to below 1, got {got}")
    return ratios


def _bodies(owner: str, what: str, value: Any) -> tuple[str, ...] | None:
    """Return checked names, or None."""
    if value is None:
        return None
    names = [value] if isinstance(value, str) else value
    _checks.instance(owner, what, names, (list, tuple))
    found = tuple(_checks.text(owner, what, name) for name in names)
    if not found or len(set(found)) < len(found):
        got = _checks.show(list(found))
        raise ValueError(f"{owner}: {what} must be names, each once, got {got}")
    return found


@declared
class ModalDamping:
    """Damping ratios of the lowest elastic modes of a model.

    The modes are those of the whole model without stress, with its joints, springs, rigid bodies
    and masses, in the configuration of the mesh, without gravity, contact, dampers and motion. In
    this state the damping is ``C = sum_i 2 zeta_i / omega_i^3 (K x_i)(K x_i)^T`` over modes of unit
    modal mass, which is ``sum_i 2 zeta_i omega_i (M x_i)(M x_i)^T`` (E. L. Wilson, J. Penzien, Int.
    J. Numer. Methods Eng. 4 (1972) 5-10): every mode has its ratio, and modes are not coupled.

    In a motion the amplitude of a mode is the projection of the elements' strains on those of the
    mode, ``a_i = (integral of sigma_i . epsilon) / omega_i^2``, and its damper pulls on them
    by the stresses ``sigma_i``. Strains do not know rigid motions, however large: these are not
    damped, both momenta are kept, and the dampers always take energy.

    Ratios are those of the modes without stress: about a state that is stressed or bent the modes,
    and so the ratios, are others. Modes beyond the last are not damped by this; `damping` of bodies
    adds to it. Modes that store less than half of their strain energy in the bodies (those of
    springs, of other bodies) are left out; of several modes of one frequency, such as those of
    equal bodies, each body's own shapes are taken.

    Attributes:
        name: Unique name in the model.
        ratio: Damping ratio zeta, from 0 to below 1: a number for all modes; one for each mode,
            from the lowest elastic one on; or a function of the frequency without damping, Hz, such
            as a :class:`Table` (frequencies, ratios).
        modes: Number of damped modes, 10 or the length of `ratio` by default. Modes of the same
            frequency as the last are damped as well.
        bodies: Names of the beams and shells whose strains are damped, None for all in the model.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A ratio outside of [0, 1), no modes, or other modes than ratios.
    """

    name: str
    ratio: Given[
        npt.ArrayLike | Callable[[float], float], FloatArray | Callable[[float], float]
    ] = checked(_ratio)
    _: KW_ONLY
    modes: int | None = whole_number(least=1, default=None)
    bodies: tuple[str, ...] | None = checked(_bodies, default=None)

    def __post_init__(self) -> None:
        """Check that there is a ratio for every mode."""
        if callable(self.ratio) or len(self.ratio) == 1 or self.modes is None:
            return
        if self.modes != len(self.ratio):
            owner = _checks.named(self, self.name)
            raise ValueError(f"{owner}: {len(self.ratio)} ratios, but modes={self.modes}")

    @property
    def count(self) -> int:
        """Number of damped modes."""
        if self.modes is not None:
            return self.modes
        return _MODES if callable(self.ratio) or len(self.ratio) == 1 else len(self.ratio)

    def ratios(self, frequencies: FloatArray) -> FloatArray:
        """Ratios (k,) of modes of ascending frequencies (k,), Hz.

        Raises:
            ValueError: The function fails, or does not return ratios in [0, 1).
        """
        if callable(self.ratio):
            owner, given = _checks.named(self, self.name), self.ratio
            try:
                values = [_checks.returned_number("ratio", given(f)) for f in frequencies.tolist()]
            except ReturnError as error:
                raise ValueError(f"{owner}: {error}") from None
            except FAILURES as error:
                raise ValueError(f"{owner}: ratio: {located(given, error)}") from error
            return _checked(owner, "ratio", values)
        if len(self.ratio) == 1:
            return np.repeat(self.ratio, len(frequencies))
        return self.ratio[np.minimum(np.arange(len(frequencies)), len(self.ratio) - 1)]

    def damped(self, model: Structure) -> list[Beam | Shell]:
        """The bodies of a model whose strains are damped."""
        found: list[Beam | Shell] = [*model.beams, *model.shells]
        return found if self.bodies is None else [b for b in found if b.name in self.bodies]

    def check(self, model: Structure) -> None:
        """Check the bodies.

        Raises:
            ValueError: There is no such beam or shell, it has a law, or damps twice.
        """
        owner = f'ModalDamping "{self.name}"'
        for name in self.bodies or ():
            if not isinstance(model.get(name), (Beam, Shell)):
                raise ValueError(f'{owner}: {model!r} has no beam or shell "{name}"')
        if not self.damped(model):
            raise ValueError(f"{owner}: {model!r} has no beams and no shells")
        others = [thing for thing in model.of(ModalDamping) if thing is not self]
        for body in self.damped(model):
            what = f'{type(body).__name__} "{body.name}"'
            if getattr(body.section, "law", None) is not None:
                raise ValueError(f"{owner}: {what} has a law, modes are those of linear sections")
            for other in others:
                if body in other.damped(model):
                    raise ValueError(f'{owner}: {what} is damped by "{other.name}" already')
