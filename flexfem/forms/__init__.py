# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL expressions and forms; nothing here touches PETSc or a mesh."""
