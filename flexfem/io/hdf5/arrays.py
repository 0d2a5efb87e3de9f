# SPDX-License-Identifier: LGPL-3.0-or-later
"""h5py with its own HDF5 library, and arrays in files that may be forged.

Only files as the package writes them are read: a file of this format may name other files as its
contents, claim more numbers than it has bytes, or have its numbers made by filters. Arrays of ours
are whole, in the file, and take as many bytes there as in memory; tables are in compressed chunks.
"""

import os
import sys
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["PlainFile", "load_h5py"]

#: Kinds of numbers: as ours, whatever the computer.
_KINDS = "fiub"
#: Filters of tables: deflate, shuffle and Fletcher's checksum.
_FILTERS = {1, 2, 3}
#: Bytes of a chunk at most, and those that a byte of deflated data can stand for.
_CHUNK, _RATIO = 2.0**24, 1100.0


@cache
def load_h5py() -> ModuleType:
    """Import h5py; a tenth of a second, so not before the first file.

    Scripts that import ``dolfinx.fem.petsc`` make the symbols of PETSc's HDF5 library global, where
    h5py would find them in place of its own: another version with other layouts in memory. So its
    own libraries come first where the system can say so.
    """
    flags = sys.getdlopenflags()
    sys.setdlopenflags(flags | getattr(os, "RTLD_DEEPBIND", 0))
    try:
        import h5py
    finally:
        sys.setdlopenflags(flags)
    module: ModuleType = h5py
    return module


class PlainFile:
    """Arrays and texts of an open file; their sizes together are below that of the file."""

    def __init__(self, file: Any, size: int) -> None:
        """Note the file.

        Args:
            file: open for reading.
            size: of the whole file in bytes.
        """
        self._file, self._left, self._size = file, size, size

    def names(self, group: str) -> list[str]:
        """Return the names in a group; the empty name is that of the whole file.

        Raises:
            ValueError: there is no such group in the file itself.
        """
        return list(self._item(group, "Group"))

    def has(self, name: str) -> bool:
        """Return True if an item of any kind has this name."""
        group, _, last = name.rpartition("/")
        return last in self._item(group, "Group")

    def array(self, name: str) -> Any:
        """An array of numbers that is not read yet.

        Raises:
            ValueError: it is not there, or nothing that the package writes.
        """
        dataset = self._item(name, "Dataset")
        if dataset.dtype.kind not in _KINDS or dataset.dtype.itemsize > 8:
            raise ValueError(f'"{name}" does not hold numbers')
        expected = float(np.prod(dataset.shape, dtype=np.float64)) * dataset.dtype.itemsize
        kept = 0 if dataset.is_virtual or dataset.external else dataset.id.get_storage_size()
        self._left -= expected
        if dataset.chunks is not None or kept != expected or self._left < 0:
            raise ValueError(f'"{name}" claims numbers that are not in the file')
        return dataset

    def values(self, name: str) -> NDArray[Any]:
        """An array of numbers.

        Raises:
            ValueError: as for :meth:`array`.
        """
        values: NDArray[Any] = self.array(name)[()]
        return np.asarray(values)

    def compressed(self, name: str) -> Any:
        """A table of doubles in compressed chunks that is not read yet.

        Raises:
            ValueError: it is not there, or nothing that the package writes.
        """
        dataset = self._item(name, "Dataset")
        plain = dataset.dtype.kind == "f" and dataset.dtype.itemsize == 8 and dataset.ndim == 2
        if not plain or dataset.chunks is None or dataset.is_virtual or dataset.external:
            raise ValueError(f'"{name}" does not hold a table in chunks')
        layout = dataset.id.get_create_plist()
        used = {layout.get_filter(k)[0] for k in range(layout.get_nfilters())}
        expected = 8.0 * float(np.prod(dataset.shape, dtype=np.float64))
        chunk = 8.0 * float(np.prod(dataset.chunks, dtype=np.float64))
        kept = dataset.id.get_storage_size()
        if used - _FILTERS or chunk > _CHUNK or expected > _RATIO * min(kept, self._size):
            raise ValueError(f'"{name}" claims numbers that are not in the file')
        return dataset

    def texts(self, name: str) -> list[str]:
        """A list of texts of the same room.

        Raises:
            ValueError: it is not there, or no such list.
        """
        dataset = self._item(name, "Dataset")
        if dataset.dtype.kind != "S" or dataset.ndim != 1 or dataset.is_virtual or dataset.external:
            raise ValueError(f'"{name}" does not hold texts')
        size = dataset.shape[0] * dataset.dtype.itemsize
        if dataset.chunks is not None or size != dataset.id.get_storage_size() or size > self._size:
            raise ValueError(f'"{name}" claims texts that are not in the file')
        return [text.decode() for text in dataset[()].tolist()]

    def has_attribute(self, name: str) -> bool:
        """Return True if the file has an attribute of this name."""
        return name in self._file.attrs

    def text(self, name: str) -> str:
        """An attribute of the file that is a text.

        Raises:
            ValueError: there is none.
        """
        value = self._file.attrs.get(name)
        if not isinstance(value, str):
            raise ValueError(f'its attribute "{name}" is no text')
        return value

    def number(self, name: str) -> float:
        """An attribute of the file that is a number.

        Raises:
            ValueError: there is none.
        """
        value = self._file.attrs.get(name)
        if not isinstance(value, (int, float, np.integer, np.floating)):
            raise ValueError(f'its attribute "{name}" is no number')
        return float(value)

    def _item(self, name: str, kind: str) -> Any:
        """Return the item of a name and a kind in this very file."""
        item = self._file
        for path in filter(None, name.split("/")):
            link = item.get(path, getlink=True) if path in item else None
            if type(link).__name__ != "HardLink":
                raise ValueError(f'it has no "{name}"')
            item = item[path]
        if name and type(item).__name__ != kind:
            raise ValueError(f'it has no "{name}"')
        return item
