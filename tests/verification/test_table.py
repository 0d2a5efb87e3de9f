# SPDX-License-Identifier: LGPL-3.0-or-later
"""The written table: a part for each module, and the number of its values in all texts."""

from pathlib import Path

import pytest

from tests.verification import table

pytestmark = pytest.mark.serial

ROW = "| case | x | 1 | closed form | 2 | 1.0e+00{} | 1e-03 | 2 elements |"


def test_every_module_has_its_part() -> None:
    parts = table.written(table.TABLE.read_text(encoding="utf-8"))
    lacking = sorted(set(table.modules()) - {name for name, rows in parts.items() if rows})
    assert not lacking, "make them by: python -m tests.verification.table --missing"
    assert set(parts) == set(table.modules())


def test_numbers_of_values_are_those_of_the_table() -> None:
    text = table.TABLE.read_text(encoding="utf-8")
    parts = table.written(text)
    assert table.summary(parts) in text
    for path in table.TOLD:
        assert int(table.told(path)[0]) == sum(map(len, parts.values())), path


def test_one_part_is_computed_anew_and_the_rest_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    guide = tmp_path / "guide.md"
    guide.write_text("it has 7 rows", encoding="utf-8")
    monkeypatch.setattr(table, "TABLE", tmp_path / "TABLE.md")
    monkeypatch.setattr(table, "TOLD", {guide: ("has ", " rows")})
    old, bad = ROW.format(""), ROW.format(table._MISSED)
    table.write({"rigid_pendulum": [old], "rigid_drive": [old], "static_beams": [old, old]})
    monkeypatch.setattr(table, "rows", lambda name: [bad, old])
    assert table.main(["--only", "rigid_drive"]) == 1
    parts = table.written(table.TABLE.read_text(encoding="utf-8"))
    assert list(parts) == ["rigid_drive", "rigid_pendulum", "static_beams"]
    assert parts["rigid_drive"] == [bad, old]
    assert parts["rigid_pendulum"] == [old]
    assert guide.read_text(encoding="utf-8") == "it has 5 rows"
    assert "5 values, 1 missed." in capsys.readouterr().out
    with pytest.raises(SystemExit):
        table.main(["--only", "rigid"])
