# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes, elements, sets and surfaces of an Abaqus input file (.inp).

Read here and not with meshio, which takes one *NODE block only, drops the contents of sets with
names of other sets, and reads neither parts and instances nor surfaces.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from flexfem import _checks
from flexfem.mesh.imported.abaqus_instances import Move, collect, in_instance, placement
from flexfem.mesh.imported.abaqus_statements import FACES, Statement, element_kind, statements
from flexfem.mesh.imported.deck import MEMBER, Deck, Key, Run, number_of
from flexfem.mesh.imported.limits import Allowance, TextFiles, real, whole
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["read"]

#: Keywords that change or generate nodes and elements and are not supported.
_REFUSED = (
    "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "SUBSTRUCTURE GENERATE",
)  # fmt: skip


def read(path: Path) -> MeshFile:
    """Read a file.

    Raises:
        ValueError: It cannot be read, with the line.
    """
    files = TextFiles(path)
    reader = _Reader(path, files.allowance)
    for statement in statements(path, files):
        reader.take(statement)
    return reader.finished()


class _Reader:
    """Collects statements: of the whole model, or of the part that is being defined."""

    def __init__(self, path: Path, allowance: Allowance) -> None:
        self.allowance = allowance
        self.model = Deck(path, allowance)
        self.deck = self.model
        self.parts: dict[str, Deck] = {}
        self.instances: dict[str, tuple[str, Deck]] = {}  # by their names in lower case
        self.move: Move | None = None  # of the instance that is being defined
        self.defined = ""  # its name in lower case

    def take(self, statement: Statement) -> None:
        """Read a statement."""
        if statement.keyword in _REFUSED:
            self.fail(statement, "cannot be read; write nodes and elements one by one")
        take = {
            "PART": self._part,
            "END PART": self._end_part,
            "INSTANCE": self._instance,
            "END INSTANCE": lambda _: self._end_instance(),
            "END ASSEMBLY": lambda _: self._end_instance(),
            "NODE": self._node,
            "ELEMENT": self._element,
            "NSET": self._nset,
            "ELSET": self._elset,
            "SURFACE": self._surface,
        }.get(statement.keyword)
        if take is not None:
            take(statement)

    def fail(self, statement: Statement, reason: str, line: int | None = None) -> NoReturn:
        """Raise for an error in a statement."""
        raise ValueError(
            f'mesh file "{statement.path}", line {line or statement.line}: '
            f"*{statement.keyword}: {reason}"
        )

    def finished(self) -> MeshFile:
        """Return all that was read."""
        self._end_instance()
        collect(self.model, list(self.instances.values()))
        return self.model.mesh_file()

    # --- parts ---------------------------------------------------------------------------------

    def _part(self, statement: Statement) -> None:
        self._end_instance()
        name = self._option(statement, "NAME")
        self.deck = self.parts[name.lower()] = Deck(self.model.path, self.allowance)

    def _end_part(self, _: Statement) -> None:
        self.deck = self.model

    def _instance(self, statement: Statement) -> None:
        """Begin an instance: the contents of its part, and the statements up to its end."""
        self._end_instance()
        name = self._option(statement, "NAME")
        part = self.parts.get(self._option(statement, "PART").lower())
        if part is None:
            self.fail(statement, f'instance "{name}" is of a part that is not in the file')
        if name.lower() in self.instances:
            self.fail(statement, f'instance "{name}" occurs twice')
        try:
            self.move = placement(
                [self._floats(statement, line, row) for line, row in statement.rows]
            )
        except ArithmeticError as error:
            self.fail(statement, str(error))
        self.allowance.take(6 * MEMBER * part.size, "the instances of its parts")
        self.deck = part.copy()
        self.instances[name.lower()] = name, self.deck
        self.defined = name.lower()

    def _end_instance(self) -> None:
        """Move the contents of an instance, its part's and its own, to its place."""
        if self.move is None:
            return
        name, deck = self.instances[self.defined]
        for (_, number), position in deck.nodes.items():
            self.model.nodes[name, number] = self.move(position)
        for (_, number), (kind, nodes) in deck.elements.items():
            self.model.elements[name, number] = (kind, in_instance(name, nodes))
        self.deck, self.move = self.model, None

    # --- nodes and elements --------------------------------------------------------------------

    def _node(self, statement: Statement) -> None:
        if statement.options.get("SYSTEM", "R").upper() != "R":
            self.fail(statement, "only rectangular coordinates can be read")
        added: list[Key] = []
        for line, row in statement.rows:
            numbers = self._integers(statement, line, row[:1])
            if not numbers:
                self.fail(statement, "a node has no number", line)
            x, y, z = (self._floats(statement, line, row[1:4]) + [0.0] * 3)[:3]
            key = ("", numbers[0])
            self.deck.add_node(key, (x, y, z), line)
            added.append(key)
        if name := statement.options.get("NSET"):
            self.deck.node_sets.add(name, added)

    def _element(self, statement: Statement) -> None:
        name = self._option(statement, "TYPE").upper()
        kind = element_kind(name)
        count = KINDS[kind].nodes if kind else 0
        added: list[Key] = []
        rows = iter(zip(statement.rows, statement.open, strict=True))
        for (line, row), first_open in rows:
            numbers, goes_on = self._integers(statement, line, row), first_open
            while (len(numbers) < count + 1) if kind else goes_on:
                following = next(rows, None)
                if following is None:
                    break
                (at, more), goes_on = following
                numbers += self._integers(statement, at, more)
            if kind and numbers and len(numbers) != count + 1:
                self.fail(
                    statement,
                    f"element {numbers[0]} of type {name} needs {count} nodes, got "
                    f"{len(numbers) - 1}",
                    line,
                )
            if not numbers:
                self.fail(statement, "an element has no number", line)
            key = ("", numbers[0])
            nodes = tuple(("", number) for number in numbers[1:]) if kind else ()
            # Abaqus numbers the middle of a line second, VTK last
            self.deck.add_element(
                key, kind, (nodes[0], nodes[2], nodes[1]) if kind == "line3" else nodes, line
            )
            added.append(key)
        if not kind:
            self.deck.unused[name] += len(added)
        if set_name := statement.options.get("ELSET"):
            self.deck.element_sets.add(set_name, added)

    # --- sets ----------------------------------------------------------------------------------

    def _nset(self, statement: Statement) -> None:
        name = self._option(statement, "NSET")
        members = self._members(statement, "node_sets")
        if source := statement.options.get("ELSET"):
            elements = self.deck.elements
            for key in self.deck.single(self._set(statement, "element_sets", source), elements):
                if key not in elements:
                    self.fail(statement, f"element {number_of(key)} is not in the file up to here")
                members += elements[key][1]
            self.allowance.take(MEMBER * len(members), f'node set "{name}"')
        self.deck.node_sets.add(name, members)
        if "INTERNAL" in statement.options:
            self.deck.optional.add(name)

    def _elset(self, statement: Statement) -> None:
        name = self._option(statement, "ELSET")
        self.deck.element_sets.add(name, self._members(statement, "element_sets"))
        if "INTERNAL" in statement.options:
            self.deck.optional.add(name)

    def _members(self, statement: Statement, kind: str) -> list[Key | Run]:
        """Return the members that the data lines of a set give by numbers and by names."""
        place = statement.options.get("INSTANCE", "")
        if place:
            place = self._instance_name(statement, place)
        members: list[Key | Run] = []
        for line, row in statement.rows:
            if "GENERATE" in statement.options:
                limits = self._integers(statement, line, row)
                if not 2 <= len(limits) <= 3 or limits[1] < limits[0] or limits[-1] < 1:
                    self.fail(statement, f"cannot generate from {_joined(row)}", line)
                step = limits[2] if len(limits) == 3 else 1
                members.append((place, range(limits[0], limits[1] + 1, step)))
                continue
            for item in filter(None, row):
                instance, _, last = item.rpartition(".")
                if (number := whole(item)) is not None:
                    members.append((place, number))
                elif (number := whole(last)) is not None:
                    members.append((self._instance_name(statement, instance, line), number))
                else:
                    members += self._set(statement, kind, item.strip('"'), line)
        return members

    def _instance_name(self, statement: Statement, name: str, line: int | None = None) -> str:
        """Return the name of an instance as it was defined."""
        same = self.instances.get(name.strip('"').lower())
        if same is None:
            self.fail(statement, f'there is no instance "{name}" up to here', line)
        return same[0]

    def _set(
        self, statement: Statement, kind: str, name: str, line: int | None = None
    ) -> list[Key | Run]:
        """Return the members of a set defined before, also one of an instance: "instance.set"."""
        found: list[Key | Run] | None = getattr(self.deck, kind).get(name)
        instance, _, inner = name.rpartition(".")
        if found is None and instance.lower() in self.instances:
            place, part = self.instances[instance.lower()]
            members = getattr(part, kind).get(inner)
            found = None if members is None else list(in_instance(place, members))
        if found is None:
            what = kind.replace("_", " ")[:-1]
            self.fail(statement, f'there is no {what} "{name}" up to here', line)
        self.allowance.take(MEMBER * len(found), "sets of sets")
        return found

    def _surface(self, statement: Statement) -> None:
        name = self._option(statement, "NAME")
        if statement.options.get("TYPE", "ELEMENT").upper() == "NODE":
            members: list[Key | Run] = []
            for line, row in statement.rows:
                members += self._named(statement, "node_sets", line, row)
            self.deck.node_sets.add(name, members)
            return
        if statement.options.get("TYPE", "ELEMENT").upper() != "ELEMENT":
            self.deck.skipped[name] = "a surface of another type than element and node"
            return
        facets: list[tuple[Key, ...]] = []
        for line, row in statement.rows:
            elements = self._named(statement, "element_sets", line, row)
            for key in self.deck.single(elements, self.deck.elements):
                kind, nodes = self.deck.elements.get(key, ("", ()))
                corners = FACES.get(kind, {}).get(row[1].upper() if len(row) > 1 else "")
                if corners is None:
                    self.deck.skipped[name] = "its surface names no face (S1) or edge (E1)"
                    return
                facets.append(tuple(nodes[corner] for corner in corners))
        self.allowance.take(MEMBER * len(facets), f'surface "{name}"')
        self.deck.facets[name] = facets

    def _named(
        self, statement: Statement, kind: str, line: int, row: list[str]
    ) -> Sequence[Key | Run]:
        """Return the elements of the first field of a line of a surface, a number or a set."""
        first = row[0] if row else ""
        number = whole(first)
        if number is None:
            return self._set(statement, kind, first.strip('"'), line)
        return [("", number)]

    # --- fields --------------------------------------------------------------------------------

    def _option(self, statement: Statement, name: str) -> str:
        value = statement.options.get(name, "")
        if not value:
            self.fail(statement, f"{name}=... is missing")
        return value

    def _integers(self, statement: Statement, line: int, row: list[str]) -> list[int]:
        numbers = [whole(item) for item in row if item]
        if None in numbers:
            self.fail(statement, f"needs whole numbers, got {_joined(row)}", line)
        return [number for number in numbers if number is not None]

    def _floats(self, statement: Statement, line: int, row: list[str]) -> list[float]:
        numbers = [real(item) if item else 0.0 for item in row]
        if None in numbers:
            self.fail(statement, f"needs numbers, got {_joined(row)}", line)
        return [number for number in numbers if number is not None]


def _joined(row: Sequence[str]) -> str:
    """Return the fields of a line for a message."""
    return _checks.show(", ".join(row))
