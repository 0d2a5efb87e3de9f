# SPDX-License-Identifier: LGPL-3.0-or-later
"""The model: bodies, joints, loads, probes, events and controllers by name."""

from typing import Any, overload

from flexfem import _checks
from flexfem.core.joint import Joint
from flexfem.core.load import Load
from flexfem.loads.gravity import Gravity
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.contact import Contact
from flexfem.model.controller import Controller
from flexfem.model.event import Event
from flexfem.model.many import Many
from flexfem.model.modal_damping import ModalDamping
from flexfem.model.probes.base import AnyProbe
from flexfem.model.structure.structure import Structure
from flexfem.model.table import model_table
from flexfem.model.validate import validate

# Kinds of named things and the lists they are kept in
_LISTS: tuple[tuple[type, str], ...] = (
    (Beam, "beams"),
    (Shell, "shells"),
    (RigidBody, "rigid_bodies"),
    (FloatingBody, "floating_bodies"),
    (Body, "other_bodies"),
    (PointMass, "point_masses"),
    (Joint, "joints"),
    (Load, "loads"),
    (Contact, "contacts"),
    (Event, "events"),
    (AnyProbe, "probes"),
    (Controller, "controllers"),
    (ModalDamping, "modal_dampings"),
)


class Model(Structure):
    """Declarative description of a multibody system, the same on all ranks.

    Attributes:
        name: Name of the model.
        mesh: Mesh of the beams along groups, None when there are none.
        surface: Mesh of the shells, None when there are none.
        gravity: Uniform gravity, None for none.
        beams: Beams in the order they were added.
        shells: Shells in the order they were added.
        rigid_bodies: Rigid bodies in the order they were added.
        floating_bodies: Bodies in floating frames in the order they were added.
        other_bodies: Bodies of further families in the order they were added.
        point_masses: Point masses in the order they were added.
        joints: Joints in the order they were added.
        loads: Loads in the order they were added.
        contacts: Contacts in the order they were added.
        probes: Probes in the order they were added.
        events: Events in the order they were added.
        controllers: Controllers in the order they were added.
        modal_dampings: Damping of modes in the order it was added.
        released: Names of joints that are open at the start.
    """

    def __init__(
        self,
        name: str = "model",
        *,
        mesh: LineMesh | None = None,
        surface: SurfaceMesh | None = None,
    ) -> None:
        """Create an empty model.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: The name is empty.
        """
        super().__init__(name, mesh, surface)
        self.contacts: list[Contact] = []
        self.events: list[Event] = []
        self.probes: list[AnyProbe] = []
        self.controllers: list[Controller] = []
        self.modal_dampings: list[ModalDamping] = []

    @overload
    def add[Thing](self, thing: Thing, /) -> Thing: ...

    @overload
    def add(self, *things: Any) -> None: ...

    def add(self, *things: Any) -> Any:
        """Add bodies, joints, loads, contacts, probes, events, controllers, damping or gravity.

        Args:
            *things: What to add, in any order, also :class:`Many` of a class at once; references
                by name are checked by `validate`.

        Returns:
            The object when a single one was given, otherwise None.

        Raises:
            TypeError: An object of another kind.
            ValueError: A name that the model has already, or gravity a second time.
        """
        for thing in things:
            if isinstance(thing, Gravity):
                if self.gravity is not None:
                    raise ValueError(
                        f"{self!r}: gravity is there already, got a second one, "
                        f"{_checks.show(thing.acceleration.tolist())}"
                    )
                self.gravity = thing
            elif isinstance(thing, Many):
                for one in thing:
                    self._add_named(one)
            else:
                self._add_named(thing)
        return things[0] if len(things) == 1 else None

    def _add_named(self, thing: Any) -> None:
        """Append one named object to the list of its kind."""
        attribute = next((name for kind, name in _LISTS if isinstance(thing, kind)), None)
        if attribute is None:
            part_of = getattr(type(thing), "part_of", "")
            hint = f", which is part of a {part_of}" if part_of else ""
            raise TypeError(
                f"{self!r}: only bodies, joints, loads, contacts, probes, events, controllers and "
                f"gravity can be added, got {_checks.show(thing)}{hint}"
            )
        if thing.name in self._named:
            other = type(self._named[thing.name]).__name__
            raise ValueError(
                f'{type(thing).__name__} "{thing.name}": the name is used already by a {other}'
            )
        self._named[thing.name] = thing
        getattr(self, attribute).append(thing)

    def release(self, *joints: str) -> None:
        """Leave joints open at the start, until the action of an event closes them.

        Raises:
            TypeError: A name is not a string.
        """
        self.released += [_checks.text(repr(self), "release", name) for name in joints]

    def validate(self) -> None:
        """Check that everything fits together.

        Raises:
            TypeError: An orientation function returns something else than numbers.
            ValueError: The first mistake found, in one line naming object and value.
        """
        validate(self)

    def __str__(self) -> str:
        """Return a compact table of the contents of the model."""
        return model_table(self)
