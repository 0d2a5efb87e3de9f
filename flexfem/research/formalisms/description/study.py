# SPDX-License-Identifier: LGPL-3.0-or-later
"""Declaration of a comparison of formalisms on several mechanisms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flexfem import _checks
from flexfem.research.formalisms.description.mechanism import FORMALISMS, Mechanism

__all__ = ["FormalismStudy"]


@dataclass(frozen=True, repr=False)
class FormalismStudy:
    """Mechanisms whose equations several formalisms set up, with the cost of each.

    The first mechanism is simulated to the end by all formalisms side by side; all of them take a
    few steps for the table.

    Args:
        mechanisms: by their labels in the table, in the order of ``labels``.
        labels: names of the columns that distinguish the mechanisms, such as ("element", "motion").
        formalisms: names among `FORMALISMS`.
        steps: that are timed for the table.
    """

    mechanisms: Mapping[tuple[str, ...], Mechanism]
    labels: Sequence[str]
    formalisms: Sequence[str] = FORMALISMS
    steps: int = 10

    drivers: ClassVar[dict[str, str]] = {
        "dynamics": "flexfem.research.formalisms.runs.comparison:compare_formalisms"
    }

    def __repr__(self) -> str:
        """Return the name in messages."""
        return f"FormalismStudy of {len(self.mechanisms)} mechanisms"

    def __str__(self) -> str:
        """Formalisms, then all mechanisms."""
        lines = [f"{self!r} by {', '.join(self.formalisms)}"]
        for key, mechanism in self.mechanisms.items():
            told = zip(self.labels, key, strict=True)
            lines.append(", ".join(f"{label} {value}" for label, value in told))
            lines += [f"  {line}" for line in str(mechanism).splitlines()]
        return "\n".join(lines)

    def validate(self) -> None:
        """Check that everything fits.

        Raises:
            TypeError: something has the wrong type.
            ValueError: a value is not admissible.
        """
        if not self.mechanisms or not self.formalisms:
            got = f"{len(self.mechanisms)} and {len(self.formalisms)}"
            raise ValueError(
                f"FormalismStudy: mechanisms and formalisms must hold at least one each, got {got}"
            )
        for name in self.formalisms:
            if name not in FORMALISMS:
                raise ValueError(
                    f"FormalismStudy: formalisms are {', '.join(FORMALISMS)}, got {name!r}"
                )
        for key, mechanism in self.mechanisms.items():
            if len(key) != len(self.labels):
                raise ValueError(f"FormalismStudy: {key!r} must have {len(self.labels)} entries")
            _checks.instance("FormalismStudy", f"mechanism {key!r}", mechanism, Mechanism)
            mechanism.validate()
        if isinstance(self.steps, bool) or not isinstance(self.steps, int) or self.steps < 1:
            raise ValueError(f"FormalismStudy: steps must be a whole number > 0, got {self.steps}")

    @property
    def first(self) -> Any:
        """The mechanism that is simulated to the end."""
        return next(iter(self.mechanisms.values()))
