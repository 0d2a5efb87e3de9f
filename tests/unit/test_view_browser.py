# SPDX-License-Identifier: LGPL-3.0-or-later
"""The page of a result folder in a real browser without a window and without a network.

Needs Chromium (Debian: ``apt-get install chromium``; ``CHROMIUM`` names another place).
"""

import base64
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.view import live
from flexfem.io.view.reading import Choice
from flexfem.io.vtu.reader import read_index, read_pieces
from tests.browser import Browser, chromium
from tests.unit.swing import EVIL, EVIL_COLUMN, mechanism

pytestmark = [
    pytest.mark.serial,
    pytest.mark.skipif(chromium() is None, reason="no Chromium on PATH, and none in CHROMIUM"),
]

#: Seconds within which a page of little content opens on any machine that runs the tests: the aim
#: is 2 s on an idle one, and a page that waits for a network or for ever does not open at all.
PATIENCE = 30.0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page") / "swing"
    options = ff.RunOptions(dt=0.02, t_end=0.4, every=1, quiet=True, output=folder)
    assert ff.simulate(mechanism(), options).status == "ok"
    assert cli.command(["view", str(folder)]) == 0
    return folder / "view.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as opened:
        yield opened


def pixels(browser: Browser) -> np.ndarray:
    """What the canvas shows (height, width, 4) after it is drawn."""
    text = browser.ask(
        "(() => { const p = flexfem; p.changed(); p.draw();"
        " const gl = p.stage.renderer.getContext();"
        " const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];"
        " const out = new Uint8Array(4 * w * h);"
        " gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, out);"
        " let text = `${w},${h},`; for (let k = 0; k < out.length; k += 8192)"
        " text += String.fromCharCode(...out.subarray(k, k + 8192)); return btoa(text); })()"
    )
    width, height, data = base64.b64decode(text).split(b",", 2)
    return np.frombuffer(data, np.uint8).reshape(int(height), int(width), 4)


def test_page_opens_and_shows_the_motion(page: Path, browser: Browser) -> None:
    """Pictures at three times differ where the rod is; nothing is asked of the network."""
    seconds = browser.open(page, "#t=0.1")
    assert seconds < PATIENCE
    assert browser.ask("flexfem.timeline.now") == pytest.approx(0.1)
    pictures = []
    for now in (0.0, 0.2, 0.4):
        browser.ask(f"flexfem.timeline.go({now})")
        pictures.append(pixels(browser))
    for one, other in ((0, 1), (1, 2), (0, 2)):
        changed = np.any(pictures[one] != pictures[other], axis=2)
        # the rod and its box cover some thousand pixels; a frozen picture changes none, a lost
        # context or a wrong camera all or none
        assert 500 < changed.sum() < 0.5 * changed.size
    assert not browser.errors
    assert all(url.startswith(("file:", "blob:")) for url in browser.requests)


def test_places_are_those_of_the_history(page: Path, browser: Browser) -> None:
    """A click on the box tells its name, and where it is, as the probe in the table does."""
    browser.open(page, "#t=0.2")
    path = np.genfromtxt(page.parent / "history.csv", delimiter=",", names=True, deletechars="")
    row = path[np.argmin(np.abs(path["t"] - 0.2))]
    place = [float(row[name]) for name in path.dtype.names[1:4]]
    browser.ask(
        "document.querySelectorAll('#layers label').forEach((label) => {"
        " if (!label.textContent.includes('rigid') && label.firstChild.checked) label.click(); })"
    )
    found = browser.ask(
        f"(() => {{ const p = flexfem; const at = {place}.map((x, c) => x - p.origin[c]);"
        " p.draw(); const [x, y] = p.stage.project(at); const hit = p.pick(x, y); p.draw();"
        " return [hit?.layer.name(hit.cell).name, ...hit.point.map((x, c) => x + p.origin[c]),"
        " document.getElementById('card').textContent]; })()"
    )
    assert found[0] == EVIL
    assert EVIL in found[4]  # as text
    # the box of this inertia is 0.2 m large at most: its surface is close to its middle
    assert np.linalg.norm(np.subtract(found[1:4], place)) < 0.2
    assert browser.ask("window.caught") is None


def test_names_are_text(page: Path, browser: Browser) -> None:
    """Names that are code elsewhere are shown as they are, and do nothing."""
    browser.open(page)
    time.sleep(0.2)
    assert browser.ask("window.caught") is None
    assert browser.ask("document.images.length") == 0
    assert EVIL_COLUMN in browser.ask("document.getElementById('plots').textContent")
    assert not browser.errors


def test_colours_follow_the_field(page: Path, browser: Browser) -> None:
    """Another field has other colours and another legend; one per element differs from smooth."""
    browser.open(page, "#t=0.3&field=von_mises")
    first = pixels(browser)
    assert browser.ask("document.getElementById('legend-title').textContent").startswith(
        "von Mises"
    )
    browser.ask("flexfem.colours.choose('velocity')")
    second = pixels(browser)
    assert np.any(first != second)
    assert "m/s" in browser.ask("document.getElementById('legend-title').textContent")
    browser.ask("flexfem.colours.choose('M2'); document.getElementById('elements').click()")
    third = pixels(browser)
    browser.ask("document.getElementById('elements').click()")
    assert np.any(third != pixels(browser))
    assert not browser.errors


def test_values_are_those_of_the_files(page: Path, browser: Browser) -> None:
    """The stress at a vertex of the page is one that the run wrote for its element."""
    browser.open(page)
    instants = read_index(page.parent / "beam_surfaces.pvd", "beam_surfaces")
    (grid,) = read_pieces(instants[10].file)
    found = browser.ask(
        "(() => { const v = flexfem.layers.find((one) => one.series === 'beams' && one.data.stress"
        " && one.values.stress).values; const out = [];"
        " for (let k = 0; k < v.vertices.cells.length; k++) out.push(v.at('von_mises', 10, k));"
        " return Math.max(...out); })()"
    )
    # 16 bits of each resultant; a wrong factor or element is wrong by the whole stress
    assert found == pytest.approx(float(grid.point_data["von_mises"].max()), rel=1e-3)


def test_dark_and_light(page: Path, browser: Browser) -> None:
    browser.open(page)
    light = pixels(browser)
    browser.ask("document.getElementById('theme').click()")
    dark = pixels(browser)
    assert light[:8, :8, :3].mean() > 200 > 60 > dark[:8, :8, :3].mean()
    assert not browser.errors


def wait(browser: Browser, expression: str) -> None:
    """Wait until an expression is true."""
    end = time.monotonic() + PATIENCE
    while not browser.ask(expression):
        assert time.monotonic() < end, browser.errors
        time.sleep(0.05)


def test_page_of_a_run_that_goes_on(
    page: Path, browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More instants appear; who looks at the last one goes on, with the colours chosen before."""
    monkeypatch.setattr(live, "_SHARE", 1.0)  # it need not wait here
    folder = Path(shutil.copytree(page.parent, tmp_path / "run"))
    (folder / "summary.json").unlink()
    whole = {path: path.read_text() for path in folder.glob("*.pvd")}
    for path, text in whole.items():
        lines = text.splitlines(keepends=True)
        path.write_text("".join([*lines[:9], *lines[-2:]]))  # six instants
    served, address = live.server(live.Watched(folder, Choice()), 0)
    Thread(target=served.serve_forever, daemon=True).start()
    with served:
        browser.open(address)
        assert browser.ask("flexfem.timeline.times.length") == 6
        assert browser.ask("document.getElementById('status').textContent") == "running"
        browser.ask("flexfem.colours.choose('M2'); flexfem.timeline.go(9)")
        before = pixels(browser)
        for path, text in whole.items():
            path.write_text(text)
        wait(browser, "flexfem.timeline.times.length === 21")
        assert browser.ask("flexfem.timeline.now") == pytest.approx(0.4)
        assert browser.ask("flexfem.colours.field") == "M2"
        assert np.any(before != pixels(browser))
        assert not browser.errors
        served.shutdown()


def test_the_stress_of_beams_is_shown_at_first(page: Path, browser: Browser) -> None:
    """Lines in the middle of beams, which have no stresses, do not stand against it."""
    browser.open(page)
    assert browser.ask("flexfem.colours.field") == "von_mises"
