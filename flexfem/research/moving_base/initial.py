# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modal coordinates of a beam's displacements, or velocities, at the start."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.research.moving_base.basis import Basis
from flexfem.research.moving_base.fields import centre_displacements

__all__ = ["TIP_FIELDS", "Shape", "check_shape", "coordinates_of"]

#: Fields whose values at the tip may be given, in the order of a basis.
TIP_FIELDS = ("s", "u2", "u3", "theta1")

#: Values at the tip by names, or a function of points x (m), (k,), to all six fields, (6, k).
Shape = Mapping[str, float] | Callable[[FloatArray], npt.ArrayLike]

#: Largest admissible residual of the fit to a given shape, relative to its size (root of the
#: inertia).
_LEFT = 0.1


def check_shape(owner: str, what: str, shape: Shape | None) -> None:
    """Check a shape without knowing the basis.

    Raises:
        TypeError: it is neither a mapping nor a function.
        ValueError: there is no such value of the tip, or one is no finite number.
    """
    if isinstance(shape, Mapping):
        for name, value in shape.items():
            if name not in TIP_FIELDS:
                raise ValueError(
                    f"{owner}: {what} '{name}' of the tip: there are {', '.join(TIP_FIELDS)}"
                )
            _checks.number(owner, f"{what} {name}", value)
    elif shape is not None and not callable(shape):
        raise TypeError(
            f"{owner}: {what} must be values of the tip by name or a function of x, got "
            f"{_checks.show(shape)}"
        )


def coordinates_of(basis: Basis, what: str, shape: Shape | None) -> FloatArray:
    """Modal coordinates of a shape, (n,).

    With values at the tip it is the shape that loads at the tip produce; values of u2, u3 and
    theta1 that are not given are zero. A function is projected with the inertia of the sections.

    Raises:
        ValueError: the functions of the basis cannot be so, or the function gives no (6, k) finite
            numbers.
    """
    if shape is None:
        return np.zeros(basis.size)
    return _loaded(basis, what, shape) if isinstance(shape, Mapping) else _near(basis, what, shape)


def _loaded(basis: Basis, what: str, given: Mapping[str, float]) -> FloatArray:
    values = {"u2": 0.0, "u3": 0.0, "theta1": 0.0, **given}
    rows = {name: basis.node_fields[TIP_FIELDS.index(name), -1] for name in values}
    for name in [name for name, row in rows.items() if not row.any()]:
        if values[name] != 0.0:
            raise ValueError(f"{what}: the beam has no function of {name}, got {values[name]:g}")
        del rows[name], values[name]
    if not rows:
        return np.zeros(basis.size)
    tip = np.array(list(rows.values()))
    bent = np.linalg.solve(basis.stiffness, tip.T)
    found, _, rank, _ = np.linalg.lstsq(tip @ bent, np.array(list(values.values())), rcond=1e-10)
    if rank < len(rows):
        raise ValueError(f"{what}: {basis.size} functions cannot take {', '.join(rows)} at the tip")
    out: FloatArray = bent @ found
    return out


def _near(basis: Basis, what: str, function: Callable[[FloatArray], npt.ArrayLike]) -> FloatArray:
    x, s = basis.quadrature.x, basis.sections
    fields = np.asarray(function(x), dtype=np.float64)
    if fields.shape != (6, len(x)) or not np.isfinite(fields).all():
        raise ValueError(
            f"{what}: six rows of finite numbers expected for {len(x)} points, got shape "
            f"{fields.shape}"
        )
    w, e = basis.quadrature.weights, s.eccentricity
    inertia = np.array([*[s.mass] * 3, *s.rotary]) * w
    ours = np.array([*centre_displacements(list(basis.fields), e), *basis.fields[3:]])
    theirs = np.array([*centre_displacements(list(fields), e), *fields[3:]])
    mass = np.einsum("fp,fpi,fpj->ij", inertia, ours, ours)
    out: FloatArray = np.linalg.solve(mass, np.einsum("fp,fpi,fp->i", inertia, ours, theirs))
    left = theirs - ours @ out
    part = np.sqrt(np.sum(inertia * left**2) / max(np.sum(inertia * theirs**2), 1e-300))
    if part > _LEFT:
        raise ValueError(
            f"{what}: {basis.size} functions cannot represent {100.0 * part:.3g} per cent of it; "
            "use more modes"
        )
    return out
