"""The wheel, built from the source distribution, works away from the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from kiteocp.problem import shipped_problems

ROOT = Path(__file__).resolve().parents[1]


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command as a user would, without the paths of this process, and return what it printed."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Build the source distribution, and the wheel from it, with the build backend of this environment."""
    directory = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", directory, ROOT, cwd=directory)
    (wheel,) = directory.glob("*.whl")
    (source,) = directory.glob("*.tar.gz")
    return wheel, source


@pytest.fixture(scope="module")
def fresh_python(distributions: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into a fresh environment that borrows only the dependencies of this one."""
    home = tmp_path_factory.mktemp("fresh")
    venv.create(home, with_pip=False, symlinks=True)
    python = home / "bin" / "python"
    run(
        *(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index"),
        distributions[0],
        cwd=home,
    )
    # A path file is not followed from a directory that another one names, so the editable kiteocp stays out.
    (site,) = (home / "lib").glob("python*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def test_distributions_carry_what_they_should(distributions: tuple[Path, Path]) -> None:
    wheel, source = distributions
    files = zipfile.ZipFile(wheel).namelist()
    assert {f"kiteocp/problems/{name}.yaml" for name in shipped_problems()} <= set(files)
    assert "kiteocp/py.typed" in files
    assert any(name.endswith("dist-info/licenses/LICENSE") for name in files)
    # Nothing else at the top, tests least of all.
    assert {name.split("/")[0].partition("-")[0] for name in files} == {"kiteocp"}
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "LICENSE", "CHANGELOG.md", "CITATION.cff", "problems/v3-kite.yaml"} <= names
    assert {"CONTRIBUTING.md", "Makefile", "requirements/demo.txt", "requirements/test.txt"} <= names


def test_the_wheel_checks_every_shipped_problem(fresh_python: Path, tmp_path: Path) -> None:
    where = run(fresh_python, "-c", "import kiteocp; print(kiteocp.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(fresh_python.parents[1])
    for name in shipped_problems():
        assert "ok" in run(fresh_python.with_name("kiteocp"), "check", name, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []
