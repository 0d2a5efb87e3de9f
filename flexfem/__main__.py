# SPDX-License-Identifier: LGPL-3.0-or-later
"""``python -m flexfem``: the ``flexfem`` command of this very interpreter."""

import sys

from flexfem.cli.command import command

sys.exit(command())
