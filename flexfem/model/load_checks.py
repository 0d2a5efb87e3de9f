# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the loads of a model: that they act on bodies that can carry them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexfem.core.load import Load
from flexfem.core.marker import Marker
from flexfem.loads.point_force import PointForce
from flexfem.loads.shell_load import ShellLoad
from flexfem.model.bodies import Beam
from flexfem.model.shell import Shell

if TYPE_CHECKING:
    from flexfem.model.model import Model

__all__ = ["check_load"]


def check_load(model: Model, load: Load) -> None:
    """Check where a load acts.

    Raises:
        ValueError: There is no such beam, shell or line, or a load along a beam or with the axes of
            a marker is on a shell, whose nodes have none.
    """
    owner = f'{type(load).__name__} "{load.name}"'
    for name in load.beams:
        body = model.get(name)
        if isinstance(body, Shell):
            raise ValueError(
                f'{owner}: "{name}" is a shell, which takes EdgeLoad, SurfaceLoad and Pressure'
            )
        if not isinstance(body, Beam):
            raise ValueError(f'{owner}: {model!r} has no beam "{name}"')
    for name in load.shells:
        body = model.get(name)
        if not isinstance(body, Shell):
            raise ValueError(f'{owner}: {model!r} has no shell "{name}"')
        if isinstance(load, ShellLoad):
            assert model.surface is not None  # checked before
            load.check(model.surface, body.body)
    for marker in load.markers:
        _check_marker(model, owner, load, marker)


def _check_marker(model: Model, owner: str, load: Load, marker: Marker) -> None:
    """Check that a load at a node of a shell is a dead force."""
    if not isinstance(model.get(marker.body), Shell):
        return
    if not isinstance(load, PointForce):
        raise ValueError(
            f'{owner}: a node of Shell "{marker.body}" has a position only and takes no moment'
        )
    if load.follower:
        raise ValueError(
            f'{owner}: a node of Shell "{marker.body}" has no axes that a force could follow, '
            "use Pressure or a dead force"
        )
