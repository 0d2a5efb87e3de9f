# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled banded LU of the multipliers' system against LAPACK's dgbtrf and dgbtrs.

Matrices are those of chains: n rows, three for each joint, half bandwidth 5, and wider ones.
Entries are scattered into the band in both. Columns: rows, half bandwidth, processor time of a
factorisation and of a solve in microseconds, ours and LAPACK's (least of 40 blocks in turns). Run
from the source tree::

    python -m tests.benchmarks.banded_against_lapack
"""

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from flexfem.solvers.linear.banded import band_factor, band_solve
from tests.benchmarks.timing import paired


def compare(size: int, half: int) -> tuple[dict[str, float], dict[str, float]]:
    """Times of factorisations and of solves."""
    random = np.random.default_rng(size)
    i, j = (k.astype(np.int64) for k in np.nonzero(
        np.abs(np.subtract.outer(np.arange(size), np.arange(size))) <= half
    ))  # fmt: skip
    values = random.normal(size=len(i))
    values[i == j] += 4.0 * half
    width = 2 * half + 1
    band, index = np.zeros((size, width)), i * width + j - i + half
    lapack = np.zeros((3 * half + 1, size), order="F")
    flat, to = lapack.reshape(-1, order="F"), j * (3 * half + 1) + 2 * half + i - j
    order, work, right = np.arange(size), np.empty(size), random.normal(size=size)

    def theirs() -> tuple[np.ndarray, np.ndarray]:
        flat[:] = 0.0
        flat[to] = values
        factors, pivots, _ = dgbtrf(lapack, half, half, overwrite_ab=True)
        return factors, pivots

    factor = paired({"ours": lambda: band_factor(index, values, band), "LAPACK": theirs})
    band_factor(index, values, band)
    factors, pivots = theirs()
    x, y = right.copy(), dgbtrs(factors, half, half, right, pivots)[0]
    band_solve(band, order, work, x)
    np.testing.assert_allclose(x, y, rtol=1e-10)

    def ours() -> None:
        x[:] = right
        band_solve(band, order, work, x)

    solve = paired({"ours": ours, "LAPACK": lambda: dgbtrs(factors, half, half, right, pivots)})
    return factor, solve


def main() -> None:
    """Print the table."""
    print("rows  half   factor: ours  LAPACK   solve: ours  LAPACK")
    for size, half in ((3, 2), (12, 5), (48, 5), (192, 5), (768, 5), (192, 20), (768, 60)):
        factor, solve = compare(size, half)
        times = [1e6 * t[name] for t in (factor, solve) for name in ("ours", "LAPACK")]
        print("{:4d} {:5d} {:14.2f} {:7.2f} {:13.2f} {:7.2f}".format(size, half, *times))


if __name__ == "__main__":
    main()
