# SPDX-License-Identifier: LGPL-3.0-or-later
"""``scene.json`` of a result folder: names and sections that the numbers in its series stand for.

It is written once a run. Series name bodies and joints by numbers, which ParaView can colour; a
viewer shows names. With the outlines of sections it sweeps surfaces of beams by itself, and with
what resultants mean for stresses there it has these as well, for a hundredth of their size.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexfem._checks import InputError, show
from flexfem._files import read_text, replace_file
from flexfem.materials.section_wall import SectionWall

__all__ = ["NAME", "SceneFile", "Walls"]

#: Walls at the first and at the second end of elements.
type Walls = tuple[tuple[SectionWall, ...], ...]

NAME = "scene.json"
#: Bytes of a file beyond which it must be something else.
_LARGEST = 256_000_000


@dataclass(frozen=True)
class SceneFile:
    """What the numbers in the series of a result folder stand for.

    Attributes:
        bodies: names of the bodies by the name of the series that shows them.
        joints: kind and name of every joint, such as ``("Revolute", "pivot")``.
        sections: of all beams, or of their elements: the walls, see ``Section.walls``, at both
            ends, or at one if they are the same there; none of one that is shown as a line.
    """

    bodies: Mapping[str, Sequence[str]] = field(default_factory=dict)
    joints: Sequence[tuple[str, str]] = ()
    sections: Sequence[Walls] = ()

    def write(self, folder: Path) -> None:
        """Write the file, replacing an earlier one as a whole.

        Raises:
            OSError: it cannot be written.
        """
        walls = [
            [[_wall_data(wall) for wall in end] for end in _different(ends)]
            for ends in self.sections
        ]
        data = {"bodies": dict(self.bodies), "joints": list(self.joints), "sections": walls}
        folder.mkdir(parents=True, exist_ok=True)
        replace_file(folder / NAME, [json.dumps(data, allow_nan=False).encode(), b"\n"])

    @classmethod
    def of(cls, folder: Path) -> SceneFile:
        """The scene of a folder; one without the file, of an older version, has no names."""
        path = folder / NAME
        return cls.read(path) if path.exists() else cls()

    @classmethod
    def read(cls, path: Path) -> SceneFile:
        """Read a file.

        Raises:
            InputError: it cannot be read, or is damaged.
        """
        owner = f"scene '{path}'"
        try:
            data = json.loads(read_text(owner, path, _LARGEST))
            bodies = {str(k): _names(v) for k, v in data["bodies"].items()}
            joints = [(str(kind), str(name)) for kind, name in data["joints"]]
            sections = [
                tuple(tuple(_wall(one) for one in end) for end in ends[:2])
                for ends in data["sections"]
            ]
        except InputError:
            raise
        except (
            ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError
        ) as error:  # fmt: skip
            reason = show(str(error) or type(error).__name__)
            raise InputError(f"{owner}: it is damaged ({reason})") from None
        return cls(bodies, joints, sections)

    def body(self, series: str, number: int) -> str:
        """Name of a body by its number in a series."""
        names = self.bodies.get(series, ())
        return names[number] if 0 <= number < len(names) else f"{series} {number}"

    def joint(self, number: int) -> tuple[str, str]:
        """Kind and name of a joint by its number."""
        found = 0 <= number < len(self.joints)
        return self.joints[number] if found else ("Joint", f"joint {number}")


def _different(ends: Walls) -> Walls:
    """Walls of one end where they are those of the other."""
    same = len(ends) == 2 and all(a is b for a, b in zip(*ends, strict=False))
    return ends[:1] if same and len(ends[0]) == len(ends[-1]) else ends


def _names(values: Sequence[Any]) -> list[str]:
    if not isinstance(values, list):
        raise TypeError("names of bodies are no list")
    return [str(value) for value in values]


def _wall_data(wall: SectionWall) -> dict[str, Any]:
    stress = None if wall.stress is None else np.asarray(wall.stress).tolist()
    return {"points": np.asarray(wall.points).tolist(), "stress": stress}


def _wall(data: Mapping[str, Any]) -> SectionWall:
    points = _numbers(data["points"])
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ValueError(f"an outline has the shape {points.shape}")
    stress = None if data["stress"] is None else _numbers(data["stress"])
    if stress is not None and stress.shape != (len(points), 2, 6):
        raise ValueError(f"stresses of an outline have the shape {stress.shape}")
    return SectionWall(points, stress)


def _numbers(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    found = np.array(values, dtype=np.float64)
    if not np.isfinite(found).all():
        raise ValueError("a number is not finite")
    return found
