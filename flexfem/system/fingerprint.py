# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fingerprint of a model: whether a checkpoint belongs to it.

Names, types and numbers of all that is in the model count, numbers to nine digits, so that another
machine's last digits do no harm. What a function computes cannot be told: two models that differ
only in plain functions (a drive, an amplitude that is no ``Table`` or ``SmoothStep``) are taken for
one.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from flexfem.core.marker import Marker
from flexfem.model.floating_body import FloatingBody
from flexfem.system.assembly import Assembly

__all__ = ["fingerprint"]

#: Numbers count in steps of this part of a power of two above the largest of their array.
_STEP = 2.0**-30
#: Largest numbers change their power of two here and not at 1, where last digits would matter.
_BORDER = 1.37


def fingerprint(serial: Assembly) -> dict[str, str]:
    """Checksum of every kind of thing in a model; equal on all ranks."""
    model = serial.model
    parts: dict[str, Any] = {
        "beams": model.beams,
        "contacts": model.contacts,
        "controllers": [
            (c.name, c.inputs, c.outputs, c.sample_time, c.law) for c in model.controllers
        ],
        "events": (model.events, model.released),
        "floating bodies": [_floating(body) for body in model.floating_bodies],
        "gravity": model.gravity,
        "joints": model.joints,
        "loads": model.loads,
        "mesh": _lines(serial),
        "point masses": model.point_masses,
        "probes": [(probe.name, probe.columns) for probe in model.probes],
        "rigid bodies": model.rigid_bodies,
        "shells": model.shells,
        "surface": _surface(serial),
    }
    return {name: _Digest(serial).of(part) for name, part in parts.items()}


def _floating(body: FloatingBody) -> tuple[Any, ...]:
    """What the motion of a body in a floating frame depends on; not its pictures."""
    data = body.reduced
    return (
        body.name, body.frame, body.stiffening, data.interfaces, data.mass, data.moments,
        np.abs(data.stiffness), body.position, body.rotation, body.velocity, body.angular_velocity,
    )  # fmt: skip


def _lines(serial: Assembly) -> tuple[Any, ...]:
    """Nodes and elements of all beams."""
    parts: list[Any] = []
    if serial.sections:
        parts += [serial.points, serial.cells.cells, serial.frames]
    if serial.curves is not None:
        nodes = [serial.curves.nodes(beam) for beam in range(len(serial.curves.beams))]
        parts += [serial.curves.frames, nodes]
    return tuple(parts)


def _surface(serial: Assembly) -> tuple[Any, ...]:
    """Nodes and triangles of all shells, and what holds at their edges."""
    surface = serial.surface
    if surface is None:
        return ()
    return surface.mesh.triangles, surface.frames, surface.rules, surface.held, surface.averaged


class _Digest:
    """Checksum of nested data."""

    def __init__(self, serial: Assembly) -> None:
        self._serial, self._hash = serial, hashlib.blake2b(digest_size=8)

    def of(self, value: Any) -> str:
        """Checksum of a value and all it holds."""
        self._add(value)
        return self._hash.hexdigest()

    def _add(self, value: Any) -> None:
        if isinstance(value, np.ndarray | np.generic | float):
            self._array(np.asarray(value))
        elif value is None or isinstance(value, bool | int | str):
            self._text(f"{type(value).__name__} {value!r}")
        elif isinstance(value, list | tuple):
            self._text(f"sequence of {len(value)}")
            for entry in value:
                self._add(entry)
        elif isinstance(value, Mapping):
            self._add(sorted(value.items()))
        elif is_dataclass(value) and not isinstance(value, type):
            self._text(type(value).__name__)
            self._add(vars(value))
            if isinstance(value, Marker):  # groups of the mesh may have been renamed or moved
                self._add(self._serial.place(value) or self._serial.key(value))
        else:
            self._text("function" if callable(value) else type(value).__name__)

    def _text(self, text: str) -> None:
        self._hash.update(text.encode() + b"\0")

    def _array(self, values: np.ndarray[Any, Any]) -> None:
        self._text(f"array {values.shape}")
        if values.dtype.kind == "f" and not np.isfinite(values).all():  # limits that are none
            self._text(repr(values[~np.isfinite(values)].tolist()))
            values = np.where(np.isfinite(values), values, 0.0)
        if values.dtype.kind == "f" and values.size:
            exponent = int(np.frexp(_BORDER * np.abs(values).max())[1])
            self._text(str(exponent))
            values = np.rint(np.ldexp(values, -exponent) / _STEP)
        self._hash.update(np.ascontiguousarray(values, dtype=np.int64).tobytes())
