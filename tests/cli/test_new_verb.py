"""A verb that a test adds: its study, its module and its row are all it takes to compute, save, print and report."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from kiteocp import Problem, verbs
from kiteocp.cli import main as command
from kiteocp.cli.parser import add_calculation
from kiteocp.cli.run import calculate
from kiteocp.errors import SolveError
from kiteocp.report.document import Document, Figure
from kiteocp.report.table import Column, Table
from kiteocp.result import Result


@dataclass(frozen=True)
class Lengths:
    """The shortest and the longest tether of a problem."""

    problem: Problem

    @property
    def table(self) -> Table:
        limits = self.problem.operation
        return Table([Column("tether", "m", key="tether_length_m")], [(limits.tether_length_min_m,)])

    def result(self) -> Result:
        return Result("lengths", self.problem, details={"lengths": self.table.rows[0][0]})

    def document(self) -> Document:
        return Document("lengths", [self.table], page=True)

    def files(self) -> Mapping[str, bytes]:
        return {"lengths.csv": self.table.csv()}

    def figures(self) -> Sequence[Figure]:
        return ()


def lengths(problem: Problem) -> Lengths:
    if problem.kite.mass_kg > 100.0:
        raise SolveError("the kite is too heavy")
    return Lengths(problem)


@pytest.fixture(autouse=True)
def _verb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = ModuleType("kiteocp.cli.lengths")
    module.HELP = "say how long the tether is"  # type: ignore[attr-defined]
    module.add_arguments = add_calculation  # type: ignore[attr-defined]

    def run(arguments: argparse.Namespace) -> int:
        return calculate(arguments, "lengths", lengths, {})

    module.run = run  # type: ignore[attr-defined]
    monkeypatch.setattr(verbs, "VERBS", (*verbs.VERBS, verbs.Verb("lengths", ("lengths.csv", "report.html"))))
    monkeypatch.setitem(command.VERBS, "lengths", module)


def test_it_computes_saves_prints_and_reports(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["lengths", "strong-wind", "-o", "out"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.splitlines()[0] == "lengths"
    assert "written: out/summary.json, out/report.html, out/lengths.csv" in out
    assert json.loads(Path("out/summary.json").read_text())["lengths"] == 390.0
    assert Path("out/lengths.csv").read_text() == "tether_length_m\n390.0\n"
    assert '<td class="number">390</td>' in Path("out/report.html").read_text()


def test_it_knows_its_own_earlier_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["lengths", "strong-wind", "-o", "out"]) == 0
    assert command.main(["lengths", "strong-wind", "-o", "out", "--set", "kite.mass_kg=200", "--json"]) == 1
    assert "replaced: the earlier lengths result in out" in capsys.readouterr().err
    # What failed has neither table nor page.
    assert [path.name for path in Path("out").iterdir()] == ["summary.json"]


def test_a_failure_is_a_result_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["lengths", "strong-wind", "--set", "kite.mass_kg=200"]) == 1
    told = capsys.readouterr().err
    assert "strong-wind: failed: no optimal cycle found: the kite is too heavy; what was reached is saved in" in told
    (summary,) = Path("results").rglob("summary.json")
    assert json.loads(summary.read_text())["status"] == "failed"


def test_it_is_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--help"]) == 0
    assert "say how long the tether is" in capsys.readouterr().out
