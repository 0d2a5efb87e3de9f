# SPDX-License-Identifier: LGPL-3.0-or-later
"""The commands of ``flexfem``, one file each.

A command has a ``SUMMARY``, one line for the list, and ``execute(argv, prog)`` that reads the
arguments after its name and returns the exit code. Files are imported to be listed: slow imports
belong into functions.
"""
