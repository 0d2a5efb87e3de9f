# SPDX-License-Identifier: LGPL-3.0-or-later
"""All ParaView files of a system: fields of each family, modes, rigid surfaces, saved views."""
