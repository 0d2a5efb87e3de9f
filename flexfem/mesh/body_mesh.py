# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distributed meshes of elastic bodies with named groups; DOLFINx is imported late."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import _checks
from flexfem.installation import load_dolfinx
from flexfem.mesh.imported.gmsh_model import session
from flexfem.mesh.library import checked_build

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mpi4py import MPI

    from flexfem.mesh.imported.body import BodyData

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
        """Tags, and the tag of a group of facets: the form of a region of an interface.

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


def build_body_mesh(
    name: str | Path, comm: MPI.Intracomm | None = None, **parameters: float
) -> BodyMesh:
    """Build a mesh of solids or surfaces of the library, or by a script, on all ranks (collective).

    Args:
        name: a mesh of the library, or the path of a script (`own.py`); see :func:`build_mesh`.
        comm: communicator; None for all ranks.
        **parameters: arguments of that file's `build`.

    Raises:
        TypeError: a parameter is of the wrong kind.
        ValueError: unknown mesh or parameter, a value out of range, or nothing in named groups.
    """
    build = checked_build(name, parameters)
    return _distributed(f'mesh "{name}"', lambda: build(**parameters), comm)


def read_body_mesh(
    path: str | Path,
    comm: MPI.Intracomm | None = None,
    *,
    scale: float = 1.0,
    merge: float | None = None,
    bodies: Sequence[str] | None = None,
    facets: Sequence[str] | None = None,
) -> BodyMesh:
    """Read the solids of a mesh file, or its surfaces if it has no solids (collective).

    Element sets are groups of cells, which must not overlap; all of the file without any set is
    one group called after the file. Sets of faces, of surface elements and of nodes that have
    faces at the boundary of the body are groups of facets. Wedges, pyramids and mixtures of cells
    are cut into tetrahedra (triangles). Curved cells of second order stay curved unless they are
    cut.

    Args:
        path: as for :func:`read_mesh`.
        comm: communicator; None for all ranks.
        scale: metres in a unit of length of the file, 1e-3 for millimetres.
        merge: make nodes that are at most so far apart one, m; None leaves them apart.
        bodies: element sets to take; None for all.
        facets: sets to take as groups of facets; None for all that have some.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: the file is missing or unreadable, has neither solids nor surfaces or no such
            set, or groups overlap.
    """
    comm = _communicator(comm)
    data = _on_first(comm, lambda: _read(Path(path), scale, merge, bodies, facets))
    from flexfem.mesh.imported.distribute import distribute

    return BodyMesh(*distribute(comm, data))


def _read(
    path: Path,
    scale: float,
    merge: float | None,
    bodies: Sequence[str] | None,
    facets: Sequence[str] | None,
) -> BodyData:
    from flexfem.mesh.imported.body import body_data
    from flexfem.mesh.imported.read import read_mesh_file

    return body_data(read_mesh_file(path, scale, merge), bodies, facets)


def _on_first[T](comm: MPI.Intracomm, make: Callable[[], T]) -> T | None:
    """Return the result of the first rank, None on the others; its errors are raised on all."""
    made: T | None = None
    failure: Exception | None = None
    if comm.rank == 0:
        try:
            made = make()
        except Exception as error:  # on any error: the others must not wait
            failure = error
    failure = comm.bcast(failure)
    if failure is not None:
        raise failure
    return made


def _communicator(comm: MPI.Intracomm | None) -> MPI.Intracomm:
    load_dolfinx()
    from mpi4py import MPI

    return MPI.COMM_WORLD if comm is None else comm


def _distributed(owner: str, make: Callable[[], None], comm: MPI.Intracomm | None) -> BodyMesh:
    """Make a gmsh model on the first rank and distribute it."""
    comm = _communicator(comm)
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
    """The gmsh model on the first rank, None on the others; its errors are raised on all."""
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
