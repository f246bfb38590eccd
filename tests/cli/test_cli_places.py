"""Where results go: none of other input is replaced without a word, and nothing stale stays beside new numbers."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from kiteocp.cli.main import main
from kiteocp.problem import shipped_problems
from kiteocp.result.earlier import files_of

SIMULATE = ["simulate", "strong-wind", "--no-plot"]
WIND = "environment.wind.reference_speed_m_s"


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def folders() -> list[str]:
    return sorted(path.parent.relative_to("results").as_posix() for path in Path("results").rglob("summary.json"))


def test_four_wind_speeds_leave_four_results(capsys: pytest.CaptureFixture[str]) -> None:
    for speed in ("9", "9.5", "9.9", "10"):
        assert main([*SIMULATE, "--set", f"{WIND}={speed}"]) == 0
    stem = "strong-wind/simulate"
    # 9.9 m/s is that of the file: it is the file as it stands.
    assert folders() == [stem, *(f"{stem}-reference_speed_m_s={speed}" for speed in ("10", "9", "9.5"))]
    assert "replaced" not in capsys.readouterr().out


def test_options_that_shape_the_result_get_a_folder() -> None:
    assert main(SIMULATE) == 0
    assert main([*SIMULATE, "--no-gravity"]) == 0
    assert main([*SIMULATE, "--time-step", "0.02"]) == 0
    stem = "strong-wind/simulate"
    assert folders() == [stem, f"{stem}-no-gravity", f"{stem}-time-step=0.02"]


def test_a_changed_copy_gets_a_folder() -> None:
    text = shipped_problems()["strong-wind"].read_text()
    Path("copy.yaml").write_text(text)
    assert main(["simulate", "copy.yaml", "--no-plot"]) == 0
    Path("copy.yaml").write_text(re.sub(r"mass_kg: [\d.]+", "mass_kg: 17.5", text, count=1))
    assert main(["simulate", "copy.yaml", "--no-plot"]) == 0
    assert folders() == ["strong-wind/simulate", "strong-wind/simulate-mass_kg=17.5"]


def test_a_file_that_was_changed_keeps_the_result_of_before() -> None:
    assert main(["new", "mine"]) == 0
    assert main(["simulate", "mine.yaml", "--no-plot"]) == 0
    text = Path("mine.yaml").read_text()
    Path("mine.yaml").write_text(re.sub(r"(\n  mass_kg: )[\d.]+", r"\g<1>24", text, count=1))
    assert main(["simulate", "mine.yaml", "--no-plot"]) == 0
    assert folders() == ["mine/simulate", "mine/simulate-mass_kg=24"]


def test_the_same_input_replaces_its_own_result_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(SIMULATE) == 0
    assert main(SIMULATE) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("replaced")]
    assert lines == ["replaced: the earlier simulate result in results/strong-wind/simulate (the same input)"]


def test_o_replaces_a_result_of_the_same_verb_with_all_its_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "strong-wind", "-o", "out"]) == 0
    Path("out/notes.txt").write_text("mine")
    capsys.readouterr()
    assert main([*SIMULATE, "--set", f"{WIND}=10", "-o", "out", "--json"]) == 0
    out, err = capsys.readouterr()
    json.loads(out)
    assert err == "kiteocp: replaced: the earlier simulate result in out (other input, strong-wind)\n"
    # The picture of before would be taken for one of the new numbers.
    assert sorted(os.listdir("out")) == ["notes.txt", "summary.json", "timeseries.csv"]


@pytest.mark.parametrize("name", ["summary.json", "timeseries.csv", "cycle.png"])
def test_foreign_files_are_refused_before_computing(capsys: pytest.CaptureFixture[str], name: str) -> None:
    Path("out").mkdir()
    Path("out", name).write_text("{}")
    assert main([*SIMULATE, "-o", "out"]) == 2
    assert f"out/{name}: is there already" in capsys.readouterr().err
    assert Path("out", name).read_text() == "{}"
    assert os.listdir("out") == [name]


def test_the_result_of_another_verb_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SIMULATE, "-o", "out"]) == 0
    assert main(["solve", "strong-wind", "-o", "out"]) == 2
    assert "holds the simulate result of strong-wind, which solve would replace" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["-o", "--export"])
def test_what_cannot_be_written_is_found_before_computing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    monkeypatch.setattr("kiteocp.optimum.solve.solve", lambda *_: pytest.fail("it computed"))
    Path("taken").write_text("mine")
    assert main(["solve", "strong-wind", option, "taken/below"]) == 2
    assert "taken/below: cannot be written" in capsys.readouterr().err
    assert os.listdir() == ["taken"]


def test_long_and_odd_words_are_safe_names() -> None:
    words = [f"--set=environment.wind.{key}={value}" for key, value in (
        ("profile", "table"), ("heights_m", list(range(0, 1010, 10))), ("speeds_m_s", [12.5] * 101)
    )]  # fmt: skip
    assert main([*SIMULATE, *words]) == 0
    (folder,) = folders()
    assert len(folder.rpartition("/")[2]) < 110
    assert re.fullmatch(r"[A-Za-z0-9.,=+_/-]+-[0-9a-f]{8}", folder)


@pytest.mark.parametrize(
    "words", [["simulate", "strong-wind"], ["solve", "strong-wind"], ["crosswind", "strong-wind"],
              ["sensitivity", "strong-wind", "--no-intervals", "--vary", "kite.mass_kg=14,15"]]
)  # fmt: skip
def test_every_file_of_a_verb_is_known_as_its_own(words: list[str]) -> None:
    assert main([*words, "-o", "out", "--format", "svg"]) == 0
    found = {path.name for path in files_of(words[0], Path("out"))}
    assert found | {"summary.json"} == set(os.listdir("out"))
