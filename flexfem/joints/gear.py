# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gear pair."""

from dataclasses import dataclass, field

from flexfem.joints.coupling import Coupling

__all__ = ["Gear"]


@dataclass(frozen=True, eq=False)
class Gear(Coupling):
    """Couples two relative rotations: rotation of d from c = ratio times rotation of b from a.

    One constraint, over any number of turns. It needs joints that keep both axes, such as
    ``Revolute`` between a and b and between c and d; a and c are the carriers (often the same body
    or the ground), b and d the wheels. Forces between the teeth other than their moments are not
    represented. Elastic teeth of the stiffness k along the line of action, with the play j there,
    have ``stiffness=k r^2`` and ``backlash=j/r`` with the radius r of d's base circle.

    Attributes:
        c: third marker.
        d: fourth marker.
        axis: axis of the first rotation, fixed in marker a, inertial axes at the start.
        second_axis: axis of the second rotation, fixed in marker c; None for the same direction.
        ratio: rotation of d from c over rotation of b from a; negative for wheels that mesh
            externally on parallel axes of one sense.
        stiffness: N m/rad, by the rotation of d; None for a constraint.
        damping: N m s/rad.
        backlash: play of d, rad; the start is in its middle.
    """

    motions: tuple[str, str] = field(default=("rotation", "rotation"), init=False)
