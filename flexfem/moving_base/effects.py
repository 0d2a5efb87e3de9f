# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a theory of the beam on a moving base takes into account."""

from dataclasses import dataclass, replace

__all__ = ["THEORIES", "Effects", "effects_of"]


@dataclass(frozen=True)
class Effects:
    """Effects that can be left out one by one; a theory without one has its functions zero.

    Attributes:
        stiffening: the axial displacement follows from stretch and deflection to second order,
            ``u1 = s - 1/2 int (u2'^2 + u3'^2)``; without it u1 = s as in early codes.
        section_rotations: rotations of sections to second order, where mass centres are eccentric
            and in the rotary inertia; without it only to first order.
        extension: stretch s.
        in_plane: displacement u2 and rotation theta3.
        out_of_plane: displacement u3 and rotation theta2.
        torsion: twist theta1.
        warping: the energy of restrained warping, with the warping constant.
        shear: shear strains; without them sections stay normal to the axis.
        rotary_inertia: of sections, also about the axis.
        eccentricity: of the mass centre.
    """

    stiffening: bool = True
    section_rotations: bool = True
    extension: bool = True
    in_plane: bool = True
    out_of_plane: bool = True
    torsion: bool = True
    warping: bool = True
    shear: bool = True
    rotary_inertia: bool = True
    eccentricity: bool = True

    def __post_init__(self) -> None:
        """Check that there is something that moves.

        Raises:
            ValueError: no field is left.
        """
        if not (self.extension or self.in_plane or self.out_of_plane or self.torsion):
            raise ValueError(
                "Effects: no field is left: extension, in_plane, out_of_plane, torsion"
            )


#: Theories by name.
THEORIES = {
    "consistent": Effects(),
    "conventional": Effects(stiffening=False, section_rotations=False),
}


def effects_of(theory: str, **changes: bool) -> Effects:
    """Effects of a theory, some of them changed.

    Raises:
        ValueError: there is none of that name.
        TypeError: there is no such effect.
    """
    if theory not in THEORIES:
        raise ValueError(f"theory '{theory}': there are {', '.join(THEORIES)}")
    return replace(THEORIES[theory], **changes)
