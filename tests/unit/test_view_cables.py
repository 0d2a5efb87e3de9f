# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables on pages of results: places, tensions and names are those of the files."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.scene_file import SceneFile
from flexfem.io.view.content import gather
from flexfem.io.view.layers import CableLayer, joined
from flexfem.io.view.packing import Pack
from flexfem.io.view.reading import Choice
from flexfem.io.vtu.reader import Grid
from tests.browser import Browser, chromium
from tests.unit.swing import EVIL, hoist
from tests.unit.unpacked import Unpacked, files

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results of ten steps."""
    folder = tmp_path_factory.mktemp("cables") / "hoist"
    options = ff.RunOptions(dt=0.02, t_end=0.2, every=1, quiet=True, output=folder)
    assert ff.simulate(hoist(), options).status == "ok"
    return folder


def test_cables_are_those_of_the_files(results: Path) -> None:
    found = Unpacked(gather(results, Choice()))
    layer = found.layers["cables"]
    assert (layer["kind"], layer["names"], layer["kinds"]) == (
        "lines", [EVIL, "stay"], ["Cable", "Cable"]
    )  # fmt: skip
    grids = list(files(results, "cables"))
    places, tension = found.places(layer["motion"]), found.field("cables", "tension")
    assert len(grids) == len(places) == len(tension) == 11
    assert [field["unit"] for field in layer["fields"]] == ["N"]
    np.testing.assert_array_equal(found.array(layer["cells"]), grids[0].cells)
    np.testing.assert_array_equal(found.array(layer["bodies"]), grids[0].cell_data["joint"])
    for x, force, grid in zip(places, tension, grids, strict=True):
        # half a step of 16 bits over 1.6 m; another instant is off by up to 0.04 m
        np.testing.assert_allclose(x, grid.points, atol=2e-5)
        # half a step over 30 N; the other part of the cable pulls with 1.4 times as much
        np.testing.assert_allclose(force, grid.cell_data["tension"], atol=1e-3)
    assert np.ptp(places, axis=0).max() > 0.05  # it moves


def test_cables_of_another_order_are_put_in_order(results: Path) -> None:
    """A run that goes on with other ranks may write the second cable first."""
    grids = list(files(results, "cables"))
    layer = CableLayer("cables", SceneFile.of(results), ["tension"], grids[0])
    pack = Pack()
    layer.add(grids[0])
    layer.add(joined([_part(grids[5], 1), _part(grids[5], 0)]))
    (data,) = layer.store(pack)
    motion, half = data["motion"], data["motion"]["half"]
    empty = type("Empty", (), {"scene": {"layers": [data]}, "data": pack.data})()
    found = Unpacked(empty).places(motion)
    # cables that are exchanged are off by 0.2 m and more
    np.testing.assert_allclose(found[1], grids[5].points, atol=half / 32767)


def _part(grid: Grid, number: int) -> Grid:
    """One of the cables alone."""
    cells = np.flatnonzero(grid.cell_data["joint"] == number)
    points = np.unique(grid.cells[cells])
    return replace(
        grid, points=grid.points[points], cells=np.searchsorted(points, grid.cells[cells]),
        point_data={name: values[points] for name, values in grid.point_data.items()},
        cell_data={name: values[cells] for name, values in grid.cell_data.items()},
    )  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as opened:
        yield opened


@pytest.mark.skipif(chromium() is None, reason="no Chromium on PATH, and none in CHROMIUM")
def test_a_click_on_a_cable_tells_its_name_and_tension(results: Path, browser: Browser) -> None:
    """The layer can be switched, has colours with a legend, and its lines are found by clicks."""
    assert cli.command(["view", str(results)]) == 0
    browser.open(results / "view.html", "#t=0.2")
    assert "cables" in browser.ask("document.getElementById('layers').textContent")
    assert browser.ask("flexfem.colours.field") == "tension"  # bodies have no colours
    legend = browser.ask("document.getElementById('legend-title').textContent")
    assert legend == "cable tension, N"
    *_, last = files(results, "cables")
    ends = browser.ask(
        "(() => { const { startValue, endValue } ="
        " flexfem.layers.find((one) => one.series === 'cables').mesh.geometry.attributes;"
        " return [[...startValue.array], [...endValue.array]]; })()"
    )
    # colours are constant along straight parts, up to the sheave; means with the other side there
    # are off by a sixth
    np.testing.assert_allclose(ends, [last.cell_data["tension"]] * 2, rtol=1e-3)
    middle = last.points[last.cells[0]].mean(axis=0).tolist()
    card = browser.ask(
        "(() => { const p = flexfem;"
        f" const at = {middle}.map((x, c) => x - p.origin[c]); p.draw();"
        " p.pick(...p.stage.project(at)); p.draw();"
        " return [...document.getElementById('card').children].map((one) => one.textContent); })()"
    )
    shown = dict(zip(card[::2], card[1::2], strict=True))
    assert shown["Cable"] == EVIL  # as text
    tension = float(last.cell_data["tension"][0])
    # four digits; the other part pulls with 1.4 times as much
    assert float(shown["cable tension"].removesuffix(" N")) == pytest.approx(tension, rel=1e-3)
    assert browser.ask("window.caught") is None
    assert not browser.errors
