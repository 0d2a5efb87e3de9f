# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops are out of date when what they are made of changes."""

from pathlib import Path

from flexfem.lie import caching, so3
from flexfem.lie.caching import source_stamp

FILES = {
    "low.py": "A = 1\n",
    "middle.py": "from flexfem.low import A\n",
    "deep/high.py": "import numpy\nfrom flexfem.middle import (\n    A,\n)\n",
    "other.py": "B = 2\n",
}


def test_stamps_follow_all_that_is_imported(tmp_path):
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    high = tmp_path / "deep/high.py"
    first = source_stamp(high, tmp_path)
    (tmp_path / "other.py").write_text("B = 3\n")
    assert source_stamp(high, tmp_path) == first
    # numba's own stamp, that of high.py alone, would not change
    (tmp_path / "low.py").write_text("A = 2\n")
    assert source_stamp(high, tmp_path) != first


def test_loops_of_the_package_have_such_stamps():
    locator = so3.exp_into._cache._impl.locator
    assert isinstance(locator, caching._OfPackage)
    assert locator.get_source_stamp() == source_stamp(Path(so3.__file__))
