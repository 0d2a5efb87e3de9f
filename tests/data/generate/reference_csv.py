# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writer of the reference tables in ``tests/data``."""

from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[1]
BENCHMARKS = DATA.parent / "benchmarks"


def write(name: str, header: str, columns: list[str], rows: np.ndarray, digits: int) -> None:
    """Write ``tests/data/<name>.csv``: commented header, one line of names, rows.

    Args:
        name: File name without extension.
        header: Source, versions, settings and error estimate; every line becomes a comment.
        columns: Column names.
        rows: Values, shape (n, len(columns)).
        digits: Significant digits kept.
    """
    lines = [f"# {line}" for line in header.strip().splitlines()]
    lines.append(",".join(columns))
    # Adding zero turns -0 into 0.
    lines += [",".join(f"{value + 0.0:.{digits}g}" for value in row) for row in rows]
    (DATA / f"{name}.csv").write_text("\n".join(lines) + "\n")
