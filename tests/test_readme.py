"""README shows what the program does: its outputs are run again, its files exist, its problem file loads.

``python -m benchmarks.readme`` writes the outputs anew.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

import kiteocp
from benchmarks.readme import README, REFERENCE, ROOT, Example, difference, examples, output_of
from kiteocp.problem import problem_from_dict

TEXT = README.read_text(encoding="utf-8")
EXAMPLES = examples(TEXT)


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One directory for all: a command may use what an earlier one wrote, in the order of the page."""
    return tmp_path_factory.mktemp("readme")


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.what.strip().splitlines()[-1])
def test_shown_outputs_are_those_of_now(example: Example, directory: Path) -> None:
    found = difference(example.shown, output_of(example, directory))
    assert found is None, f"{found}\nrefresh with: python -m benchmarks.readme"


def test_every_kind_of_output_is_found() -> None:
    assert {example.kind for example in EXAMPLES} == {"command", "python", "benchmark", "keys"}
    assert all(example.shown.strip() for example in EXAMPLES)
    assert TEXT.count("$ kiteocp") == sum(example.kind == "command" for example in EXAMPLES)
    verbs = {example.what.split()[1] for example in EXAMPLES if example.kind == "command"}
    assert verbs >= {"solve", "simulate", "list", "new", "check", "plot"}


@pytest.mark.parametrize(
    ("shown", "now", "same"),
    [
        ("solved in 37 ms, 15 iterations", "solved in 1.2 s, 23 iterations", True),
        ("  ok      limits         a is exceeded by 0.007 %", "  ok      limits         all are kept", True),
        ("  ok      limits         a", "  FAILED  limits         a", False),
        ("6.54 kW", "6.55 kW", True),
        ("6.54 kW", "6.56 kW", False),
        ("held (17 %)", "held (18 %)", True),
        ("tether 390 m", "tether 391 m", False),
        ("status: certified", "status: not_certified", False),
        ("one line\n", "one line\nand another\n", False),
        ("# 390 m", "# 390.0 m", False),
    ],
)
def test_a_difference_is_seen_and_noise_is_not(shown: str, now: str, same: bool) -> None:
    assert (difference(shown, now) is None) == same


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", TEXT)
    local = [link for link in links if "://" not in link]
    assert "results/reference/strong-wind/cycle.png" in local
    assert [link for link in local if not (ROOT / link).exists()] == []


def test_problem_file_shown_loads_and_solves() -> None:
    blocks = re.findall(r"^```yaml\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    files = [content for content in map(yaml.safe_load, blocks) if content]
    assert len(files) == 1
    problem = problem_from_dict(files[0])
    assert kiteocp.solve(problem, certificate="quick").status == "certified"


def test_reference_picture_is_small() -> None:
    content = (REFERENCE / "cycle.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    # It is looked at on a page, and each version of it stays in the repository for good.
    assert 20_000 < len(content) < 150_000


def test_reference_summary_is_what_solve_gives() -> None:
    reference = json.loads((REFERENCE / "summary.json").read_text(encoding="utf-8"))
    summary = kiteocp.solve(kiteocp.load_problem("strong-wind")).summary()
    assert set(reference) == set(summary)
    assert reference["input"] == summary["input"]
    assert reference["status"] == summary["status"] == "certified"
    # The full certificate bounds the change of the power from mesh to mesh by 1e-4.
    assert summary["cycle"]["mean_power_W"] == pytest.approx(reference["cycle"]["mean_power_W"], rel=1e-4)


def test_readme_names_every_key_of_the_summary_of_solve() -> None:
    reference = json.loads((REFERENCE / "summary.json").read_text(encoding="utf-8"))
    obvious = {"schema_version", "kiteocp_version", "versions", "verb", "problem", "input_sha256"}
    assert [key for key in set(reference) - obvious if f"`{key}`" not in TEXT] == []
