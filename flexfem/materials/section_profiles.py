# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constructors of sections that are profiles: I-sections, channels, angles and T-sections."""

from abc import abstractmethod
from typing import Self

import numpy.typing as npt

from flexfem import _checks
from flexfem.materials import profiles
from flexfem.materials.constants import Shape
from flexfem.materials.material import Material

__all__ = ["ProfileSections", "length_of"]

#: Least and largest length, m.
_LENGTHS = (1e-30, 1e30)


class ProfileSections:
    """Constructors of `Section` for profiles; see there."""

    @classmethod
    @abstractmethod
    def _of(
        cls,
        shape: Shape,
        material: Material,
        mass_centre: npt.ArrayLike,
        shear_centre: npt.ArrayLike | None,
        shear_factor: npt.ArrayLike | None,
    ) -> Self:
        """Create the section of a given shape and material."""

    @classmethod
    def i_section(
        cls, width: float, height: float, web: float, flange: float, material: Material, *,
        fillet: float = 0.0, mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike | None = None, shear_factor: npt.ArrayLike | None = None,
    ) -> Self:  # fmt: skip
        """Create an I- or H-section with two equal flanges, the web along e3.

        Args:
            width: Flanges along e2, metres.
            height: Overall, along e3, metres.
            web: Thickness of the web, metres.
            flange: Thickness of the flanges, metres.
            material: Elastic constants and density.
            fillet: Radius between web and flanges, metres.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres; None for that of the shape.
            shear_factor: One number or the pair (k2, k3); None for those of the shape.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A length is not positive, walls and fillets fill the section, or an argument
                is not finite.
        """
        sizes = _profile(width, height, web=web, flange=flange, fillet=fillet)
        _fits("half of the web and the fillet", 0.5 * sizes[2] + sizes[4], "width", sizes[0], 2)
        _fits("flange and fillet", sizes[3] + sizes[4], "height", sizes[1], 2)
        shape = profiles.i_shape(*sizes)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def channel(
        cls, width: float, height: float, web: float, flange: float, material: Material, *,
        fillet: float = 0.0, mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike | None = None, shear_factor: npt.ArrayLike | None = None,
    ) -> Self:  # fmt: skip
        """Create a channel with parallel flanges, the web along e3 and the flanges towards +e2.

        The reference axis passes through the centroid; the shear centre lies on -e2, outside.

        Args:
            width: Flanges with the web, along e2, metres.
            height: Overall, along e3, metres.
            web: Thickness of the web, metres.
            flange: Thickness of the flanges, metres.
            material: Elastic constants and density.
            fillet: Radius between web and flanges, metres.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres; None for that of the shape.
            shear_factor: One number or the pair (k2, k3); None for those of the shape.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: As for an I-section.
        """
        sizes = _profile(width, height, web=web, flange=flange, fillet=fillet)
        _fits("web and fillet", sizes[2] + sizes[4], "width", sizes[0])
        _fits("flange and fillet", sizes[3] + sizes[4], "height", sizes[1], 2)
        shape = profiles.channel_shape(*sizes)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def angle(
        cls, width: float, height: float, thickness: float, material: Material, *,
        fillet: float = 0.0, mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike | None = None, shear_factor: npt.ArrayLike | None = None,
    ) -> Self:  # fmt: skip
        """Create an angle, the legs towards +e2 and +e3 from the corner.

        The reference axis passes through the centroid. The axes e2 and e3 along the legs are not
        the principal ones: bending couples.

        Args:
            width: Leg along e2, metres.
            height: Leg along e3, metres.
            thickness: Of both legs, metres.
            material: Elastic constants and density.
            fillet: Radius between the legs, metres; the toes are sharp.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres; None for that of the shape.
            shear_factor: One number or the pair (k2, k3); None for those of the shape, with k23.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: As for an I-section.
        """
        sizes = _profile(width, height, thickness=thickness, fillet=fillet)
        _fits("thickness and fillet", sizes[2] + sizes[3], "width", sizes[0])
        _fits("thickness and fillet", sizes[2] + sizes[3], "height", sizes[1])
        shape = profiles.angle_shape(*sizes)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def t_section(
        cls, width: float, height: float, web: float, flange: float, material: Material, *,
        fillet: float = 0.0, mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike | None = None, shear_factor: npt.ArrayLike | None = None,
    ) -> Self:  # fmt: skip
        """Create a T-section, the flange on top (+e3) and the web along e3.

        The reference axis passes through the centroid.

        Args:
            width: Flange along e2, metres.
            height: Overall, along e3, metres.
            web: Thickness of the web, metres.
            flange: Thickness of the flange, metres.
            material: Elastic constants and density.
            fillet: Radius between web and flange, metres.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres; None for that of the shape.
            shear_factor: One number or the pair (k2, k3); None for those of the shape.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: As for an I-section.
        """
        sizes = _profile(width, height, web=web, flange=flange, fillet=fillet)
        _fits("half of the web and the fillet", 0.5 * sizes[2] + sizes[4], "width", sizes[0], 2)
        _fits("flange and fillet", sizes[3] + sizes[4], "height", sizes[1])
        shape = profiles.t_shape(*sizes)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)


def _profile(width: float, height: float, **walls: float) -> list[float]:
    """Check the lengths of a profile; only the fillet may be zero."""
    lengths = {"width": width, "height": height, **walls}
    fillet = lengths.get("fillet", 0.0)
    if _checks.number("Section", "fillet", fillet, nonnegative=True) == 0.0:
        return [length_of(*one) if one[0] != "fillet" else 0.0 for one in lengths.items()]
    return [length_of(*one) for one in lengths.items()]


def length_of(what: str, value: float) -> float:
    """A length of a section, m; products of second moments of such ones are numbers still.

    Raises:
        TypeError: It is no number.
        ValueError: It is not positive, or beyond all sections.
    """
    length = _checks.number("Section", what, value, positive=True)
    low, high = _LENGTHS
    if not low <= length <= high:
        raise ValueError(f"Section: {what} must be between {low:g} and {high:g} m, got {value}")
    return length


def _fits(what: str, taken: float, side: str, length: float, times: int = 1) -> None:
    """Check that something fits into a side, once or twice."""
    if times * taken >= length:
        share = "half of the" if times == 2 else "the"
        raise ValueError(
            f"Section: {what} must be less than {share} {side} {length:g}, got {taken:g}"
        )
