# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build hook: the wheel carries the case and mesh files, which lie beside the package here."""

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ShippedFiles(BuildHookInterface):
    """Adds ``cases/`` and ``meshes/`` to a wheel as ``flexfem/cases`` and ``flexfem/meshes``."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Leave editable installs alone: they would get copies that no edit reaches."""
        if version != "editable":
            build_data["force_include"] |= {name: f"flexfem/{name}" for name in ("cases", "meshes")}
