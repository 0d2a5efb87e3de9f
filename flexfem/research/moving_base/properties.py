# SPDX-License-Identifier: LGPL-3.0-or-later
"""Properties of a beam's sections along its axis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import sqrt, tanh

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["BeamProperties", "Piecewise", "effective_torsion_constant"]


@dataclass(frozen=True)
class Piecewise:
    """A value for each segment of a beam.

    Attributes:
        ends: where the segments end, growing, the last one at the beam's end, m.
        values: one for each segment.
    """

    ends: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            TypeError: they are none.
            ValueError: the ends do not grow from zero, or the numbers of both differ.
        """
        ends = _checks.array("Piecewise", "ends", self.ends, (-1,))
        values = _checks.array("Piecewise", "values", self.values, (-1,))
        if not len(ends) or (np.diff(ends, prepend=0.0) <= 0.0).any():
            raise ValueError(f"Piecewise: ends must grow from zero, got {_checks.show(self.ends)}")
        if len(values) != len(ends):
            raise ValueError(f"Piecewise: {len(values)} values for {len(ends)} ends")
        _checks.assign(self, ends=ends, values=values)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values at points that are no ends of segments."""
        at: FloatArray = np.asarray(self.values)[
            np.minimum(np.searchsorted(self.ends, x), len(self.values) - 1)
        ]
        return at


#: A number, a value for each segment, or a function of points x (m), shape (k,), to values (k,).
Property = float | Piecewise | Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class BeamProperties:
    """Section properties along a straight beam, each a number, piecewise, or a function of x.

    Elastic, flexural and twist centres lie on the axis a1; a2 and a3 are principal axes.

    Attributes:
        length: m.
        youngs_modulus, shear_modulus: E0 and G, N/m^2.
        mass_per_length: rho, kg/m.
        area: A0, m^2.
        second_moment_2, second_moment_3: I2 and I3 about the axes parallel to a2 and a3, m^4: I2
            resists displacements u3, I3 displacements u2.
        shear_ratio_2, shear_ratio_3: alpha2 and alpha3, at least 1: the shear areas are A0/alpha.
        torsion_constant: kappa, m^4.
        warping_constant: Gamma, m^6.
        eccentricity_2, eccentricity_3: mass centre relative to the elastic centre, m.
    """

    length: float
    youngs_modulus: Property
    shear_modulus: Property
    mass_per_length: Property
    area: Property
    second_moment_2: Property
    second_moment_3: Property
    torsion_constant: Property
    shear_ratio_2: Property = 1.0
    shear_ratio_3: Property = 1.0
    warping_constant: Property = 0.0
    eccentricity_2: Property = 0.0
    eccentricity_3: Property = 0.0

    def __post_init__(self) -> None:
        """Check the data that need no mesh.

        Raises:
            TypeError: a property is neither number nor function.
            ValueError: a number is out of range, or segments end somewhere else than the beam.
        """
        _checks.number("BeamProperties", "length", self.length, positive=True)
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if isinstance(value, Piecewise):
                if abs(value.ends[-1] - self.length) > 1e-9 * self.length:
                    raise ValueError(
                        f"BeamProperties: {field.name} ends at {value.ends[-1]:g} m, the beam at "
                        f"{self.length:g} m"
                    )
            elif not callable(value):
                _checks.number("BeamProperties", field.name, value)
        # before the first section where they are functions: all points come later
        self.at(self.length * (np.arange(32) + 0.5) / 32)

    @property
    def breaks(self) -> FloatArray:
        """Ends of all segments, with the beam's ends, (k,), m."""
        ends = [0.0, self.length]
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if isinstance(value, Piecewise):
                ends += list(value.ends[:-1])
        return np.unique(np.array(ends, dtype=np.float64))

    def gauss_points(self) -> tuple[FloatArray, FloatArray]:
        """Eight points in each segment, (k,), and the lengths that they represent, m."""
        at, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * np.diff(self.breaks)
        middles = self.breaks[:-1] + half
        points: FloatArray = (middles[:, np.newaxis] + half[:, np.newaxis] * at).ravel()
        return points, np.outer(half, weights).ravel()

    def at(self, x: FloatArray) -> dict[str, FloatArray]:
        """Values of all properties at points, by name; arrays (k,).

        Raises:
            ValueError: a value is out of range, or a function returns something else.
        """
        out = {}
        for field in fields(self)[1:]:
            name, value = field.name, getattr(self, field.name)
            values = np.asarray(value(x) if callable(value) else value, dtype=np.float64)
            if values.shape not in ((), x.shape):
                raise ValueError(
                    f"BeamProperties: {name} returns shape {values.shape} for {len(x)} points"
                )
            values = np.broadcast_to(values, x.shape)
            least = 1.0 if name.startswith("shear_ratio") else 0.0
            free = name.startswith("eccentricity")
            zero = name == "warping_constant"
            good = np.isfinite(values) & (free | (values > least) | (values == least) & (
                zero | (least == 1.0)
            ))  # fmt: skip
            if not good.all():
                bound = "finite" if free else f">= {least:g}" if zero or least else "> 0"
                raise ValueError(
                    f"BeamProperties: {name} must be {bound}, got {values[~good][0]:g} at "
                    f"x = {x[~good][0]:.6g} m"
                )
            out[name] = values
        return out


def effective_torsion_constant(
    torsion_constant: float, warping_constant: float, length: float, ratio: float
) -> float:
    """Torsion constant of a uniform beam without warping that twists as much under an end torque.

    Vlasov: a beam whose warping is held at one end twists by
    ``T L/(G J) (1 - tanh(l)/l)``, ``l = L sqrt(G J/(E Gamma))``.

    Args:
        torsion_constant: of Saint-Venant, m^4.
        warping_constant: m^6.
        length: m.
        ratio: E/G.
    """
    if warping_constant == 0.0:
        return torsion_constant
    size = length * sqrt(torsion_constant / (ratio * warping_constant))
    return torsion_constant / (1.0 - tanh(size) / size)
