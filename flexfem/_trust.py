# SPDX-License-Identifier: LGPL-3.0-or-later
"""Trust in folders of compiled code: whoever can write there can run code as this user.

Numba and FFCx cache compiled code and load it without checking its origin. A folder is used for
that only where no one but its user, the system's administrator, and whoever owns the program itself
could have put something: neither it nor its parent folders belong to others, and none but them may
write there. A group of one user's name, as most distributions give every user, counts as this user.
"""

import atexit
import grp
import os
import pwd
import shutil
import stat
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from flexfem import launch

__all__ = ["private_folder", "trusted"]

#: Rights that let an access list name more users than the group's.
_ACCESS_LIST = "system.posix_acl_access"
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def trusted(folder: str | Path, advice: str, program: str | Path | None = None) -> bool:
    """Return True if nobody else can have written into a folder, which may not exist yet.

    Otherwise one line is printed, once a process and on the first rank only.

    Args:
        folder: where compiled code is kept.
        advice: remedy besides removing the write permission of others, such as "set X".
        program: folder of the program whose code it is; its owner is trusted, too.
    """
    key = (str(folder), str(program))
    if key in _GOOD:
        return True
    owners = {0, os.geteuid()}
    if program is not None:
        owners.add(Path(program).stat().st_uid)
    why = _fault(Path(folder).absolute(), frozenset(owners))
    if why:
        _tell(why, advice)
    elif Path(folder).is_dir():
        _GOOD.add(key)
    return not why


#: Folders, and those of their programs, that were checked: a package has hundreds of loops.
_GOOD: set[tuple[str, str]] = set()


@cache
def _tell(why: str, advice: str) -> None:
    launch.say(
        f"warning: compiled code in folders that other users can write to is not used: {why}; "
        f"it is recompiled elsewhere until you remove that permission (chmod go-w), or {advice}",
        error=True,
    )


def _fault(folder: Path, owners: frozenset[int]) -> str:
    """Return a way in which others could write into a folder; empty if they cannot."""
    for chain in {folder, folder.resolve()}:  # a link may be led elsewhere
        for path in (chain, *chain.parents):
            if path.exists() and (why := _of_rights(path, path.stat(), owners, path == chain)):
                return why
    return next(_strangers(folder, owners), "")


def _of_rights(path: Path, found: os.stat_result, owners: frozenset[int], leaf: bool) -> str:
    """Return a fault in the owner or permissions of a file or folder; empty if there is none."""
    if found.st_uid not in owners:
        return f'"{path}" belongs to {_user(found.st_uid)}'
    if found.st_mode & stat.S_ISVTX and not leaf:
        return ""  # as in /tmp: others cannot replace its contents
    if found.st_mode & stat.S_IWOTH:
        return f'all users may write into "{path}"'
    if found.st_mode & stat.S_IWGRP and not _own_group(path, found.st_gid):
        return f'the group {_group(found.st_gid)} may write into "{path}"'
    return ""


def _strangers(folder: Path, owners: frozenset[int]) -> Iterator[str]:
    """Files in a folder that others put there, or may change, while they could."""
    try:
        entries = os.scandir(folder)
    except OSError:
        return
    with entries:
        for entry in entries:
            try:
                found = entry.stat(follow_symlinks=False)
            except OSError:  # gone meanwhile
                continue
            ours = found.st_uid in owners
            # there are hundreds, nearly all of them plain; a link's own rights mean nothing
            if ours and (not found.st_mode & _OTHERS_WRITE or stat.S_ISLNK(found.st_mode)):
                continue
            if why := _of_rights(Path(entry.path), found, owners, leaf=True):
                yield why


def _own_group(path: Path, number: int) -> bool:
    """Return True if a group has no members but this user, or the administrator.

    Users whose first group it is are in no list that could be read at no cost. A group of the
    user's own name is this user's by the convention of useradd.
    """
    names = {_user(os.geteuid()), "root"}
    try:
        group = grp.getgrgid(number)
        listed = _ACCESS_LIST in os.listxattr(path) if hasattr(os, "listxattr") else False
    except (KeyError, OSError):
        return False
    return group.gr_name in names and set(group.gr_mem) <= names and not listed


@cache
def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


@cache
def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


@cache
def private_folder() -> Path:
    """A folder of this process alone, removed at its end: nothing in it is older than that.

    Raises:
        FileNotFoundError: there is no place for temporary files where others cannot exchange it.
    """
    owners = frozenset({0, os.geteuid()})
    places = [Path(place) for place in (tempfile.gettempdir(), "/tmp", "/var/tmp")]
    for place in places:
        inside = place / "flexfem"  # the place itself may be everybody's if it is like /tmp
        if place.is_dir() and not _fault(inside.absolute(), owners):
            folder = tempfile.mkdtemp(prefix="flexfem-", dir=place)
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
            return Path(folder)
    raise FileNotFoundError("no folder for temporary files that others cannot change; set TMPDIR")
