# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache of compiled loops on disk: its folder, and the stamps that invalidate entries.

They are in the folders that numba uses, except folders that other users can write to
(``flexfem._trust``). Numba recompiles a loop when its own file has changed. Loops of this package
contain code of other files, whose functions are inlined or called: they are recompiled when any
module of the package that their file imports, directly or indirectly, has changed.
"""

import hashlib
import os
import re
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import (
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

from flexfem._trust import private_folder, trusted

__all__ = ["install", "source_stamp", "sources", "stamp_of"]

_OWN = Path(__file__)
_PACKAGE = _OWN.resolve().parents[1]
#: A module, or a package and the names that are imported from it, which may be modules.
_IMPORT = re.compile(
    r"^\s*(?:from|import) flexfem\.([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE
)


def source_stamp(
    file: Path, package: Path = _PACKAGE, read: Callable[[Path], bytes] = Path.read_bytes
) -> str:
    """Checksum of a module of the package and of all modules of the package that it imports."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(sources(file, package)):
        digest.update(read(path))
    return digest.hexdigest()


def sources(file: Path, package: Path = _PACKAGE) -> set[Path]:
    """A module and all modules of the package that it imports, directly or indirectly."""
    found: set[Path] = set()
    left = [file.resolve()]
    while left:
        path = left.pop()
        if path not in found:
            found.add(path)
            left += _imported(path, package)
    return found


@cache
def _imported(path: Path, package: Path) -> list[Path]:
    """Files of the package that a module imports from."""
    files = []
    for module, names in _IMPORT.findall(path.read_text()):
        found = [_file(package, module)]
        if found[0] is not None and found[0].name == "__init__.py":  # a package: of modules, maybe
            found += [_file(package, f"{module}.{name}") for name in re.findall(r"\w+", names)]
        files += [file for file in found if file is not None]
    # the folder of loops does not change them
    return [file for file in files if file != _OWN]


@cache
def _file(package: Path, module: str) -> Path | None:
    """File of a module, or of a package, which many modules import; None for another name."""
    path = os.path.join(package, *module.split("."))  # noqa: PTH118 - a third of the time
    names = (os.path.join(path, "__init__.py"), f"{path}.py")  # noqa: PTH118
    return next((Path(name) for name in names if os.path.isfile(name)), None)  # noqa: PTH113


#: Time when this process began to import loops, s since 1970.
_BEGIN = time.time()


@cache
def _read(path: Path) -> bytes:
    """Contents of a file, which many modules import; of this process alone if it is newer.

    Stamps are made when a loop is first called: what was imported may then be older than the file.
    """
    if path.stat().st_ctime >= _BEGIN:
        return f"{path} {_BEGIN} {os.getpid()}".encode()
    return path.read_bytes()


@cache
def stamp_of(file: str) -> str | None:
    """Stamp of a module at the first request of this process, the same for all its code.

    None for a module of another program.
    """
    path = Path(file).resolve()
    return source_stamp(path, read=_read) if path.is_relative_to(_PACKAGE) else None


class _Kept:
    """Locator of loops in a folder to which no other user can write."""

    _py_file: str
    #: Advice if other users can write to it.
    _advice = "NUMBA_CACHE_DIR names a folder of your own"

    def ensure_cache_path(self) -> None:
        """Make the folder if it does not exist.

        Raises:
            OSError: the folder cannot be written, or other users can write to it.
        """
        self._check()
        super().ensure_cache_path()  # type: ignore[misc]
        self._check()  # another process may have made it meanwhile

    def _check(self) -> None:
        folder = self.get_cache_path()  # type: ignore[attr-defined]
        if not trusted(folder, self._advice, self._program()):
            raise PermissionError(f"others can write into {folder}")

    def _program(self) -> Path | None:
        """The folder of the program, whose owner is trusted as well."""
        return None

    def get_source_stamp(self) -> Any:
        """See :func:`source_stamp`; that of numba for loops of other programs."""
        own = stamp_of(self._py_file)
        return super().get_source_stamp() if own is None else own  # type: ignore[misc]


class ProvidedLocator(_Kept, UserProvidedCacheLocator):
    """Locator in the folder that NUMBA_CACHE_DIR names."""


class InTreeLocator(_Kept, InTreeCacheLocator):
    """Locator beside the source: the owner of a program is trusted with its compiled code."""

    def _program(self) -> Path | None:
        return Path(self._py_file).parent


class UserWideLocator(_Kept, UserWideCacheLocator):
    """Locator in the user's cache folder."""


class ProcessLocator(_Kept, InTreeCacheLocator):
    """Locator in a temporary folder of this process, if there is no other: recompiled each time."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        """Choose the folder."""
        super().__init__(py_func, py_file)
        self._cache_path = str(private_folder() / self.get_suitable_cache_subpath(py_file))


def install() -> None:
    """Make numba cache loops by these rules, and those of notebooks by its own."""
    settings: Any = config
    if Path(".numba_config.yaml").exists():  # the working folder may be writable for others
        settings.CACHE_DIR = os.environ.get("NUMBA_CACHE_DIR", "")
        settings.CACHE_LOCATOR_CLASSES = os.environ.get("NUMBA_CACHE_LOCATOR_CLASSES", "")
    if not settings.CACHE_LOCATOR_CLASSES:
        own = [ProvidedLocator, InTreeLocator, UserWideLocator, ProcessLocator]
        places = [f"{__name__}.{locator.__name__}" for locator in own]
        settings.CACHE_LOCATOR_CLASSES = ",".join(["IPythonCacheLocator", *places])
