"""``kiteocp validate`` as a user runs it: tables, sentences that follow the numbers, the report, the summary."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from kiteocp.cli.main import main
from kiteocp.report.document import WIDTH, Figure, Picture
from kiteocp.result.contract import STATUSES
from kiteocp.studies.paper import convergence, paper
from kiteocp.studies.paper.captions import CAPTIONS
from kiteocp.studies.paper.claims import check_claims
from kiteocp.studies.paper.convergence import convergence_study
from kiteocp.studies.paper.isolines import mass_isolines
from kiteocp.studies.paper.paper import PaperValidation, validate_paper
from kiteocp.studies.paper.published import CASES
from kiteocp.studies.paper.report import MARKS
from kiteocp.studies.paper.tables import Comparison
from kiteocp.verbs import verb_named
from kiteocp.writing import write_atomically


@pytest.fixture(scope="module")
def study() -> PaperValidation:
    """The validation with fewer and larger time steps, and a coarser picture of the isolines."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            paper, "convergence_study", lambda progress: convergence_study(np.geomspace(0.3, 2e-3, 5), progress)
        )
        patch.setattr(
            paper, "mass_isolines", lambda: mass_isolines(np.linspace(0.0, 360.0, 41), np.linspace(1.5, 9.0, 31))
        )
        return validate_paper()


@pytest.fixture
def _computed(study: PaperValidation, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command use the study above; that it computes one is what the slow test is for."""
    monkeypatch.setattr(paper, "validate_paper", lambda progress: study)


class Page(HTMLParser):
    """Collects what a page refers to, and that every element is closed."""

    EMPTY = frozenset({"meta", "img"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(html: str) -> Page:
    page = Page()
    page.feed(html)
    assert page.open == []
    return page


def test_report_is_one_page_that_needs_nothing_else(study: PaperValidation) -> None:
    pictures = [Picture(Figure("side_view", "Seen from the <side>."), "image/svg+xml", b"<svg/>")]
    html = study.document().html(pictures)
    page = page_of(html)
    assert [reference.partition(",")[0] for reference in page.references] == ["data:image/svg+xml;base64"]
    assert "Figure 1. Seen from the <side>." in page.text
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert re.search(r"url\(|@import|https?://", html) is None
    for sentences in study.statements().values():
        for sentence in sentences:
            assert sentence in page.text
    assert "Drawn without pictures" in page_of(study.document().html()).text


def test_tables_show_the_numbers(study: PaperValidation) -> None:
    text = study.document().text()
    assert all(len(line) <= WIDTH for line in text.splitlines())
    lines = [line for line in text.splitlines() if line.startswith("cycle power")]
    shown = (("kite", False), ("kite", True), ("ground", True))
    expected = [(case, *which) for case in CASES for which in shown]
    assert len(lines) == len(expected)
    for line, (case, reference, gravity) in zip(lines, expected, strict=True):
        row = study.comparison(case, reference, gravity=gravity).row("cycle.mean_power_W")
        numbers = [float(number) for number in re.findall(r"[-+]?\d+\.?\d*", line)]
        powers = (row.simulated, row.published.value, row.band.low, row.band.high, row.experiment.value)
        # Printed to 0.01 kW and 0.1 %, the last to 1 %.
        assert [numbers[i] for i in (0, 1, 3, 4, 5)] == pytest.approx([1e-3 * power for power in powers], abs=0.0051)
        assert numbers[2] == pytest.approx(row.deviation_percent, abs=0.051)
        assert numbers[6] == pytest.approx(row.experiment_percent, abs=0.51)
        assert f" {MARKS[row.explained]} " in line


def test_the_page_has_what_is_too_much_for_a_terminal(study: PaperValidation) -> None:
    text, page = study.document().text(), page_of(study.document().html())
    row = study.comparison("strong-wind", "kite", gravity=True).row("cycle.mean_power_W")
    assert f"{1e-3 * row.stepped:.2f}" in page.text
    for words in ("with the paper's time step", "Richardson's limit", "Computed by kiteocp", "(nominal)"):
        assert words in page.text
        assert words not in text
    for claim in study.claims["ground"]:
        assert claim.numbers in page.text


def moved(comparison: Comparison, quantity: str, share: float) -> Comparison:
    """The comparison with one published number moved away from the simulated one by a share of it."""
    rows = [
        replace(row, published=replace(row.published, value=row.simulated * (1 + share)))
        if row.quantity == quantity
        else row
        for row in comparison.rows
    ]
    return replace(comparison, rows=tuple(rows))


def test_sentences_follow_the_numbers(study: PaperValidation) -> None:
    quantity = "transition.mean_power_W"
    assert "transition power" in study.statements()["What lies outside"][0]
    near = replace(study, comparisons=tuple(moved(found, quantity, 1e-3) for found in study.comparisons))
    outside, explained = (
        near.statements()[topic] for topic in ("What lies outside", "What the rounding of the inputs explains")
    )
    assert "transition power" not in outside[0]
    assert "transition power" in explained[0]
    only = [name for name in study.comparisons[0].published_rows if name.explained == "no"]
    assert len(only) > 0
    everything = study.comparisons
    for row in study.comparisons[0].published_rows:
        everything = tuple(moved(found, row.quantity, 0.0) for found in everything)
    assert replace(study, comparisons=everything).statements()["What lies outside"][0].endswith("nothing.")


def test_conclusions_of_the_paper_are_judged_by_the_numbers(study: PaperValidation) -> None:
    assert {reference: len(claims) for reference, claims in study.claims.items()} == {"kite": 12, "ground": 12}
    between = next(claim for claim in study.claims["kite"] if "lies between" in claim.text)
    powers = [
        study.comparison("strong-wind", "kite", gravity=gravity).row("cycle.mean_power_W") for gravity in (False, True)
    ]
    assert between.holds == (powers[0].simulated <= powers[0].experiment.value <= powers[1].simulated)

    def measured_less(case: str, gravity: bool) -> Comparison:
        found = study.comparison(case, "kite", gravity=gravity)
        rows = [
            replace(row, experiment=replace(row.experiment, value=0.8 * row.experiment.value)) for row in found.rows
        ]
        return replace(found, rows=tuple(rows))

    # 80 % of the measured 6.48 kW lies between the two simulations.
    assert next(claim for claim in check_claims(measured_less) if "lies between" in claim.text).holds != between.holds


def test_summary_keeps_the_contract(study: PaperValidation) -> None:
    summary = json.loads(json.dumps(study.result().summary(), allow_nan=False))
    assert (summary["schema_version"], summary["verb"], summary["problem"]) == (
        1,
        "validate",
        "strong-wind, moderate-wind",
    )
    assert summary["status"] in STATUSES
    assert set(summary["input"]) == set(CASES)
    assert re.fullmatch(r"[0-9a-f]{64}", summary["input_sha256"])
    rows = summary["validation"]["tables"]["moderate-wind"]["force_at_ground"]["gravity_included"]
    row = study.comparison("moderate-wind", "ground", gravity=True).row("cycle.duration_s")
    assert rows["cycle.duration_s"]["simulated"] == row.simulated
    assert rows["cycle.duration_s"]["explained_by_rounding"] == row.explained
    assert rows["cycle.duration_s"]["rounding_band"]["low"] == row.band.low
    assert set(summary["validation"]["convergence"]) == set(study.convergence.curves)
    # Sentences are for people.
    assert "statements" not in summary["validation"]


@pytest.mark.usefixtures("_computed")
def test_command_without_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "-o", str(tmp_path), "--no-plot"]) == 0
    capsys.readouterr()
    for stem in CAPTIONS:
        write_atomically({tmp_path / f"{stem}.svg": b"of an earlier run"})
    assert main(["validate", "-o", str(tmp_path), "--no-plot"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "What lies outside" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "summary.json"]
    assert main(["validate", "-o", str(tmp_path), "--no-plot", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "summary.json").read_text())
    assert main(["plot", str(tmp_path)]) == 2
    assert "holds two problems" in capsys.readouterr().err


@pytest.mark.usefixtures("_computed")
def test_command_with_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["validate", "--format", "png"]) == 0
    directory = Path("results/validation")
    names = {path.name for path in directory.iterdir()}
    assert names == {"report.html", "summary.json", *(f"{stem}.png" for stem in CAPTIONS)}
    references = page_of((directory / "report.html").read_text()).references
    assert len(references) == len(CAPTIONS)
    assert all(reference.startswith("data:image/png;base64,") for reference in references)
    assert "10 pictures beside them as png" in capsys.readouterr().out


@pytest.mark.usefixtures("_computed")
def test_mistakes_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["validate", "--no-plot", "-o", str(tmp_path / "file" / "below")]) == 2
    assert main(["validate", "--format", "gif"]) == 2
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2
    assert "cannot be written" in err[0]
    assert "picture format" in err[1]


@pytest.mark.slow
def test_whole_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "-o", str(tmp_path)]) == 0
    page = page_of((tmp_path / "report.html").read_text())
    assert all(reference.startswith("data:image/svg+xml;base64,") for reference in page.references)
    assert len(list(tmp_path.iterdir())) == 2 + 3 * len(CAPTIONS)
    summary = json.loads((tmp_path / "summary.json").read_text())
    curve = summary["validation"]["convergence"]["strong wind, gravity included"]
    assert curve["time_steps"] == pytest.approx(convergence.TIME_STEPS)
    assert curve["richardson_limit_ratio"] == pytest.approx(curve["adaptive_integrator_ratio"], abs=1e-6)
    assert "What lies outside" in capsys.readouterr().out


def test_pictures_are_those_that_are_drawn(study: PaperValidation) -> None:
    verb = verb_named("validate")
    assert verb is not None
    assert [figure.stem for figure in study.figures()] == list(CAPTIONS)
    assert set(CAPTIONS) <= set(verb.pictures)
