# SPDX-License-Identifier: LGPL-3.0-or-later
"""Effects that a theory of the beam on a moving base takes into account."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

from flexfem.research.moving_base.rotations import ROTATIONS

__all__ = ["THEORIES", "Effects", "effect_names", "effects_of", "left_out"]

#: Names of several effects at once.
_GROUPS = {
    "shear": ("shear_2", "shear_3"),
    "rotary_inertia": ("rotary_inertia_2", "rotary_inertia_3"),
    "eccentricity": ("eccentricity_2", "eccentricity_3"),
}


@dataclass(frozen=True)
class Effects:
    """Effects that can be left out one by one; a theory without one has its functions zero.

    Attributes:
        stiffening: the axial displacement follows from stretch and deflection to second order,
            ``u1 = s - 1/2 int (u2'^2 + u3'^2)``; without it u1 = s as in early codes.
        section_inertia: sections move with the base, with eccentric mass centres and moments of
            inertia; without it mass points on the axis, whatever the functions are modes of.
        extension: stretch s.
        in_plane: displacement u2 and rotation theta3.
        out_of_plane: displacement u3 and rotation theta2.
        torsion: twist theta1.
        warping: the energy of restrained warping, with the warping constant.
        shear_2: shear strain of displacements u2; without it theta3 = u2'.
        shear_3: shear strain of displacements u3; without it theta2 = -u3'.
        torsional_inertia: moment of inertia of sections about the axis.
        rotary_inertia_2, rotary_inertia_3: moments of inertia of sections about a2 and a3.
        eccentricity_2, eccentricity_3: of the mass centre.
        rotations: rotations of sections, to second order: "sequence", by theta1 about a1, then
            theta2 about a2, then theta3 about a3, axes of the base, as published; "vector", about
            the vector theta; "linear", to first order only. They differ where mass centres are
            eccentric, and in the sections' moments of inertia.
    """

    stiffening: bool = True
    section_inertia: bool = True
    extension: bool = True
    in_plane: bool = True
    out_of_plane: bool = True
    torsion: bool = True
    warping: bool = True
    shear_2: bool = True
    shear_3: bool = True
    torsional_inertia: bool = True
    rotary_inertia_2: bool = True
    rotary_inertia_3: bool = True
    eccentricity_2: bool = True
    eccentricity_3: bool = True
    rotations: str = "sequence"

    def __post_init__(self) -> None:
        """Check that there is something that moves.

        Raises:
            ValueError: no field is left, or rotations of no such name.
        """
        if not (self.extension or self.in_plane or self.out_of_plane or self.torsion):
            raise ValueError(
                "Effects: no field is left: extension, in_plane, out_of_plane, torsion"
            )
        if self.rotations not in ROTATIONS:
            raise ValueError(
                f"Effects: rotations must be one of {', '.join(ROTATIONS)}, got {self.rotations!r}"
            )

    @property
    def left_out(self) -> list[str]:
        """Names of the effects that are not there."""
        return [f.name for f in fields(self) if getattr(self, f.name) is False]

    def without(self, *names: str) -> "Effects":
        """The same with some effects left out.

        Args:
            names: of effects; "shear", "rotary_inertia" and "eccentricity" are those of both
                directions.

        Raises:
            ValueError: there is no such effect, or no field is left.
        """
        changes: dict[str, Any] = dict.fromkeys(left_out(names), False)
        return replace(self, **changes)


def effect_names() -> list[str]:
    """Names of single effects, then of groups of them."""
    return [*(f.name for f in fields(Effects) if f.type is bool), *_GROUPS]


def left_out(names: Iterable[str]) -> list[str]:
    """Names of single effects.

    Raises:
        ValueError: there is no such effect.
    """
    known, out = effect_names(), list[str]()
    for name in names:
        if name not in known:
            raise ValueError(f"effect '{name}': there are {', '.join(known)}")
        out += _GROUPS.get(name, (name,))
    return out


#: Theories by name: the published one; with displacements linear in the coordinates from the start;
#: the conventional algorithm, which moves mass points on the axis besides.
THEORIES = {
    "consistent": Effects(),
    "premature": Effects(stiffening=False, rotations="linear"),
    "conventional": Effects(stiffening=False, rotations="linear", section_inertia=False),
}


def effects_of(theory: str, *, without: Iterable[str] = (), rotations: str = "") -> Effects:
    """Effects of a theory, some of them left out.

    Args:
        theory: "consistent", "premature" or "conventional".
        without: names of effects, see :meth:`Effects.without`.
        rotations: other ones than the theory's.

    Raises:
        ValueError: there is none of that name.
    """
    if theory not in THEORIES:
        raise ValueError(f"theory '{theory}': there are {', '.join(THEORIES)}")
    effects = THEORIES[theory].without(*without)
    return replace(effects, rotations=rotations) if rotations else effects
