# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values that no material, planet or machine has: mostly units that are not SI."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexfem.inspection.finding import Finding, listed, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.materials.section import Section
from flexfem.materials.shell_section import ShellSection
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.shapes import SurfaceShape
from flexfem.model.rigid_surface import RigidMesh

#: Speed of longitudinal waves, m/s: jelly has some metres a second, diamond 18 km/s.
_SPEED = (8.0, 3e4)
#: Young's modulus, Pa: soft foams and gels have some kPa, carbon nanotubes 1 TPa. Fabrics and
#: ideal models may have less.
_MODULUS = (1e2, 5e12)
#: Density, kg/m^3, of the material in the outline: osmium has 22,600, hollow sections of foil
#: little.
_DENSITY = (1e-2, 3e4)
#: Gravity, m/s^2: the Sun has 274, centrifuges in laboratories less than this.
_GRAVITY = 400.0
#: Size of a model, m.
_SIZE = (1e-6, 1e6)
#: A mesh body of this length, m, that is so many times as long as another body is one in mm.
_LARGE, _TIMES = 30.0, 300.0
#: Bodies whose meshes come from files.
_OF_MESHES = ("shell", "floating body", "solid")
#: Radius of gyration of a rigid body relative to the model.
_GYRATION = 30.0


@dataclass(frozen=True)
class _Stuff:
    """Material properties, of beams and shells estimated from a section.

    Attributes:
        speed: of longitudinal waves, m/s; NaN without mass or stiffness.
        modulus: Young's modulus as if it filled its outline, Pa; NaN without an outline.
        density: as if it filled its outline, kg/m^3; NaN without an outline.
    """

    speed: float
    modulus: float
    density: float


def find(inspection: Inspection) -> Iterator[Finding]:
    """Gravity, sections, rigid bodies, size."""
    model = inspection.model
    if model.gravity is not None:
        size = float(np.linalg.norm(model.gravity.acceleration))
        if size > _GRAVITY:
            yield Finding(
                "units", "Gravity", f"{size:.6g} m/s^2 is {size / 9.81:.4g} times that on Earth",
                "give it in m/s^2, 9.81 on Earth, with lengths in m",
            )  # fmt: skip
    sections: dict[int, tuple[Section | ShellSection, list[str]]] = {}
    for mesh in inspection.meshes:
        section = mesh.section
        sections.setdefault(id(section), (section, []))[1].append(owner_of(mesh.body))
    for section, owners in sections.values():
        stuff = _of_shell(section) if isinstance(section, ShellSection) else _of_beam(section)
        yield from _material(inspection, stuff, listed(owners))
    for body in model.bodies:
        for modulus, density, speed in body.materials if isinstance(body, Body) else ():
            yield from _material(inspection, _Stuff(speed, modulus, density), owner_of(body))
    yield from _gyration(inspection)
    if inspection.extent and not _SIZE[0] <= inspection.extent <= _SIZE[1]:
        yield Finding(
            "units", repr(model), f"its size is {inspection.extent:.3g} m", "give lengths in m"
        )
    else:
        yield from _giants(inspection)
    yield from _obstacles(inspection)


def _giants(inspection: Inspection) -> Iterator[Finding]:
    """Bodies of meshes beside which others are specks: a mesh in millimetres, most likely."""
    families = inspection.serial.families.values()
    if not any(family.noun in _OF_MESHES and len(family.own) for family in families):
        return
    sizes = [float(np.linalg.norm(one.size)) for one in inspection.bodies]
    smallest = min((size for size in sizes if size > 0.0), default=np.inf)
    giants = [
        (owner_of(one.body), size)
        for one, size in zip(inspection.bodies, sizes, strict=True)
        if size > _LARGE and size > _TIMES * smallest and one.kind in _OF_MESHES
    ]
    if giants:
        yield Finding(
            "units", listed([owner for owner, _ in giants]),
            f"{max(size for _, size in giants):.3g} m long, other bodies have {smallest:.3g} m",
            "give lengths in m; the functions that read meshes take scale=1e-3 for millimetres",
        )  # fmt: skip


def _obstacles(inspection: Inspection) -> Iterator[Finding]:
    """Meshes of rigid surfaces and shapes beside which the model is a speck."""
    meshes = {
        f'{type(surface).__name__} {k} of Contact "{contact.name}"': surface.mesh.points
        for contact in inspection.model.contacts
        for k, surface in enumerate(contact.surfaces)
        if isinstance(surface, RigidMesh)
    }
    shaped = [one for one in inspection.model.rigid_bodies if isinstance(one.shape, SurfaceShape)]
    if not meshes and not shaped:
        return
    # the boxes of rigid bodies include their shapes
    own = {body.name for body in shaped}
    others = [one for one in inspection.bodies if one.name not in own]
    size = max((float(np.linalg.norm(one.size)) for one in others), default=0.0)
    for body in shaped:
        assert isinstance(body.shape, SurfaceShape)
        meshes[f"the shape of {owner_of(body)}"] = body.shape.points
    for owner, points in meshes.items():
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        if extent > _LARGE and 0.0 < _TIMES * size < extent:
            yield Finding(
                "units", owner, f"{extent:.3g} m long, what moves has {size:.3g} m",
                "give lengths in m; read_surface_mesh takes scale=1e-3 for millimetres",
            )  # fmt: skip


def _material(inspection: Inspection, stuff: _Stuff, owner: str) -> Iterator[Finding]:
    """The first value that no material has."""
    values = [
        ("Young's modulus", stuff.modulus, "Pa", _MODULUS, "2.1e11 Pa for steel"),
        ("density", stuff.density, "kg/m^3", _DENSITY, "7850 kg/m^3 for steel"),
        (
            "speed of sound, the root of stiffness by density,", stuff.speed, "m/s", _SPEED,
            "5000 m/s for steel",
        ),
    ]  # fmt: skip
    if inspection.moves is False:  # masses may be anything
        values = values[:1]
    for what, value, unit, (low, high), example in values:
        if value < low or value > high:
            yield Finding(
                "units", owner,
                f"its {what} is {value:.3g} {unit}, which no material has ({example})",
                "give moduli in Pa, densities in kg/m^3 and sizes in m",
            )  # fmt: skip
            return


def _of_beam(section: Section) -> _Stuff:
    mass = section.mass_per_length
    axial = np.nan if section.stiffness is None else float(section.stiffness[0, 0])
    area, radius = np.nan, section.round_radius
    if radius is not None:
        area = np.pi * radius**2
    elif section.outline is not None:
        y, z = section.outline.T
        area = 0.5 * abs(float(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))))
    density = mass / area if mass > 0.0 else np.nan
    return _Stuff(np.sqrt(axial / mass) if mass > 0.0 else np.nan, axial / area, density)


def _of_shell(section: ShellSection) -> _Stuff:
    mass, h = section.mass, section.thickness
    axial = float(section.stiffness[0, 0])
    speed, density = (np.sqrt(axial / mass), mass / h) if mass > 0.0 else (np.nan, np.nan)
    return _Stuff(speed, axial / h, density)


def _gyration(inspection: Inspection) -> Iterator[Finding]:
    """Rigid bodies whose inertia is that of something much larger than the model."""
    bodies = inspection.model.rigid_bodies
    inertia = np.array([body.inertia for body in bodies]).reshape(-1, 3, 3)
    moments = np.linalg.eigvalsh(inertia)[:, -1]
    radii = np.sqrt(moments / np.array([body.mass for body in bodies]))
    wide = radii > _GYRATION * inspection.extent if inspection.extent else np.zeros(0, np.bool_)
    for number in np.flatnonzero(wide):
        body, largest, radius = bodies[number], float(moments[number]), float(radii[number])
        yield Finding(
            "units", owner_of(body),
            f"its inertia of {largest:.3g} kg m^2 is that of a mass of {body.mass:.3g} kg at "
            f"{radius:.3g} m, the model has {inspection.extent:.3g} m",
            "give the inertia in kg m^2 about the mass centre",
        )  # fmt: skip
