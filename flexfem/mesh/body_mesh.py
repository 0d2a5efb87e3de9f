# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distributed meshes of elastic bodies with named groups, from gmsh; DOLFINx is imported late."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import _checks
from flexfem.installation import load_dolfinx
from flexfem.mesh.gmsh_reader import merge, session
from flexfem.mesh.library import checked_build

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mpi4py import MPI

__all__ = ["BodyMesh", "build_body_mesh", "read_body_mesh"]


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A DOLFINx mesh and its named groups of cells and facets.

    Attributes:
        mesh: in body axes, m; on all ranks of its communicator.
        cell_tags: MeshTags of the cells.
        facet_tags: MeshTags of the facets in groups, None if there are none.
        groups: dimension and tag by name.
    """

    mesh: Any
    cell_tags: Any
    facet_tags: Any
    groups: dict[str, tuple[int, int]]

    def facets(self, name: str) -> tuple[Any, int]:
        """Tags and tag of a group of facets, which is how regions of interfaces are told.

        Raises:
            ValueError: there is no such group.
        """
        dimension = self.mesh.topology.dim - 1
        known = {key: tag for key, (dim, tag) in self.groups.items() if dim == dimension}
        if name not in known or self.facet_tags is None:
            raise ValueError(
                f"BodyMesh: no facet group {_checks.show(name)}; there are "
                f"{', '.join(sorted(known)) or 'none'}"
            )
        return self.facet_tags, known[name]


def build_body_mesh(name: str, comm: MPI.Intracomm | None = None, **parameters: float) -> BodyMesh:
    """Build a mesh of solids or surfaces of the library on all ranks (collective).

    Args:
        name: file name in the mesh folder without ".py".
        comm: communicator; None for all ranks.
        **parameters: arguments of that file's `build`.

    Raises:
        TypeError: a parameter is of the wrong kind.
        ValueError: unknown mesh or parameter, a value out of range, or nothing in named groups.
    """
    build = checked_build(name, parameters)
    return _distributed(f'mesh "{name}"', lambda: build(**parameters), comm)


def read_body_mesh(path: str | Path, comm: MPI.Intracomm | None = None) -> BodyMesh:
    """Read a gmsh file (.msh) with named groups of solids or surfaces (collective).

    Raises:
        ValueError: the file is missing or unreadable, or has nothing in named groups.
    """
    return _distributed(f'mesh file "{path}"', lambda: merge(Path(path)), comm)


def _distributed(owner: str, make: Callable[[], None], comm: MPI.Intracomm | None) -> BodyMesh:
    """Make a gmsh model on the first rank and distribute it."""
    load_dolfinx()
    from mpi4py import MPI

    comm = MPI.COMM_WORLD if comm is None else comm
    with _model(owner, make, comm) as model:
        from dolfinx.io import gmsh

        try:
            data = gmsh.model_to_mesh(model, comm, 0, gdim=3)
        except RuntimeError as error:
            raise ValueError(f"{owner}: {error}") from None
    groups = {key: (int(group.dim), int(group.tag)) for key, group in data.physical_groups.items()}
    return BodyMesh(data.mesh, data.cell_tags, data.facet_tags, groups)


@contextmanager
def _model(owner: str, make: Callable[[], None], comm: MPI.Intracomm) -> Iterator[Any]:
    """The gmsh model on the first rank, None on the others; its errors are everyone's."""
    if comm.rank != 0:
        if error := comm.bcast(None):
            raise error
        yield None
        return
    import gmsh

    with session("flexfem_body"):
        failure: Exception | None = None
        try:
            make()
            dimensions = [dim for dim, _ in gmsh.model.getPhysicalGroups()]
            if max(dimensions, default=0) < 2:
                raise ValueError(f"{owner}: no named group of solids or surfaces")
        except Exception as error:  # gmsh raises nothing more specific
            text = str(error) if isinstance(error, ValueError) else f"{owner}: {error}"
            failure = ValueError(" ".join(text.split()))
        comm.bcast(failure)
        if failure is not None:
            raise failure
        yield gmsh.model
