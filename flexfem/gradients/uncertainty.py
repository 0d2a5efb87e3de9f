# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uncertainty of numbers of an analysis from that of its parameters, to first order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.gradients.gradient import Differentiation, Gradient
from flexfem.gradients.motion.functionals import Functional
from flexfem.gradients.motion.parameters import Values, check_names, flat, named, parameters
from flexfem.gradients.motion.records import MEMORY, Storage
from flexfem.gradients.states.analyses import Options
from flexfem.gradients.states.neighbours import by_name
from flexfem.model.model import Model

__all__ = ["Uncertainty", "uncertainty"]

#: Deviation from linearity, in standard deviations, from which on results are doubtful.
_LINEAR = 0.1
#: Error of a number that depends on no parameter, relative to it, and that of zero.
_NOISE, _ROUNDING = 1e-9, 1e-15
#: Least eigenvalue of a covariance matrix over its largest one, by rounding.
_NEGATIVE = 1e-9
_DOUBT = (
    "{}: a run one standard deviation aside differs by {:.2g} standard deviations from what is "
    "linear, so that the first order is not to be trusted: take smaller ones, or samples (sweep)"
)


@dataclass(frozen=True)
class Uncertainty:
    """Numbers with their standard deviations to first order.

    Attributes:
        value: of each number at the parameters' values, which is its mean to first order.
        deviation: its standard deviation.
        share: of each parameter in its variance, by the names of the number and of the parameter,
            (n,) of arrays; they add to 1, and may be negative where parameters are correlated.
        nonlinearity: largest difference between runs and what is linear, in standard deviations of
            the number; NaN if not checked.
        gradient: the gradient from which they are.
        warnings: which results are not to be trusted, and why.
    """

    value: Mapping[str, float]
    deviation: Mapping[str, float]
    share: Mapping[str, Mapping[str, float | FloatArray]]
    nonlinearity: Mapping[str, float]
    gradient: Gradient = field(repr=False)
    warnings: tuple[str, ...] = ()


def uncertainty(
    model: Model | Callable[..., Model],
    of: str | Functional | Sequence[str | Functional],
    wrt: Sequence[str] | Mapping[str, npt.ArrayLike],
    spread: Mapping[str, npt.ArrayLike] | npt.ArrayLike,
    options: Options,
    *,
    ks_rho: float | None = None,
    check: bool = True,
    memory: float = MEMORY,
    scratch: str | Path | None = None,
    comm: MPI.Intracomm | None = None,
) -> Uncertainty:
    """Standard deviations of numbers of an analysis from those of its parameters (collective).

    One gradient gives all of them, to first order (first-order second-moment method; JCGM 100:2008,
    eq. 13)::

        found = ff.uncertainty(model, "max:force", ["rod.density"], {"rod.density": 40.0}, options)
        found.deviation["max:force"]

    The check computes each number again where it should be larger by one standard deviation, along
    the most probable direction, and at random signs of all deviations. Where they differ from what
    is linear by a tenth of the standard deviation, a warning says so.

    Args:
        model: the model, or a function that builds it from the parameters.
        of: numbers, see :func:`gradient`.
        wrt: parameters, see there.
        spread: standard deviations of independent parameters by name, numbers or arrays (n,),
            others are known exactly; or the covariance matrix (n, n) of all numbers among them, in
            their order, such as ``covariance`` of :class:`Identification`.
        options: those of the motion, the equilibria or the modes.
        ks_rho: of "ks", one over the unit of the column.
        check: make these runs, one for each number and one more.
        memory: see there.
        scratch: see there.
        comm: communicator, all ranks by default.

    Raises:
        InputError, TypeError, StoppedError: as :func:`gradient`; a deviation is negative, or a
            matrix is no covariance matrix (a ValueError).
    """
    build, values = parameters(model, wrt)
    root = _root(spread, values)
    storage = Storage(memory, scratch)
    analysis = Differentiation(build, of, options, ks_rho=ks_rho, storage=storage, comm=comm)
    found = analysis.at(values)
    names = list(found.gradient)
    slopes = np.array([flat(values, found.gradient[name]) for name in names])
    scaled = slopes @ root
    deviation = np.sqrt((scaled**2).sum(axis=1))
    parts = slopes * (scaled @ root.T)  # g_i (C g)_i
    sums = np.where(deviation > 0.0, deviation**2, 1.0)[:, np.newaxis]
    off = np.full(len(names), np.nan)
    if check:
        points = root @ _directions(scaled, deviation)
        off = _nonlinearity(analysis, (values, found.value), points, (slopes, deviation))
    doubts = [
        _DOUBT.format(name, one) for name, one in zip(names, off, strict=True) if one > _LINEAR
    ]
    return Uncertainty(
        value=found.value,
        deviation=dict(zip(names, deviation.tolist(), strict=True)),
        share={n: by_name(row, values) for n, row in zip(names, parts / sums, strict=True)},
        nonlinearity=dict(zip(names, off.tolist(), strict=True)),
        gradient=found,
        warnings=(*found.warnings, *doubts),
    )


def _root(spread: Mapping[str, npt.ArrayLike] | npt.ArrayLike, values: Values) -> FloatArray:
    """Matrix R with the covariance R R^T of all numbers among the parameters, (n, n).

    Raises:
        ValueError: a deviation is of no parameter, or not one; a matrix is no covariance matrix.
    """
    if isinstance(spread, Mapping):
        found = {name: np.zeros(value.shape) for name, value in values.items()}
        check_names("uncertainty", "spread", values, spread)
        for name, given in spread.items():
            own = np.asarray(given, dtype=np.float64)
            if own.shape not in ((), values[name].shape) or not (own >= 0.0).all():
                raise ValueError(
                    f"uncertainty: spread of {name} must be one standard deviation or "
                    f"{values[name].size}, none negative, got {_checks.show(given)}"
                )
            if not np.isfinite(own).all():
                raise ValueError(
                    f"uncertainty: spread of {name} must be finite, got {_checks.show(given)}"
                )
            found[name][...] = own
        return np.diag(flat(values, found))
    matrix = np.asarray(spread, dtype=np.float64)
    count = sum(value.size for value in values.values())
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        raise ValueError(
            f"uncertainty: a covariance matrix must be ({count}, {count}) and finite, got "
            f"{_checks.show(matrix)}"
        )
    sizes = np.sqrt(np.abs(np.diag(matrix)))
    sizes[sizes == 0.0] = 1.0
    scaled = matrix / np.outer(sizes, sizes)
    eigenvalues, vectors = np.linalg.eigh(scaled)
    if eigenvalues[0] < -_NEGATIVE * eigenvalues[-1] or abs(scaled - scaled.T).max() > _NEGATIVE:
        raise ValueError(
            "uncertainty: a covariance matrix must be symmetric without negative eigenvalues"
        )
    root: FloatArray = sizes[:, np.newaxis] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    return root


def _directions(scaled: FloatArray, deviation: FloatArray) -> FloatArray:
    """Unit directions in which each number grows most, and random signs, as columns (n, k + 1)."""
    steepest = scaled[deviation > 0.0] / deviation[deviation > 0.0, np.newaxis]
    signs = np.random.default_rng(0).choice((-1.0, 1.0), scaled.shape[1])
    return np.vstack([steepest, signs]).T


def _nonlinearity(
    analysis: Differentiation, at: tuple[Values, Mapping[str, float]], points: FloatArray,
    linear: tuple[FloatArray, FloatArray],
) -> FloatArray:  # fmt: skip
    """Largest differences from what is linear at points (n, k), in standard deviations."""
    (values, centre), (slopes, deviation) = at, linear
    middle, still = flat(values, values), np.array(list(centre.values()))
    found = np.zeros(len(still))
    for point in points.T:
        moved = analysis.value(named(values, middle + point))
        off = np.abs(np.array(list(moved.values())) - still - slopes @ point)
        off[off <= _NOISE * np.abs(still) + _ROUNDING] = 0.0
        vanishing = np.where(off > 0.0, np.inf, 0.0)
        found = np.maximum(found, np.divide(off, deviation, out=vanishing, where=deviation > 0.0))
    return found
