# SPDX-License-Identifier: LGPL-3.0-or-later
"""A finding of a check of a model."""

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Finding", "listed", "owner_of"]

#: Names that a finding lists before the rest is counted only.
_NAMES = 4


@dataclass(frozen=True)
class Finding:
    """Something in a model that looks like a mistake.

    Attributes:
        check: name of the check that found it.
        where: subject: a body, joint, load, mesh or the model.
        what: description, with the values.
        hint: advice.
    """

    check: str
    where: str
    what: str
    hint: str

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.where}: {self.what}; {self.hint}"


def listed(names: Sequence[str]) -> str:
    """Names in one line, the first few of many."""
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    return ", ".join(names[:_NAMES]) + more


def owner_of(thing: object) -> str:
    """Class and quoted name of something with a name."""
    return f'{type(thing).__name__} "{getattr(thing, "name", "")}"'
