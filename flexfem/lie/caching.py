# SPDX-License-Identifier: LGPL-3.0-or-later
"""When compiled loops kept on disk are out of date.

Numba compiles a loop anew when its own file has changed. Ours contain code of other files, whose
functions are inlined or called: they are compiled anew when any module of the package that their
file imports has changed, also by way of others.
"""

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import (
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

__all__ = ["install", "source_stamp"]

_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORT = re.compile(r"^\s*(?:from|import) flexfem\.([\w.]+)", re.MULTILINE)


def source_stamp(file: Path, package: Path = _PACKAGE) -> str:
    """Checksum of a module of the package and of all modules of the package that it imports."""
    found: set[Path] = set()
    left = [file.resolve()]
    while left:
        path = left.pop()
        if path not in found:
            found.add(path)
            left += _imported(path, package)
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(found):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _imported(path: Path, package: Path) -> list[Path]:
    """Files of the package that a module imports from."""
    names = (package / name.replace(".", "/") for name in _IMPORT.findall(path.read_text()))
    files = (name / "__init__.py" if name.is_dir() else name.with_suffix(".py") for name in names)
    return [file for file in files if file.is_file()]


@cache
def _stamp(file: str) -> str:
    """That of a module as it was when this process first asked: all its loops have the same."""
    return source_stamp(Path(file))


class _OfPackage:
    """Locator of loops of this package, whose stamp is that of all they are made of."""

    _py_file: str

    def get_source_stamp(self) -> str:
        """See :func:`source_stamp`."""
        return _stamp(self._py_file)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Locator of a function, None for those of others."""
        if not Path(py_file).resolve().is_relative_to(_PACKAGE):
            return None
        return super().from_function(py_func, py_file)  # type: ignore[misc]


class ProvidedLocator(_OfPackage, UserProvidedCacheLocator):
    """In the folder that NUMBA_CACHE_DIR names."""


class InTreeLocator(_OfPackage, InTreeCacheLocator):
    """Beside the source."""


class UserWideLocator(_OfPackage, UserWideCacheLocator):
    """In the user's folder of caches."""


def install() -> None:
    """Let numba keep loops of this package by these rules, all others by its own."""
    own = [f"{__name__}.{c.__name__}" for c in (ProvidedLocator, InTreeLocator, UserWideLocator)]
    usual = ["UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator"]
    settings: Any = config
    if not settings.CACHE_LOCATOR_CLASSES:
        settings.CACHE_LOCATOR_CLASSES = ",".join([*own, *usual, "IPythonCacheLocator"])
