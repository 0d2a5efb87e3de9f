# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grid points, elements, properties and sets of a Nastran bulk data file (.bdf, .dat, .nas).

Read here and not with meshio, which takes all grid points as if they were in the basic coordinate
system, stumbles over element angles and offsets, and reads neither sets nor materials.
"""

import re
from collections.abc import Container
from pathlib import Path

import numpy as np

from flexfem import _checks
from flexfem.mesh.imported.deck import MEMBER, Deck, Key
from flexfem.mesh.imported.limits import Allowance, TextFiles, whole
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile
from flexfem.mesh.imported.nastran_cards import Card, cards
from flexfem.mesh.imported.nastran_points import SYSTEMS, GridPoints

__all__ = ["read"]

# Number of the first field with a grid point, and kinds by the number of points
_ELEMENTS = {
    "CBAR": (4, "line"), "CBEAM": (4, "line"), "CBEND": (4, "line"), "CROD": (4, "line"),
    "CTUBE": (4, "line"), "CONROD": (3, "line"), "CBEAM3": (4, "line3"),
    "CTRIA3": (4, "triangle"), "CTRIAR": (4, "triangle"), "CTRIA6": (4, "triangle", "triangle6"),
    "CQUAD4": (4, "quad"), "CQUADR": (4, "quad"), "CSHEAR": (4, "quad"),
    "CQUAD8": (4, "quad", "quad8"), "CQUAD": (4, "quad", "quad9"),
    "CTETRA": (4, "tetra", "tetra10"), "CHEXA": (4, "hexahedron", "hexahedron20"),
    "CPENTA": (4, "wedge", "wedge15"), "CPYRAM": (4, "pyramid", "pyramid13"),
    "CPYRA": (4, "pyramid", "pyramid13"),
}  # fmt: skip
_UNUSED = re.compile(r"C(ELAS|BUSH|DAMP|MASS|GAP|ONM|VISC|WELD|FAST|TRIAX|QUADX)\w*|RBE[123]|RBAR")
# Nastran: corners, bottom, upright, top; VTK: corners, bottom, top, upright
_ORDER = {"hexahedron20": [*range(12), *range(16, 20), *range(12, 16)], "line3": [0, 1, 2]}
_MATERIAL_FIELD = dict.fromkeys(
    ("PBAR", "PBARL", "PBEAM", "PBEAML", "PBEND", "PROD", "PTUBE", "PSHELL", "PSOLID", "PSHEAR"), 3
)


def read(path: Path) -> MeshFile:
    """Read a file.

    Element sets are called property_N (each element is in one) and, taken on request only,
    material_N and set_N; node sets set_N.

    Raises:
        ValueError: It cannot be read, with the line.
    """
    files = TextFiles(path)
    reader = _Reader(path, files.allowance)
    for card in cards(path, files):
        reader.take(card)
    return reader.finished()


class _Reader:
    """Collects cards."""

    def __init__(self, path: Path, allowance: Allowance) -> None:
        self.deck = Deck(path, allowance)
        self.property: dict[Key, int] = {}
        self.material: dict[Key, int] = {}
        self.materials: dict[int, int] = {}
        self.sets: list[tuple[Card, str, str, list[str]]] = []
        self.numbers = np.empty(0, dtype=np.int64)
        self.points = GridPoints()
        self.default_property = {"CBAR": "", "CBEAM": ""}

    def take(self, card: Card) -> None:
        """Read a card."""
        if card.name in ("GRID", "GRDSET") or card.name in SYSTEMS:
            self.points.take(card)
        elif card.name in _ELEMENTS:
            self._element(card)
        elif card.name in _MATERIAL_FIELD and card.field(_MATERIAL_FIELD[card.name]):
            self.materials[card.integer(2)] = card.integer(3)
        elif card.name in ("BAROR", "BEAMOR"):
            self.default_property[f"C{card.name[:-2]}"] = card.field(3)
        elif card.name in ("SET1", "SET3"):
            first = 3 if card.name == "SET3" else 2
            kind = card.field(3).upper() if card.name == "SET3" else ""
            self.sets.append((card, card.field(2), kind, card.fields[first - 1 :]))
        elif card.name == "SET":
            name, _, text = card.fields[0].partition("=")
            self.sets.append((card, name.strip(), "", re.split(r"[,\s]+", text.strip())))
        elif _UNUSED.fullmatch(card.name):
            self.deck.unused[card.name] += 1
            if (number := whole(card.field(2))) is not None:
                self.deck.elements.setdefault(("", number), ("", ()))

    def finished(self) -> MeshFile:
        """Return all that was read."""
        for number, (card, position) in self.points.positions().items():
            self.deck.add_node(("", number), position, card.line)
        for key, number in self.property.items():
            self.deck.element_sets.add(f"property_{number}", [key])
        for key, number in self.property.items():
            material = self.material.get(key, self.materials.get(number))
            if material is not None:
                self.deck.element_sets.add(f"material_{material}", [key])
                self.deck.optional.add(f"material_{material}")
        numbers = [number for _, number in (*self.deck.nodes, *self.deck.elements)]
        self.numbers = np.unique(np.array(numbers, dtype=np.int64))
        for entry in self.sets:
            self._set(*entry)
        return self.deck.mesh_file()

    def _element(self, card: Card) -> None:
        first, kind, *higher = _ELEMENTS[card.name]
        assert isinstance(first, int)
        key = ("", card.integer(2))
        count = KINDS[str(kind)].nodes
        for name in higher:  # with all of its middle nodes, or by its corners
            numbers = range(first, first + KINDS[str(name)].nodes)
            if all(whole(card.field(number)) is not None for number in numbers):
                kind, count = name, KINDS[str(name)].nodes
        nodes = [("", card.integer(first + i)) for i in range(count)]
        order = _ORDER.get(str(kind), range(count))
        self.deck.add_element(key, str(kind), tuple(nodes[i] for i in order), card.line)
        if card.name == "CONROD":
            self.property[key] = key[1]
            self.material[key] = card.integer(5)
            return
        text = card.field(3) or self.default_property.get(card.name) or card.field(2)
        number = whole(text)
        if number is None:
            card.fail(f"property {_checks.show(text)} is no number")
        self.property[key] = number

    def _set(self, card: Card, number: str, kind: str, items: list[str]) -> None:
        """Add a set of nodes, of elements, or of both where its numbers are those of both."""
        name, listed = f"set_{number}", self._listed(card, items)
        known: dict[str, Container[Key]] = {
            "GRID": self.deck.nodes,
            "ELEM": self.deck.elements,
        }
        if kind and kind not in known:
            self.deck.skipped[name] = f"a set of {kind}"
            return
        self.deck.skipped[name] = "its numbers are not all those of nodes, nor those of elements"
        for what, there in known.items():
            keys: list[Key] = [("", i) for i in listed if ("", i) in there]
            lost = any(exact and ("", i) not in there for i, exact in listed.items())
            if kind in ("", what) and keys and not lost:
                if what == "GRID":
                    self.deck.node_sets.add(name, keys)
                else:
                    self.deck.element_sets.add(name, keys)
                    self.deck.optional.add(name)
                self.deck.skipped.pop(name, None)

    def _listed(self, card: Card, items: list[str]) -> dict[int, bool]:
        """Return the numbers of a set, 1, 2, 5 THRU 9 EXCEPT 7, and whether they must be there.

        Of a range, only the numbers that the file has.
        """
        found: dict[int, bool] = {}
        words = [item.upper() for item in items if item]
        last, upper, after = 0, -1, ""
        for word in words:
            number = whole(word)
            if word in ("THRU", "EXCEPT"):
                after = word
            elif word == "ALL" and len(words) == 1:
                nodes = [number for _, number in self.deck.nodes]
                return self._optional(card, nodes)
            elif number is None:
                card.fail(f"cannot read {_checks.show(word)} in a set")
            elif after == "THRU":
                after, upper = "", number
                first, end = np.searchsorted(self.numbers, [last + 1, upper + 1])
                found.update(self._optional(card, self.numbers[first:end].tolist()))
            elif after == "EXCEPT" and number <= upper:
                found.pop(number, None)
            else:
                last, after = number, ""
                found[last] = True
        return found

    def _optional(self, card: Card, numbers: list[int]) -> dict[int, bool]:
        self.deck.allowance.take(MEMBER * len(numbers), f"the ranges of line {card.line}")
        return dict.fromkeys(numbers, False)
