# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of users are opened with care: what is no plain text of some size is refused at once."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import flexfem as ff
from flexfem._files import number_in, read_bytes, read_text
from flexfem.io import read_history, read_summary
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

#: Functions that make a file of a name, and the message about it.
FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "pipe": (os.mkfifo, "is not a regular file but a pipe or a device"),
    "device": (lambda p: p.symlink_to("/dev/zero"), "is not a regular file but a pipe or a device"),
    "folder": (lambda p: p.mkdir(), "Is a directory"),
    "missing": (lambda p: None, "No such file or directory"),
    "circle": (lambda p: p.symlink_to(p), "Too many levels of symbolic links"),
    # a file with a hole: no room on the disk is needed
    "large": (lambda p: _truncate(p, 10**12), "it has 1000000000000 bytes, at most 16000000 are"),
    # the system says that these have no bytes, and then they do
    "endless": (lambda p: p.symlink_to("/proc/self/mem"), "Input/output error"),
    "Latin-1": (lambda p: p.write_bytes(b"name,E\nst\xe4hl,1\n"), "line 2 is not UTF-8, .* 0xe4"),
    "UTF-16": (lambda p: p.write_bytes("name,E\n".encode("utf-16")), "it is in UTF-16; save it"),
    "NUL": (lambda p: p.write_bytes(b"name,E\na,\0"), "line 2 has a NUL byte, it is not a text"),
}
#: Messages of the reader of XML itself.
XML = {"Latin-1": "no well-formed", "UTF-16": "no element found|well-formed", "NUL": "well-formed"}


def _truncate(path: Path, size: int) -> None:
    path.touch()
    os.truncate(path, size)


@pytest.mark.parametrize("kind", FILES)
def test_files_that_are_no_texts(kind: str, tmp_path: Path) -> None:
    make, reason = FILES[kind]
    path = tmp_path / "table.csv"
    make(path)
    with pytest.raises(ValueError, match=rf'^table ".*" cannot be read: {reason}') as caught:
        ff.read_materials(path)
    assert_on_page(str(caught.value))
    with pytest.raises(ValueError, match=rf'^".*table.csv".*({XML.get(kind, reason)})') as told:
        ff.read_urdf(path)
    assert "\n" not in f"{caught.value}{told.value}"


def test_a_nul_in_the_name() -> None:
    with pytest.raises(ValueError, match=r"^table: embedded null"):
        read_bytes("table", "a\0b", 10)


def test_the_mark_at_the_beginning_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "t").write_bytes(b"\xef\xbb\xbfname")
    assert read_text("t", tmp_path / "t", 7) == "name"
    with pytest.raises(ValueError, match="t: it has 7 bytes, at most 6 are read"):
        read_text("t", tmp_path / "t", 6)


@pytest.mark.parametrize("text", ["1", "-1.", "+.5", "1e3", "1.5E-03", " 7 ", "0"])
def test_numbers(text: str) -> None:
    assert number_in(text) == float(text)


@pytest.mark.parametrize(
    "text", ["", ".", "1_0", "0x10", "1,5", "٣", "1e", "1d3", "--1", "1 2", "e5", "1" * 6000 + "x"]
)
def test_what_is_no_number(text: str) -> None:
    """Of these Python's own float() takes 1_0 for 10 and the Arabic digit for 3."""
    with pytest.raises(ValueError, match=r"^must be a number, got") as caught:
        number_in(text)
    assert len(str(caught.value)) < 100


@pytest.mark.parametrize("text", ["nan", "-inf", "Infinity", "1e400", "9" * 400])
def test_numbers_without_end(text: str) -> None:
    with pytest.raises(ValueError, match=r"^must be finite, got"):
        number_in(text)


HEAD = "name,E,nu,rho\n"
#: Fields that are no numbers or too long, and what is said of them.
TABLES = {
    "a,1_0,0.3,7850": "line 2 \"a\": E must be a number, got '1_0'",
    "a,1e400,0.3,7850": 'line 2 "a": E must be finite',
    "a,2e11,nan,7850": 'line 2 "a": nu must be finite',
    'a,"2,1e11",0.3,7850': 'line 2 "a": E must be a number',
    f"a,{'1' * 200_000},0.3,7850": "line 2: more than 10000 characters",
    f'a,"{"x" * 9000}",0.3,7850': 'line 2 "a": E must be a number',
    '"a': 'line 2 "a": E is missing',
}


@pytest.mark.parametrize("row", TABLES, ids=range(len(TABLES)))
def test_fields_of_tables(row: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(HEAD + row + "\n")
    with pytest.raises(ValueError, match=TABLES[row]) as caught:
        ff.read_materials(tmp_path / "t.csv")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
    assert_on_page(str(caught.value))


LINK = '<link name="a"/>'
#: Attacks by XML, and the message about each.
ROBOTS = {
    "laughs": (
        '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><robot name="r">&b;</robot>',
        "line 1: declarations of entities are not read",
    ),
    "attributes": (
        f'<!DOCTYPE r [<!ATTLIST link x CDATA "1">]><robot name="r">{LINK}</robot>',
        "line 1: declarations of entities are not read",
    ),
    "external": (
        '<!DOCTYPE r SYSTEM "file:///etc/hostname"><robot name="&x;"/>',
        "<robot> has no <link>|undefined entity",
    ),
    "deep": ("<a>" * 200_000, "line 1: more than 100000 elements, or 64 within one another"),
    "many": ('<robot name="r">' + "<b/>" * 100_001, "line 1: more than 100000 elements"),
    "long": (f'<robot name="{"r" * 20_000}"/>', "line 1: a name or value has more than 10000"),
    "encoding": ('<?xml version="1.0" encoding="foo"?><robot/>', "unknown encoding: foo"),
    "wide": ('<?xml version="1.0" encoding="utf-7"?><robot/>', "multi-byte encodings"),
    "message": (f'<robot name="r" {"n" * 900}="{"m" * 900}"><link/></robot>', "has no name"),
    "underscore": (
        f'<robot name="r">{LINK}<link name="b"><inertial><mass value="1_0"/></inertial></link>'
        "</robot>",
        'link "b": <inertial> has no <inertia>|value must hold one number, got "1_0"',
    ),
}


@pytest.mark.parametrize("kind", ROBOTS)
def test_robots_that_are_traps(kind: str, tmp_path: Path) -> None:
    text, reason = ROBOTS[kind]
    (tmp_path / "r.urdf").write_text(text)
    with pytest.raises(ValueError, match=reason) as caught:
        ff.read_urdf(tmp_path / "r.urdf")
    assert str(caught.value).startswith(f'"{tmp_path}/r.urdf"')
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) <= 500


def test_robots_in_other_encodings(tmp_path: Path) -> None:
    """The encoding in the first line is used."""
    text = '<?xml version="1.0" encoding="{}"?><robot name="Träger"><link name="a"/></robot>'
    for encoding in ("utf-8", "iso-8859-1", "windows-1252", "utf-16"):
        (tmp_path / "r.urdf").write_bytes(text.format(encoding).encode(encoding))
        assert ff.read_urdf(tmp_path / "r.urdf").name == "Träger"


def test_many_joints_that_follow_each_other(tmp_path: Path) -> None:
    """Two thousand in a row: a walk from each of them to the first would take minutes."""
    limit = '<limit lower="-1" upper="1"/>'
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>{limit}'
        f'<mimic joint="j{k - 1 if k else 2000}"/></joint>'
        for k in range(2001)
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(2002))
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    with pytest.raises(ValueError, match='joint "j0" follows itself'):
        ff.read_urdf(tmp_path / "r.urdf")


def test_files_whose_size_the_system_does_not_know() -> None:
    """Those of /proc have no bytes until they are read."""
    path = Path("/proc/self/status")
    if path.exists():
        assert read_text("status", path, 10**6).startswith("Name:")
        with pytest.raises(ValueError, match="at most 5 are read"):
            read_bytes("status", path, 5)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 50_000, "no object of JSON"),
        ("9" * 5000, "digits"),
        ("[1]", "no object of JSON"),
        ("{", "Expecting"),
    ],
)
def test_summaries_that_are_none(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^summary '.*summary.json': .*{reason}"):
        read_summary(path)


def test_results_that_are_pipes(tmp_path: Path) -> None:
    for name in ("summary.json", "history.csv"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(ValueError, match=r"^summary '.*': is not a regular file"):
        read_summary(tmp_path / "summary.json")
    with pytest.raises(ValueError, match=r"^history '.*': is not a regular file"):
        read_history(tmp_path / "history.csv")


def test_numbers_that_no_one_means() -> None:
    """Their products would overflow, in silence or with a warning of NumPy."""
    assert number_in("1e60") == 1e60
    with pytest.raises(ValueError, match=r"^must not exceed 1e\+60, got '-1e308'"):
        number_in("-1e308")


def test_tables_of_empty_lines(tmp_path: Path) -> None:
    (tmp_path / "history.csv").write_text("t,x\n\n0.0")
    with pytest.raises(ValueError, match=r"^history '.*': its lines are empty"):
        read_history(tmp_path / "history.csv")


@pytest.mark.parametrize("name", ["a" * 5000, "pipe", "../../etc", "package://../../etc/x"])
def test_pictures_of_robots_that_are_none(name: str, tmp_path: Path) -> None:
    """Names that no system takes, and pipes, which would be waited for."""
    os.mkfifo(tmp_path / "pipe.stl")
    moments = 'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><inertial><mass value="1"/><inertia {moments}/></inertial>'
        f'<visual><geometry><mesh filename="{name}.stl"/></geometry></visual></link></robot>'
    )
    with pytest.raises(ValueError, match=r'link "a": <mesh> (filename|package) "') as told:
        ff.read_urdf(tmp_path / "r.urdf", base="free")
    assert len(str(told.value)) <= 500
