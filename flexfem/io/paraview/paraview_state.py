# SPDX-License-Identifier: LGPL-3.0-or-later
"""The file in a result folder that opens all of it in ParaView.

A script and no state file (.pvsm): those name data files by absolute paths, hold all settings of
the version of ParaView that made them, and cannot ask the data for the range of a field.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from flexfem.io.atomic import raise_together, replace_file

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["write_paraview_state"]

_SCRIPT = Path(__file__).with_name("open_in_paraview.py")


def write_paraview_state(folder: Path, comm: "MPI.Comm") -> None:
    """Write ``open_in_paraview.py``, the same for any number of ranks; collective.

    Raises:
        OSError: The file cannot be written; on all ranks.
    """
    error: Exception | None = None
    if comm.rank == 0:
        try:
            text = _SCRIPT.read_text(encoding="utf-8")
            # for windows that do not tell a script where it is
            text = text.replace('FOLDER = ""', f"FOLDER = {str(folder.resolve())!r}")
            replace_file(folder / _SCRIPT.name, [text.encode()])
        except OSError as exc:
            error = exc
    raise_together(comm, error)
