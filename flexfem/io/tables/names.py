# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names of columns of histories."""

from collections.abc import Sequence

__all__ = ["check_columns"]


def check_columns(columns: Sequence[str]) -> None:
    """Refuse names that a table cannot have.

    Args:
        columns: those after ``t``.

    Raises:
        ValueError: one is empty, has characters that separate columns, or occurs twice.
    """
    for name in columns:
        if not name or name == "t" or name != name.strip() or set(name) & set(',"\n\r'):
            raise ValueError(f"HistoryWriter: {name!r} cannot be the name of a column")
    if len(set(columns)) < len(columns):
        name = next(name for name in columns if columns.count(name) > 1)
        raise ValueError(f"HistoryWriter: two columns are named '{name}'")
