# SPDX-License-Identifier: LGPL-3.0-or-later
"""The guide's page on errors: what it names is what the package says; failures are provoked here.

The tests of wrong input look their messages up on the page as well (see ``refusals``).
"""

import ast
from functools import cache
from typing import Any

import pytest

import flexfem as ff
from tests.unit.refusals import PAGE, assert_on_page, rows_of_page

pytestmark = pytest.mark.serial

#: First words of the command line, and messages of Python and the system.
FOREIGN = {
    "error: …", "failed: …", "interrupted …", "argument …: …", "unrecognized arguments: …",
    "[Errno …] …", "'…', line …: …", '"…": …',
}  # fmt: skip


@cache
def texts() -> str:
    """All strings of the package, with "…" for what is put into them."""
    found = []
    for path in sorted(PAGE.parents[2].rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else "…" for p in node.values]
                found.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return "\n".join(found)


@pytest.mark.parametrize("row", [row for row in rows_of_page() if row not in FOREIGN])
def test_rows_are_messages_of_the_package(row: str) -> None:
    """The longest piece without anything variable is in one string of the package."""
    piece = max(row.split("…"), key=len).strip(" :;'\",(")
    assert piece in texts()


def test_table_is_one() -> None:
    """Every row has a message, a reason and a remedy, and no message occurs twice."""
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:3] == "| `"]
    assert all(line.count(" | ") == 2 for line in rows)
    assert len(set(rows_of_page())) == len(rows)


NAN = float("nan")

# --- failures ------------------------------------------------------------------------------------


def bob(*more: Any, **start: Any) -> ff.Model:
    """A body on a pin."""
    model = ff.Model("m")
    arm = ff.Marker("bob", offset=(-1.0, 0.0, 0.0))
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0), **start),
        ff.Spherical("pin", ff.Ground(), arm),
        ff.PositionProbe("path", ff.Marker("bob")),
        *more,
    )
    return model


def drive(motion: Any) -> ff.PrescribedTranslation:
    """The body's centre is moved along z."""
    there, axis = ff.Ground((1.0, 0.0, 0.0)), (0.0, 0.0, 1.0)
    return ff.PrescribedTranslation("drive", there, ff.Marker("bob"), motion, axis=axis)


def moved(model: ff.Model, **options: Any) -> str:
    return ff.simulate(model, ff.RunOptions(**{"dt": 1e-2, "t_end": 0.1} | options)).status


def relaxed() -> str:
    options = ff.RelaxationOptions(max_iterations=20, record_every=20)
    return ff.relax(bob(ff.Gravity((0.0, 0.0, -9.81))), options).status


def pushed(after: float) -> ff.PointForce:
    """A force that is something else from 0.055 s on."""
    amplitude = lambda t: after if t > 0.055 else 0.0  # noqa: E731
    return ff.PointForce("push", ff.Marker("bob"), (0.0, 0.0, 1.0), amplitude=amplitude)


def watched() -> ff.Event:
    """An event whose function becomes nan."""
    return ff.Event("e", ff.Marker("bob"), lambda t, at: NAN if t > 0.05 else 1.0, ff.Stop())


FAILURES = {
    "out of reach": lambda: moved(bob(drive(lambda t: 50.0 * t))),
    "drive": lambda: moved(bob(drive(lambda t: NAN if t > 0.055 else 0.0))),
    "jump": lambda: moved(bob(pushed(1e9)), adaptive=True, error_tolerance=1e-9),
    "event": lambda: moved(bob(watched())),
    "relaxation": relaxed,
}


@pytest.mark.parametrize("kind", FAILURES)
def test_failures_are_on_the_page(kind: str) -> None:
    status = FAILURES[kind]()
    assert status != "ok"
    assert "\n" not in status
    assert_on_page(status)


def test_a_load_without_end_is_on_the_page() -> None:
    with pytest.raises(ff.FunctionError) as raised:
        moved(bob(pushed(float("inf"))))
    assert_on_page(str(raised.value))


def test_a_failure_says_where_and_what_to_try() -> None:
    """The body that cannot follow is named, not the one at rest; advice ends the line."""
    model = bob(drive(lambda t: 50.0 * t))
    model.add(ff.RigidBody("idle", 1.0, (0.1, 0.1, 0.1), position=(9.0, 0.0, 0.0)))
    status = moved(model)
    assert '(largest Newton increment: RigidBody "bob" at (' in status
    assert status.split("; ")[-1].startswith("reduce dt")
