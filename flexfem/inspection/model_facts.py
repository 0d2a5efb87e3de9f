# SPDX-License-Identifier: LGPL-3.0-or-later
"""A model in numbers."""

from dataclasses import dataclass

from flexfem.inspection.body_facts import BodyFacts, MassFacts
from flexfem.inspection.joint_facts import JointFacts
from flexfem.inspection.mobility import Mobility
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.model.model import Model

__all__ = ["ModelFacts"]

#: Bytes of an entry of a sparse matrix: a number and its column.
_BYTES = 12


@dataclass(frozen=True)
class ModelFacts:
    """The fields of :class:`~flexfem.Description`, which describes them."""

    model: Model
    bodies: list[BodyFacts]
    total: MassFacts
    joints: list[JointFacts]
    mobility: Mobility
    meshes: list[MeshFacts]
    extent: float
    entries: int
    memory: float

    @property
    def matrix_bytes(self) -> int:
        """Memory of the matrix of a step, about; factors take some times as much."""
        return _BYTES * self.entries
