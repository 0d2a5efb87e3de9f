# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of links, from the geometry that a URDF file gives them."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexfem.core.pose import Pose
from flexfem.mesh.imported.surface_files import read_surface
from flexfem.model.bodies.shapes import Box, Capsule, Cylinder, Shape, Sphere, SurfaceShape
from flexfem.robots.description import origin
from flexfem.robots.elements import Element
from flexfem.robots.tree import LinkData

__all__ = ["PICTURES", "link_shapes"]

#: Pictures of links: their elements of this name, or none.
PICTURES = ("visual", "collision", "none")

_SCHEMES = ("package://", "model://")
_GEOMETRIES = ("box", "cylinder", "sphere", "capsule", "mesh")


def link_shapes(
    link: LinkData, pictures: str, packages: Mapping[str, Path], folder: Path
) -> list[tuple[Shape, Pose]]:
    """Shapes of a link and where they are in its frame.

    Args:
        link: the link.
        pictures: one of ``PICTURES``.
        packages: folders of packages by name.
        folder: where the URDF file is.

    Raises:
        ValueError: a mistake in an element, or a mesh that cannot be found or read.
    """
    if pictures == "none":
        return []
    parts = []
    for element in link.visual if pictures == "visual" else link.collision:
        known = ("origin", "geometry", "material", "verbose")
        geometry = element.only(("name", "group"), known).required("geometry").only((), _GEOMETRIES)
        pose = origin(element)
        if len(geometry.children) != 1:
            geometry.refuse(f"must hold one of {', '.join(_GEOMETRIES)}")
        parts += [(s, pose @ own) for s, own in _shapes(geometry.children[0], packages, folder)]
    return parts


def _shapes(
    element: Element, packages: Mapping[str, Path], folder: Path
) -> list[tuple[Shape, Pose]]:
    """Shapes of one geometry about its own origin."""
    if element.tag == "box":
        x, y, z = element.only(("size",)).numbers("size", 3).tolist()
        if min(x, y, z) <= 0.0:
            element.refuse(f'size must be positive, got "{element.attributes["size"]}"')
        return [(Box((x, y, z)), Pose())]
    if element.tag == "sphere":
        return [(Sphere(element.only(("radius",)).number("radius", positive=True)), Pose())]
    if element.tag == "mesh":
        return [(_mesh(element.only(("filename", "scale")), packages, folder), Pose())]
    element.only(("radius", "length"))
    radius, length = (element.number(name, positive=True) for name in ("radius", "length"))
    kind = Cylinder if element.tag == "cylinder" else Capsule
    return [(kind(radius, length, (0.0, 0.0, 1.0)), Pose())]


def _mesh(element: Element, packages: Mapping[str, Path], folder: Path) -> SurfaceShape:
    """A triangulated surface from an STL or OBJ file."""
    scale = element.numbers("scale", 3, (1.0, 1.0, 1.0))
    if not scale.all():
        element.refuse(f'scale must not be zero, got "{element.attributes["scale"]}"')
    path = _found(element, packages, folder)
    try:
        points, triangles = read_surface(path)
    except ValueError as error:
        element.refuse(f'filename "{path}": {error}; pictures="collision" or "none" avoid it')
    mirrored = np.prod(scale) < 0.0
    return SurfaceShape(points * scale, triangles[:, ::-1] if mirrored else triangles)


def _found(element: Element, packages: Mapping[str, Path], folder: Path) -> Path:
    """The file that a mesh names."""
    name = element.text("filename")
    scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), None)
    if scheme is None:
        path = folder / name.removeprefix("file://")
    else:
        package, _, rest = name.removeprefix(scheme).partition("/")
        path = _package(element, package, packages, folder) / rest
    try:
        there = path.is_file()
    except OSError:  # a name that no system takes
        there = False
    if not there:
        element.refuse(f'filename "{name}": there is no file "{path}"')
    return path


def _package(element: Element, name: str, packages: Mapping[str, Path], folder: Path) -> Path:
    """Folder of a package: a given one, one around the URDF file, or one of ROS_PACKAGE_PATH."""
    if name in packages:
        return packages[name]
    around = (folder.resolve(), *folder.resolve().parents)
    places = [path.parent for path in around if path.name == name] + list(around)
    places += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    found = next((place / name for place in places if (place / name).is_dir()), None)
    if found is None:
        element.refuse(
            f'package "{name}" is neither around the file nor in ROS_PACKAGE_PATH; give '
            f'packages={{"{name}": "folder"}}, or pictures="none"'
        )
    return found
