# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build hook: the wheel carries cases, meshes and scripts that lie beside the package."""

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ShippedFiles(BuildHookInterface):
    """Adds ``cases/``, ``meshes/`` and ``postprocess/`` to a wheel, inside ``flexfem/``."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Leave editable installs alone: they would get copies that no edit reaches."""
        if version != "editable":
            folders = ("cases", "meshes", "postprocess")
            build_data["force_include"] |= {name: f"flexfem/{name}" for name in folders}
