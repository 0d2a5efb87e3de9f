# SPDX-License-Identifier: LGPL-3.0-or-later
"""The server of pages of runs that go on: who is answered, and what it costs the run.

What browsers make of it is tested in ``test_view_browser``.
"""

from http.client import HTTPConnection
from pathlib import Path
from threading import Thread

import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.view import live
from flexfem.io.view.reading import Choice
from tests.unit.refusals import assert_on_page
from tests.unit.swing import mechanism

pytestmark = pytest.mark.serial


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    options = ff.RunOptions(dt=0.02, t_end=0.1, every=1, quiet=True, output=tmp_path / "swing")
    assert ff.simulate(mechanism(), options).status == "ok"
    return tmp_path / "swing"


def test_server_answers_its_own_pages_only(folder: Path) -> None:
    """Not without the key, not for other hosts, and no files."""
    served, address = live.server(live.Watched(folder, Choice()), 0)
    Thread(target=served.serve_forever, daemon=True).start()
    host = served.server_address
    key = address.rstrip("/").rpartition("/")[2]
    with served:
        assert host[0] == "127.0.0.1"
        for path, name, status in (
            (f"/{key}/state", "localhost:80", 200), (f"/{key}/state", "evil.example:80", 404),
            ("/", "localhost", 404), (f"/{key}/../history.csv", "localhost", 404),
            (f"/{key}/history.csv", "localhost", 404),
        ):  # fmt: skip
            connection = HTTPConnection("127.0.0.1", int(host[1]), timeout=10)
            connection.request("GET", path, headers={"Host": name})
            assert connection.getresponse().status == status, (path, name)
            connection.close()
        served.shutdown()


@pytest.mark.parametrize("share", [1e-9, 1e9])
def test_reading_takes_a_small_share(
    share: float, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A later state is read when the time of the last reading is this share of what has passed."""
    monkeypatch.setattr(live, "_SHARE", share)
    watched = live.Watched(folder, Choice())
    watched.refresh()
    assert watched.version == 1  # nothing has changed
    (folder / "history.csv").write_text((folder / "history.csv").read_text() * 1)
    watched.refresh()
    assert watched.version == (1 if share < 1.0 else 2)


def test_a_new_run_in_the_folder_does_no_harm(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While its files are not whole, the last state stays."""
    monkeypatch.setattr(live, "_SHARE", 1e9)
    watched = live.Watched(folder, Choice())
    for path in folder.glob("*.pvd"):
        path.unlink()
    watched.refresh()
    assert watched.version == 1
    assert watched.content.scene["version"] == 1


WRONG = {
    "--live --gltf": "argument --live: takes one RESULTS_DIR, no --gltf and no --gallery",
    "--live --port 70000": "argument --port: must be from 0 to 65535, got 70000",
}


@pytest.mark.parametrize("options", WRONG)
def test_wrong_options_are_refused(
    options: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["view", str(folder), *options.split()]) == 2
    text = capsys.readouterr().err
    assert WRONG[options] in text
    assert_on_page(text.removeprefix("error: ").rstrip())
