# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies too long or too short for their sections, and stiffnesses of very different size."""

from collections.abc import Iterator

import numpy as np

from flexfem.core.laws import LawKind
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.model.bodies.basic import Beam

#: Slenderness above which beams and shells are probably unintended. Tethers in space have more than
#: the first, membranes of solar sails less than the second.
_LONG, _WIDE = 1e5, 3e6
#: Length by depth below which a beam is none.
_STUBBY = 1.0
#: Ratio of stiffnesses against stretching beyond which the softer one is lost in round-off.
_APART = 1e11


def find(inspection: Inspection) -> Iterator[Finding]:
    """Slenderness body by body, then the stiffest and the softest of all."""
    for mesh in inspection.meshes:
        beam = isinstance(mesh.body, Beam)
        if mesh.slenderness > (_LONG if beam else _WIDE):
            yield Finding(
                "slenderness", owner_of(mesh.body),
                f"{mesh.length:.4g} m by {mesh.depth:.3g} m is a slenderness of "
                f"{mesh.slenderness:.2g}",
                "check that mesh and section are both in metres",
            )  # fmt: skip
        elif beam and mesh.slenderness < _STUBBY:
            yield Finding(
                "slenderness", owner_of(mesh.body),
                f"it is {mesh.length:.4g} m long and {mesh.depth:.3g} m deep",
                "take a RigidBody or a FloatingBody of solid elements, or check the units",
            )  # fmt: skip
    yield from _apart(inspection)


def _apart(inspection: Inspection) -> Iterator[Finding]:
    """Stiffnesses of elements and springs against stretching, N/m."""
    found = [(mesh.axial, owner_of(mesh.body)) for mesh in inspection.meshes]
    if not inspection.rows.rigid:
        rows = inspection.rows.rows
        springs = (rows.elastic[:, 0] == LawKind.SPRING) & (rows.elastic[:, 1] > 0.0)
        for row in np.flatnonzero(springs & ~inspection.turning):
            joint = inspection.rows.joints[rows.joint_of_row[row]]
            found.append((float(rows.elastic[row, 1]), joint.owner))
    known = sorted(one for one in found if one[0] > 0.0)  # nonlinear laws have none
    if known and known[-1][0] > _APART * known[0][0]:
        (low, soft), (high, stiff) = known[0], known[-1]
        yield Finding(
            "slenderness", stiff,
            f"its stiffness of {high:.3g} N/m is {high / low:.1g} times that of {soft}, "
            f"{low:.3g} N/m",
            "make what is that stiff rigid (RigidBody, Rigid), or check the units",
        )  # fmt: skip
