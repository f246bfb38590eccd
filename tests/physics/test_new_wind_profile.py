"""A wind profile that a test adds to a copy of the package: two files, and every verb knows it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import kiteocp
from kiteocp.problem import problem_path

PROBLEM = str(problem_path("v3-kite"))
KEYS = '''
class JetWind(Profile, frozen=True, tag="jet"):
    """Wind of a low-level jet, ``v = v_ref (z / z_ref) exp(1 - z / z_ref)``."""

    reference_speed_m_s: _Speed
    reference_height_m: _Height
    jet_share: Annotated[float, quantity("1", "share of the jet in the wind", ge=0, le=1, example=0.5)]

    def mistakes(self, lowest_m: float, highest_m: float) -> Iterator[tuple[str, str]]:
        """Yield a jet below the kite."""
        if self.reference_height_m < lowest_m:
            yield f"{_PATH}.reference_height_m", f"{_PATH}.reference_height_m lies below the kite; raise it"


'''
OBJECT = """    "jet": WindProfile(
        lambda height, p: p[_SPEED]
        * (1 - p[f"{WIND}.jet_share"] + p[f"{WIND}.jet_share"] * height / p[_HEIGHT] * ca.exp(1 - height / p[_HEIGHT])),
        words=lambda v, number: f"a jet of {number} m/s at {v[_HEIGHT]:g} m",
    ),
"""


def _insert(path: Path, before: str, text: str) -> None:
    content = path.read_text(encoding="utf-8")
    assert content.count(before) == 1
    path.write_text(content.replace(before, text + before), encoding="utf-8")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("with-jet")
    shutil.copytree(Path(kiteocp.__file__).parent, root / "kiteocp", ignore=shutil.ignore_patterns("__pycache__"))
    keys, objects = root / "kiteocp/problem/wind.py", root / "kiteocp/physics/wind.py"
    _insert(keys, "#: All profiles, told apart", KEYS)
    text = keys.read_text(encoding="utf-8")
    keys.write_text(text.replace("= LogarithmicWind | ", "= LogarithmicWind | JetWind | "), encoding="utf-8")
    _insert(objects, '    "uniform": WindProfile(', OBJECT)
    return root


def run(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "kiteocp", *arguments],
        cwd=place,
        env={**os.environ, "PYTHONPATH": str(place)},
        capture_output=True,
        text=True,
        check=False,
    )


JET = ("--set", "environment.wind.profile=jet", "--set", "environment.wind.jet_share=0.3")


def test_it_is_solved_with_a_certificate(place: Path) -> None:
    done = run(place, "solve", PROBLEM, *JET, "--certificate", "quick", "--no-plot", "-o", "jet")
    assert done.returncode == 0, done.stderr
    summary = json.loads((place / "jet" / "summary.json").read_text(encoding="utf-8"))
    assert summary["input"]["environment"]["wind"]["profile"] == "jet"
    assert summary["certificate"]["passed"]


def test_it_is_in_the_sensitivity_of_the_optimal_power(place: Path) -> None:
    done = run(place, "sensitivity", PROBLEM, *JET, "--no-plot", "--no-intervals", "-o", "prices")
    assert done.returncode == 0, done.stderr
    assert "environment.wind.jet_share" in (place / "prices" / "summary.json").read_text(encoding="utf-8")


def test_its_keys_are_in_the_template_and_in_the_schema(place: Path) -> None:
    assert run(place, "new", "mine").returncode == 0
    template = (place / "mine.yaml").read_text(encoding="utf-8")
    assert "# jet_share: 0.5" in template
    assert "share of the jet in the wind" in template
    schema = run(place, "schema")
    assert '"jet_share"' in schema.stdout


def test_its_own_mistakes_are_said(place: Path) -> None:
    done = run(place, "check", PROBLEM, *JET, "--set", "environment.wind.reference_height_m=3")
    assert done.returncode == 2
    assert "environment.wind.reference_height_m lies below the kite; raise it" in done.stderr
