# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declaration of tables of element matrices in a moving frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flexfem import _checks
from flexfem.research.formalisms.description.mechanism import EnergyBody

__all__ = ["ElementMatrixStudy"]


@dataclass(frozen=True, repr=False)
class ElementMatrixStudy:
    """Bodies for the matrices of one element, see `ElementMatrices`.

    Args:
        bodies: by their labels in the table, in the order of ``labels``.
        labels: names of the columns that distinguish the bodies, such as ("element", "motion").
        omega: angular velocity of the frames, local components, rad/s.
        epsilon: their angular acceleration, local components, rad/s^2.
        number: of the element in each mesh.
    """

    bodies: Mapping[tuple[str, ...], EnergyBody]
    labels: Sequence[str]
    omega: Any
    epsilon: Any
    number: int = 0

    drivers: ClassVar[dict[str, str]] = {
        "dynamics": "flexfem.research.formalisms.runs.element_tables:tabulate_elements"
    }

    def __repr__(self) -> str:
        """Return the name in messages."""
        return f"ElementMatrixStudy of {len(self.bodies)} bodies"

    def __str__(self) -> str:
        """Motion of the frames, then all bodies."""
        motion = f"omega {list(self.omega)} rad/s, epsilon {list(self.epsilon)} rad/s^2"
        lines = [f"{self!r}, {motion}, element {self.number}"]
        for key, body in self.bodies.items():
            told = zip(self.labels, key, strict=True)
            named = ", ".join(f"{label} {value}" for label, value in told)
            lines.append(f"  {named}: {body.name}, {type(body.matter).__name__}")
        return "\n".join(lines)

    def validate(self) -> None:
        """Check that everything fits.

        Raises:
            TypeError: something has the wrong type.
            ValueError: a value is not admissible.
        """
        if not self.bodies:
            raise ValueError("ElementMatrixStudy: bodies must hold at least one")
        for key, body in self.bodies.items():
            if len(key) != len(self.labels):
                raise ValueError(
                    f"ElementMatrixStudy: {key!r} must have {len(self.labels)} entries"
                )
            _checks.instance("ElementMatrixStudy", f"body {key!r}", body, EnergyBody)
        _checks.vector("ElementMatrixStudy", "omega", self.omega)
        _checks.vector("ElementMatrixStudy", "epsilon", self.epsilon)
        _checks.instance("ElementMatrixStudy", "number", self.number, int)
