# SPDX-License-Identifier: LGPL-3.0-or-later
"""One contact of a model on this rank."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.contact.law.closed_contacts import ContactLaw
from flexfem.contact.obstacles.rigid_surface import RigidContact
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.contact.pairs import ContactPass, ContactSurfaces

__all__ = ["ContactGroup"]


@dataclass
class ContactGroup:
    """One contact of the model on this rank.

    Attributes:
        surfaces: its serial data.
        passes: their data for the slaves of this rank.
        triangles: contacts of the passes; rigid: those with rigid surfaces.
        areas: areas of the slaves of rigid surfaces.
    """

    surfaces: ContactSurfaces
    passes: list[ContactPass]
    triangles: list[TriangleContact]
    rigid: list[RigidContact]
    areas: FloatArray

    @classmethod
    def of(cls, surfaces: ContactSurfaces, own: BoolArray) -> "ContactGroup":
        """Create the contact with the slaves that are marked in (n,)."""
        contact = surfaces.contact
        law = ContactLaw(contact.friction, contact.damping)
        passes = [one.restricted(own) for one in surfaces.passes]
        triangles = [
            TriangleContact(one.slaves, one.masters, surfaces.skin, one.excluded, law)
            for one in passes
        ]
        kept = own[surfaces.slaves.nodes]
        slaves = surfaces.slaves.restricted(kept)
        rigid = [RigidContact(slaves, place.shape, law) for place in surfaces.rigid]
        return cls(surfaces, passes, triangles, rigid, surfaces.areas[kept])

    def set_stiffness(self, stiffness: float) -> None:
        """Set the force per penetration and area at zero penetration, N/m^3."""
        for every in self.every:
            every.stiffer = self.surfaces.stiffer(stiffness)
        for one, made in zip(self.passes, self.triangles, strict=True):
            made.slaves.stiffness[:] = stiffness * one.areas
        for rigid in self.rigid:
            rigid.slaves.stiffness[:] = stiffness * self.areas

    @property
    def every(self) -> list[TriangleContact | RigidContact]:
        """All contacts."""
        return [*self.triangles, *self.rigid]

    @property
    def forces(self) -> FloatArray:
        """Force on the slaves (3,) and sum of the sizes of normal forces, N, of this rank: (4,).

        Of the accepted state; friction and damping are those that have acted at the end of the
        last step: the next one begins with others, on the contacts that are closed then.
        """
        signs = [one.sign for one in self.passes] + [1.0] * len(self.rigid)
        total = np.zeros(4)
        for sign, made in zip(signs, self.every, strict=True):
            normal = made.forces
            total[3] += np.linalg.norm(normal, axis=1).sum()
            total[:3] += sign * (normal.sum(0) - made.closed.acted)
        return total
