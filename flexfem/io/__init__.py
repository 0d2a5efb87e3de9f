# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result files: ParaView series, history table, summary and progress bar.

Everything here takes plain NumPy arrays and an mpi4py communicator; nothing depends on systems,
solvers or integrators.
"""

from flexfem.io.progress import Progress
from flexfem.io.summary import read_summary, write_summary
from flexfem.io.tables.history import HistoryWriter, read_history
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_writer import BeamWriter
from flexfem.io.vtu.body_fields import JointFields, JointWriter, RigidBodyFields, RigidBodyWriter
from flexfem.io.vtu.series import VtuSeries
from flexfem.io.vtu.surfaces import Surface, body_surface

__all__ = [
    "BeamFields",
    "BeamWriter",
    "HistoryWriter",
    "JointFields",
    "JointWriter",
    "Progress",
    "RigidBodyFields",
    "RigidBodyWriter",
    "Surface",
    "VtuSeries",
    "body_surface",
    "read_history",
    "read_summary",
    "write_summary",
]
