# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of an Abaqus model where instances place them."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from flexfem.mesh.imported.deck import Deck, Sets

__all__ = ["Move", "collect", "in_instance", "placement"]

# Products of such numbers are still numbers
_FAR = 1e50

type Position = tuple[float, float, float]
type Move = Callable[[Position], Position]


def placement(rows: Sequence[Sequence[float]]) -> Move:
    """Return the map of positions of a part to those of its instance.

    Args:
        rows: A translation, then two points of the axis of a rotation and its angle in degrees;
            either may be missing from the end.

    Raises:
        ArithmeticError: The rows are none of these, or the axis has no length.
    """
    if not rows:
        return lambda position: position
    if len(rows) > 2 or len(rows[0]) > 3 or (len(rows) == 2 and len(rows[1]) != 7):
        raise ArithmeticError("the place must be a translation (3) and a rotation (7 numbers)")
    if max((abs(number) for row in rows for number in row), default=0.0) > _FAR:
        raise ArithmeticError(f"a number of its place is beyond {_FAR:g}")
    shift = np.array([*rows[0], 0.0, 0.0][:3])
    start, turn = np.zeros(3), np.eye(3)
    if len(rows) == 2:
        start, end, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), np.deg2rad(rows[1][6])
        length = np.linalg.norm(end - start)
        if length == 0.0:
            raise ArithmeticError("the axis of the rotation has no length")
        x, y, z = (end - start) / length
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross

    def move(position: Position) -> Position:
        x, y, z = (start + turn @ (position + shift - start)).tolist()
        return x, y, z

    return move


def in_instance[N: (int, range)](
    instance: str, keys: Iterable[tuple[str, N]]
) -> tuple[tuple[str, N], ...]:
    """Return the numbers of a part as those of an instance."""
    return tuple((instance, number) for _, number in keys)


def collect(model: Deck, instances: Sequence[tuple[str, Deck]]) -> None:
    """Add sets and surfaces of the parts of all instances to those of the model.

    A set keeps its name if no other one has it, and is INSTANCE.SET otherwise.
    """
    for kind in ("node_sets", "element_sets"):
        own: Sets = getattr(model, kind)
        both = Sets()  # those of the parts come first, as in the file
        inner = [
            (instance, part, name, keys)
            for instance, part in instances
            for name, keys in getattr(part, kind).items()
        ]
        times = Counter(name.lower() for *_, name, _ in inner)
        times.update(name.lower() for name, _ in own.items())
        for instance, part, name, keys in inner:
            full = name if times[name.lower()] == 1 else f"{instance}.{name}"
            both.add(full, in_instance(instance, keys))
            if name in part.optional:
                model.optional.add(full)
        for name, members in own.items():
            both.add(name, members)
        setattr(model, kind, both)
    for instance, part in instances:
        for name, facets in part.facets.items():
            full = name if name not in model.facets else f"{instance}.{name}"
            model.facets[full] = [in_instance(instance, nodes) for nodes in facets]
        model.unused.update(part.unused)
        model.skipped |= part.skipped
