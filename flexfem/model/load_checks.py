# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the loads of a model: that they act on bodies that can carry them."""

import numpy as np

from flexfem import _checks
from flexfem.core.load import Load
from flexfem.loads.line_load import LineLoad
from flexfem.loads.pressure import Pressure
from flexfem.loads.shell_load import ShellLoad
from flexfem.loads.surface_load import SurfaceLoad
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell
from flexfem.model.structure.structure import Structure

__all__ = ["check_load"]

#: Places at which functions of loads are tried.
_SAMPLES = 9
#: Part of a beam's length that is round-off of places at its end.
_ROUNDING = 1e-9
#: Description of places of a beam for messages.
_PLACES = {"length": "which is {:.6g} m long", "fraction": "whose fractions are 0 to 1"}


def check_load(model: Structure, load: Load) -> None:
    """Check where a load acts.

    Raises:
        ValueError: There is no such beam, shell or line, a load along a beam is on a shell, or a
            function of a load fails.
    """
    owner = f'{type(load).__name__} "{load.name}"'
    for marker in load.markers:
        if _without_axes(model.get(marker.body)) and (load.follower or load.has_moment):
            raise ValueError(
                f'{owner}: nodes of "{marker.body}" have no axes for moments and forces '
                "that follow them"
            )
    for name in load.beams:
        body = model.get(name)
        if isinstance(body, Shell):
            raise ValueError(
                f'{owner}: "{name}" is a shell, which takes EdgeLoad, SurfaceLoad and Pressure'
            )
        if not isinstance(body, Beam):
            raise ValueError(f'{owner}: {model!r} has no beam "{name}"')
    if isinstance(load, LineLoad):
        _check_functions(model, load)
    for name in load.shells:
        body = model.get(name)
        if isinstance(body, Body) and isinstance(load, (Pressure, SurfaceLoad)):
            if body.surface is None:
                raise ValueError(f'{owner}: "{name}" has no linear triangles')
            continue
        if not isinstance(body, Shell):
            raise ValueError(f'{owner}: {model!r} has no shell "{name}"')
        if isinstance(load, ShellLoad):
            assert model.surface is not None  # checked before
            load.check(model.surface, body.body)
    for name in load.bodies:
        body = model.get(name)
        if not isinstance(body, Body):
            raise ValueError(f'{owner}: {model!r} has no body "{name}" that takes it')
        body.check_load(owner, load)


def _without_axes(body: object) -> bool:
    """Return True if the nodes of a body have positions only, no rotations."""
    return isinstance(body, Body) and body.width == 3


def _check_functions(model: Structure, load: LineLoad) -> None:
    """Check what the functions of a load return at some places, and where they are broken."""
    beam = model[load.body]
    length = 1.0
    if load.coordinate == "length" and not load.uniform:
        length = model.beam_length(beam)
    for place in length * np.linspace(0.0, 1.0, _SAMPLES):
        load.at(float(place))
    outside = (load.breakpoints < -_ROUNDING * length) | (
        load.breakpoints > (1.0 + _ROUNDING) * length
    )
    if not load.uniform and outside.any():
        raise ValueError(
            f'LineLoad "{load.name}": {_checks.show(load.breakpoints[outside].tolist())} is not on '
            f'Beam "{beam.name}", {_PLACES[load.coordinate].format(length)}'
        )
