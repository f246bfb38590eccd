"""``kiteocp new NAME --columns``: a map with every quantity, which loads as it is and with everything in use."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from kiteocp.cli.main import main
from kiteocp.recording.columns import ColumnMap, load_columns

NOT_QUANTITIES = {"name", "description", "source", "downwind_bearing_deg"}
QUANTITIES = {item.name: item.required for item in msgspec.structs.fields(ColumnMap) if item.name not in NOT_QUANTITIES}


@pytest.fixture
def template(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine", "--columns"]) == 0
    return tmp_path / "mine.yaml"


def test_it_loads_with_what_is_needed(template: Path) -> None:
    layout = load_columns(template)
    assert {name for name in QUANTITIES if getattr(layout, name) is not None} == {
        name for name, needed in QUANTITIES.items() if needed
    }


def test_it_loads_with_every_quantity_in_use(template: Path) -> None:
    text = re.sub(rf"^# ({'|'.join(QUANTITIES)}): ", r"\1: ", template.read_text(), flags=re.MULTILINE)
    template.write_text(text)
    layout = load_columns(template)
    assert all(getattr(layout, name) is not None for name in QUANTITIES)


def test_its_table_lists_every_quantity_with_its_units(template: Path) -> None:
    rows = dict(re.findall(r"^# (\w+) +(.*)$", template.read_text(), flags=re.MULTILINE))
    assert set(QUANTITIES) <= set(rows)
    assert "kgf" in rows["tether_force"]
    assert rows["tether_force"].startswith("yes")


def test_a_map_that_is_there_is_not_overwritten(template: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["new", "mine", "--columns"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["new", "no good", "--columns"]) == 2
    assert "cannot name a column map" in capsys.readouterr().err
