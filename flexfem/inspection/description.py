# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summary of a model: its objects, counts and sums."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem.inspection.body_facts import BodyFacts, MassFacts, total
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.joint_facts import JointFacts
from flexfem.inspection.matrix_entries import matrix_entries
from flexfem.inspection.mobility import mobility
from flexfem.inspection.model_facts import ModelFacts
from flexfem.inspection.text import description_text
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.model.model import Model
from flexfem.system.memory import memory_of_run

__all__ = ["Description", "describe", "description_of"]


#: Names of numbers in an earlier version, which scripts may still read.
_FORMER = {"held": "fixed_degrees_of_freedom", "motions_as_wholes": "rigid_body_motions"}


@dataclass(frozen=True)
class Description(ModelFacts):
    """A model in numbers; its text is a table.

    Attributes:
        model: the model.
        bodies: mass, inertia, size, elements and unknowns of each body, point masses last.
        total: mass properties of all together.
        joints: markers and constraints of each joint.
        mobility: degrees of freedom and constraints.
        meshes: elements of each flexible body.
        extent: characteristic length, m.
        entries: of the matrix of a step, about; contact left out.
        memory: bytes that a motion on one rank takes, about; contact left out.
    """

    def __str__(self) -> str:
        """Return the table."""
        return description_text(self)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show the table in notebooks and IPython."""
        printer.text(str(self))

    def as_dict(self) -> dict[str, Any]:
        """Return all numbers by name, as JSON has them; SI units."""
        counts = self.mobility
        values = {
            "model": self.model.name,
            "gravity": None
            if self.model.gravity is None
            else self.model.gravity.acceleration.tolist(),
            "bodies": [_body(one) for one in self.bodies],
            "total": _masses(self.total),
            "joints": [_joint(one) for one in self.joints],
            "loads": [load.name for load in self.model.loads],
            "contacts": [contact.name for contact in self.model.contacts],
            "events": [event.name for event in self.model.events],
            "probes": {probe.name: list(probe.columns) for probe in self.model.probes},
            "unknowns": counts.unknowns,
            "fixed_degrees_of_freedom": counts.fixed,
            "constraints": counts.constraints,
            "redundant_constraints": counts.redundant,
            "degrees_of_freedom": counts.degrees_of_freedom,
            "rigid_body_motions": counts.motions,
            "motions_by_counting": counts.grubler,
            "characteristic_length": self.extent,
            "elements": [_mesh(one) for one in self.meshes],
            "matrix_entries": self.entries,
            "matrix_bytes": self.matrix_bytes,
            "memory_bytes": self.memory,
        }
        return values | {former: values[name] for former, name in _FORMER.items()}


def describe(model: Model) -> Description:
    """Sum up a model: bodies, masses, joints, degrees of freedom, sizes; nothing is assembled.

    Args:
        model: the model.

    Returns:
        The summary; ``print`` shows it as a table.

    Raises:
        InputError: a mistake in the model (a ValueError).
        TypeError: it is no model.
    """
    return description_of(Inspection(model))


def description_of(inspection: Inspection) -> Description:
    """Summary of an inspected model."""
    return Description(
        model=inspection.model,
        bodies=inspection.bodies,
        total=total([one.masses for one in inspection.bodies]),
        joints=inspection.joints,
        mobility=mobility(inspection),
        meshes=inspection.meshes,
        extent=inspection.extent,
        entries=matrix_entries(inspection.serial, inspection.rows.rows),
        memory=memory_of_run(inspection.model),
    )


def _masses(facts: MassFacts) -> dict[str, Any]:
    return {
        "mass": facts.mass, "centre": facts.centre.tolist(), "inertia": facts.inertia.tolist(),
    }  # fmt: skip


def _body(facts: BodyFacts) -> dict[str, Any]:
    counts = {
        "elements": facts.elements, "nodes": facts.nodes,
        "degrees_of_freedom": facts.degrees_of_freedom, "freedoms": facts.degrees_of_freedom,
    }  # fmt: skip
    own = {"name": facts.name, "kind": facts.kind, "size": facts.size.tolist()}
    return own | _masses(facts.masses) | counts


def _joint(facts: JointFacts) -> dict[str, Any]:
    return {
        "name": facts.name, "kind": facts.kind, "role": facts.role, "ends": list(facts.ends),
        "constraints": facts.constraints, "laws": facts.laws, "open": facts.open,
    }  # fmt: skip


def _mesh(facts: MeshFacts) -> Mapping[str, Any]:
    return {
        "body": facts.body.name,
        "shortest": float(facts.lengths.min()),
        "longest": float(facts.longest.max()),
        "length": facts.length,
        "depth": None if np.isnan(facts.depth) else facts.depth,
    }
