# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command line: ``flexfem COMMAND``, and ``python cases/<name>.py``.

Nothing here imports DOLFINx, PETSc, numba or gmsh before a run starts. Exit codes: 0 done, 1 the
computation failed, 2 wrong input (one line on stderr, nothing written), 130 interrupted (SIGINT),
143 terminated (SIGTERM).
"""

from flexfem._packages import without_collection

with without_collection():
    from flexfem.cli.case_line import parse
    from flexfem.cli.case_run import load_case, main
    from flexfem.cli.command import command
    from flexfem.cli.usage import UsageError

__all__ = ["UsageError", "command", "load_case", "main", "parse"]
