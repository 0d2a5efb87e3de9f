# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forms that DOLFINx assembles once, to compare with."""

__all__ = ["QUICKLY"]

#: Options of DOLFINx's compiler: optimised code would take longer to make than it ever saves. Two
#: processes that need the same form wait for each other.
QUICKLY = {"cffi_extra_compile_args": ["-O0", "-g0"], "timeout": 120}
