# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints whose contents were changed, with a valid checksum."""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

__all__ = ["FORGERIES", "HEADERS", "each_kind", "endless", "forge", "seal"]

_BLOCK = 512


def each_kind[T](kinds: Iterable[T], *on_ranks: T) -> list[Any]:
    """Parameters of a test of all kinds on one process, and of the named ones on two ranks, too.

    What one rank refuses it refuses for all, so that one kind of each way to do so is enough.
    """
    assert set(on_ranks) <= set(kinds)
    return [
        kind if kind in on_ranks else pytest.param(kind, marks=pytest.mark.serial) for kind in kinds
    ]


def seal(path: Path) -> None:
    """Write number of bytes and checksum again, as the package would have."""
    data = path.read_bytes()[_BLOCK:]
    digest = hashlib.blake2b(data, digest_size=32).hexdigest()
    text = f"flexfem checkpoint\nformat 1\nbytes {len(data)}\nblake2b {digest}\n"
    path.write_bytes(text.encode().ljust(_BLOCK, b"\0") + data)


def forge(path: Path, change: Callable[[Any], object]) -> None:
    """Change an open file, and seal it."""
    with h5py.File(path, "r+", libver="v110") as file:
        change(file)
    seal(path)


def endless(path: Path) -> None:
    """Give the room that is left among an HDF5 file's texts no size: its library goes on for ever.

    The room is the entry of the "global heap" with the number 0, behind the texts.
    """
    data = bytearray(path.read_bytes())
    entry = data.index(b"GCOL") + 16
    while data[entry : entry + 2] != b"\0\0":
        size = int.from_bytes(data[entry + 8 : entry + 16], "little")
        entry += 16 + -(-size // 8) * 8
    data[entry + 8 : entry + 16] = bytes(8)
    path.write_bytes(data)


def replaced(name: str, **how: Any) -> Callable[[Any], object]:
    """A dataset of another kind under the name of one that is there."""

    def change(file: Any) -> None:
        del file[name]
        file.create_dataset(name, **how)

    return change


def _linked(name: str, link: Any) -> Callable[[Any], object]:
    def change(file: Any) -> None:
        del file[name]
        file[name] = link

    return change


def _virtual(file: Any) -> None:
    layout = h5py.VirtualLayout(shape=(1,), dtype="f8")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", shape=(1,))
    del file["values/time"]
    file.create_virtual_dataset("values/time", layout)


def _external(file: Any) -> None:
    del file["values/time"]
    file.create_dataset("values/time", (1,), "f8", external=[("/etc/hostname", 0, 8)])


def _same_again(file: Any) -> None:
    """One large array under many names: the file is small, the whole is not."""
    file["values/large"] = np.zeros(20_000)
    for k in range(50):
        file[f"values/large_{k}"] = file["values/large"]


def put(name: str, value: float) -> Callable[[Any], object]:
    """One number of an array is another."""

    def change(file: Any) -> None:
        data = file[name][()]
        data.flat[0] = value
        file[name][...] = data

    return change


#: Changes of a checkpoint of a motion with an event, and what is said of them.
FORGERIES: Mapping[str, tuple[Callable[[Any], object], str]] = {
    "no values": (lambda f: f.__delitem__("values"), 'it has no "values"'),
    "no rows": (lambda f: f.__delitem__("rows"), 'it has no "rows/'),
    "no time": (lambda f: f.__delitem__("values/time"), 'it has no "time"'),
    "no frames": (lambda f: f.__delitem__("rows/rigid_bodies/frames"), "rigid_bodies/frames"),
    "values are numbers": (
        lambda f: (f.__delitem__("values"), f.__setitem__("values", [1.0])),
        'it has no "values"',
    ),
    "time is a group": (
        lambda f: (f.__delitem__("values/time"), f.create_group("values/time")),
        'it has no "values/time"',
    ),
    "text": (replaced("values/time", data=[b"now"]), '"values/time" does not hold numbers'),
    "objects": (
        replaced("values/time", shape=(1,), dtype=h5py.string_dtype()),
        '"values/time" does not hold numbers',
    ),
    "complex": (replaced("values/time", data=[1j]), '"values/time" does not hold numbers'),
    "compound": (
        replaced("values/time", data=np.zeros(1, dtype=[("a", "f8")])),
        '"values/time" does not hold numbers',
    ),
    "long doubles": (
        replaced("values/time", data=np.zeros(1, dtype=np.longdouble)),
        '"values/time" does not hold numbers',
    ),
    "shape": (replaced("values/time", data=np.zeros(2)), r'"time" has the shape \(2,\), not \(1'),
    "scalar": (replaced("values/time", data=0.0), r'"time" has the shape \(\), not \(1,\)'),
    "rows of another shape": (
        replaced("rows/rigid_bodies/frames", data=np.zeros((2, 11))),
        r'"rigid_bodies/frames" has the shape',
    ),
    "fewer rows": (replaced("rows/rigid_bodies/frames", data=np.zeros((1, 12))), "has 1 rows, not"),
    "a row without rows": (replaced("rows/rigid_bodies/frames", data=0.0), "has 0 rows, not"),
    "rows without end": (
        replaced("rows/rigid_bodies/frames", shape=(2, 10**12), dtype="f8"),
        "claims numbers that are not in the file",
    ),
    "values without end": (
        replaced("values/time", shape=(10**15,), dtype="f8", chunks=(1024,)),
        "claims numbers that are not in the file",
    ),
    "filters": (
        lambda f: f.create_dataset("values/large", data=np.zeros(10**6), compression="gzip"),
        "claims numbers that are not in the file",
    ),
    "never written": (
        replaced("values/time", shape=(10**9,), dtype="f8"), "claims numbers that are not in"
    ),
    "many names": (_same_again, "claims numbers that are not in the file"),
    "link": (_linked("values/time", h5py.SoftLink("/values/counters")), 'has no "values/time"'),
    "link to itself": (_linked("values", h5py.SoftLink("/values")), 'has no "values"'),
    "link to a file": (
        _linked("values/time", h5py.ExternalLink("/etc/hostname", "/x")),
        'it has no "values/time"',
    ),
    "virtual": (_virtual, "claims numbers that are not in the file"),
    "external": (_external, "claims numbers that are not in the file"),
    "time is no number": (put("values/time", np.nan), '"time" must be finite'),
    "time without end": (put("values/time", np.inf), '"time" must be finite'),
    "time is negative": (put("values/time", -1.0), "is at t = -1 s, which is not that of its step"),
    "another time": (put("values/time", 7.0), "is at t = 7 s, which is not that of its step"),
    "frames are none": (
        put("rows/rigid_bodies/frames", np.nan), '"rigid_bodies/frames" must be finite'
    ),
    "rotations are none": (
        lambda f: f["rows/rigid_bodies/frames"].__setitem__(
            (slice(None), slice(3, 12)), 2.0 * np.eye(3).ravel()
        ),
        "contains a matrix that is not a rotation",
    ),
    "negative counts": (put("values/counters", -1.0), '"counters" must hold whole numbers that'),
    "half a count": (put("values/steps", 0.5), '"steps" must hold whole numbers'),
    "too many halvings": (put("values/control", 40.0), "a step was halved 40 times"),
    "no such prediction": (put("values/prediction", 77.0), "77 is not a valid Prediction"),
    "no such event": (replaced("values/fired", data=[[9.0, 0.1]]), "list index out of range"),
    "a negative event": (replaced("values/fired", data=[[-1.0, 0.1]]), '"fired" must hold whole'),
    "events of another shape": (replaced("values/fired", data=np.zeros((1, 3))), '"fired" has'),
    "no history": (lambda f: f.__delitem__("values/history"), "the last time"),
    "history of another shape": (
        replaced("values/history", data=np.zeros(2)), "the last time and"
    ),
    "sums of another shape": (replaced("values/sums", data=np.zeros(3)), '"sums" does not hold 7'),
}  # fmt: skip

_GRID = "its header has the grid"
#: Changes of the header, and what is said of them.
HEADERS: Mapping[str, tuple[Any, str]] = {
    "text": ("x", "Expecting value"),
    "numbers": ("[1, 2]", "its header is no object of JSON"),
    "not JSON": ("{", "Expecting property name"),
    "deep": ("[" * 200_000, "its header is no object of JSON"),
    "nan": ('{"step": NaN}', "its header has the number NaN"),
    "empty": ("{}", "its header has no flexfem"),
    "long number": ('{"step": ' + "9" * 5000 + "}", "digits"),
    "no text": (np.arange(3), 'its attribute "header" is no text'),
    "version is a list": ({"flexfem": []}, "its header has no flexfem"),
    "version is long": ({"flexfem": "9" * 10**4}, "was written by flexfem 99"),
    "model is a list": ({"model": []}, "its header has no model"),
    "options are none": ({"options": None}, "its header has no options"),
    "options of other kinds": ({"options": {"dt": [0.1]}}, "was written with dt = "),
    "negative step": ({"step": -3}, "its header has the step -3"),
    "huge step": ({"step": 10**30}, "its header has the step 1000"),
    "step is true": ({"step": True}, "its header has no step"),
    "step is a text": ({"step": "3"}, "its header has no step"),
    "step is a fraction": ({"step": 2.5}, "its header has no step"),
    "other step": ({"step": 1}, "which is not that of its step 1"),
    "grid is short": ({"grid": [1.0]}, _GRID),
    "grid is a text": ({"grid": "ab"}, "its header has no grid"),
    "grid of texts": ({"grid": ["a", "b"]}, _GRID),
    "grid without steps": ({"grid": [1.0, 0]}, _GRID),
    "grid that goes back": ({"grid": [-1.0, 10]}, _GRID),
    "grid of true": ({"grid": [1.0, True]}, _GRID),
    "grid without end": ({"grid": [10**400, 10]}, _GRID),
    "fine grid": ({"grid": [1.0, 10**12]}, _GRID),
}  # fmt: skip


def with_header(change: Any) -> Callable[[Any], object]:
    """Entries of the header are others, or all of it."""

    def apply(file: Any) -> None:
        if isinstance(change, dict):
            header = json.loads(file.attrs["header"]) | change
            file.attrs["header"] = json.dumps(header)
        else:
            file.attrs["header"] = change

    return apply
