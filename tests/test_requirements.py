"""The locked packages fit pyproject.toml on every system and Python, and the set-up installs them and no others."""

from __future__ import annotations

import importlib.metadata
import itertools
import os
import re
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hatchling.build import get_requires_for_build_editable
from packaging.markers import Marker, default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
DEPENDENCIES = [Requirement(text) for text in PROJECT["dependencies"]]
TEST_TOOLS = [Requirement(text) for text in PROJECT["optional-dependencies"]["test"]]
BACKEND = [Requirement(text) for text in PYPROJECT["build-system"]["requires"]]
BUILD = [Requirement(text) for text in PYPROJECT["dependency-groups"]["install"]]
#: Each file with all that it must hold.
LOCKS = {"demo": [*DEPENDENCIES, *BUILD], "test": [*DEPENDENCIES, *BUILD, *TEST_TOOLS]}
SYSTEMS = {
    "Linux": {"os_name": "posix", "sys_platform": "linux", "platform_system": "Linux"},
    "macOS": {"os_name": "posix", "sys_platform": "darwin", "platform_system": "Darwin"},
    "Windows": {"os_name": "nt", "sys_platform": "win32", "platform_system": "Windows"},
}
MACHINES = [
    SYSTEMS[system]
    | {"python_version": version, "python_full_version": f"{version}.0", "platform_python_implementation": "CPython"}
    for system, version in itertools.product(SYSTEMS, ("3.11", "3.12", "3.13", "3.14"))
]

_PIN = re.compile(r"([a-z0-9-]+)==([0-9][0-9a-z.]*)(?: ; ([^\\]+?))?((?: --hash=sha256:[0-9a-f]{64})+)")


@dataclass(frozen=True)
class Pin:
    """One locked package: where its marker holds, this version, as one of these files."""

    name: str
    version: str
    marker: str | None
    hashes: frozenset[str]


def text_of(lock: str) -> str:
    return (ROOT / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")


def pins_of(lock: str) -> Iterator[Pin]:
    """Yield the packages of a lock; a line that is not a package with its version and its hashes is an error."""
    lines = re.sub(r"\s*\\\n\s*", " ", text_of(lock)).splitlines()
    for line in lines:
        if line.strip() and not line.strip().startswith("#"):
            match = _PIN.fullmatch(line)
            assert match, f"requirements/{lock}.txt: {line[:80]}"
            name, version, marker, hashes = match.groups()
            yield Pin(name, version, marker, frozenset(hashes.split()))


def installed_on(machine: dict[str, str], lock: str) -> dict[str, Pin]:
    """Return by name what pip takes from a lock on a machine."""
    chosen = [pin for pin in pins_of(lock) if pin.marker is None or Marker(pin.marker).evaluate(machine)]
    by_name = {pin.name: pin for pin in chosen}
    assert len(by_name) == len(chosen), "a package has two versions"
    return by_name


def make(*words: str, cwd: Path = ROOT) -> str:
    """Run make as a user would, not as a part of the make that runs the tests."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS", "PYTHON"))}
    command = ["make", f"PYTHON={sys.executable}", *words]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_holds_versions_and_hashes_and_no_address(lock: str) -> None:
    text = text_of(lock)
    assert len(list(pins_of(lock))) > len(LOCKS[lock])
    assert "make lock" in text.partition("==")[0]
    assert "://" not in text
    # A path of the machine on which it was made: a word that starts with a slash, a tilde or a drive.
    assert re.findall(r"(?:^|\s)(?:[/~]|[A-Za-z]:[\\/])\S*", text) == []


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: "{sys_platform}-{python_version}".format(**machine))
def test_locked_versions_are_those_that_the_project_asks_for(machine: dict[str, str]) -> None:
    for lock, needs in LOCKS.items():
        locked = installed_on(machine, lock)
        for need in needs:
            pin = locked[canonicalize_name(need.name)]
            assert need.specifier.contains(pin.version), f"requirements/{lock}.txt: {pin.name} {pin.version}; {need}"


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: "{sys_platform}-{python_version}".format(**machine))
def test_the_tests_run_on_what_the_program_runs_on(machine: dict[str, str]) -> None:
    program, tests = installed_on(machine, "demo"), installed_on(machine, "test")
    for name, pin in program.items():
        assert (pin.version, pin.hashes) == (tests[name].version, tests[name].hashes)


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_holds_what_its_packages_need_in_turn(lock: str) -> None:
    """The packages of this environment tell what they need; another version may need something else."""
    installed = {canonicalize_name(package.name): package for package in importlib.metadata.distributions()}
    locked = installed_on({name: str(value) for name, value in default_environment().items()}, lock)
    same = [name for name, pin in locked.items() if name in installed and installed[name].version == pin.version]
    assert same
    for name in same:
        for need in map(Requirement, installed[name].requires or ()):
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                pin = locked.get(canonicalize_name(need.name))
                assert pin is not None, f"{name} needs {need}"
                assert need.specifier.contains(pin.version), f"{name} needs {need}, locked is {pin.version}"


def test_the_project_is_built_with_locked_packages() -> None:
    """Without build isolation pip fetches nothing for the build, so all that the backend asks for must be there."""
    group = {need.name for need in BUILD}
    assert {Requirement(text).name for text in get_requires_for_build_editable()} <= group
    assert {need.name for need in BACKEND} <= group
    locked = installed_on(MACHINES[0], "demo")
    for need in (*BACKEND, *map(Requirement, get_requires_for_build_editable())):
        assert need.specifier.contains(locked[need.name].version)


def test_oldest_versions_are_the_declared_ones() -> None:
    printed = [Requirement(line) for line in make("--silent", "minima").splitlines()]
    assert [need.name for need in printed] == [need.name for need in DEPENDENCIES]
    for exact, declared in zip(printed, DEPENDENCIES, strict=True):
        (equal,), (least,) = exact.specifier, declared.specifier
        assert (equal.operator, least.operator) == ("==", ">=")
        assert equal.version == least.version


@pytest.mark.parametrize(("target", "lock"), [("demo", "demo"), ("test", "test")])
def test_a_changed_lock_is_installed(target: str, lock: str) -> None:
    commands = make("--dry-run", f"--what-if=requirements/{lock}.txt", target)
    locked = commands.index(f"install --require-hashes --requirement requirements/{lock}.txt")
    project = commands.index("install --no-deps --no-build-isolation --editable .")
    assert locked < project
    assert commands.count("-m pip --disable-pip-version-check --quiet install") == 2


def test_continuous_integration_runs_the_locked_tests() -> None:
    assert re.search(r"^exec make test\b", (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)


def test_set_up_says_how_to_call_the_program() -> None:
    hint = make("--dry-run", "demo").splitlines()[-1]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    two_commands = readme.partition("## Two commands")[2].partition("\n## ")[0]
    for word in ("source .venv/bin/activate", ".venv/bin/kiteocp"):
        assert word in hint
        assert word in two_commands


@pytest.mark.slow
def test_demo_is_the_only_command_that_a_newcomer_needs(tmp_path: Path) -> None:
    """From what is published, in an empty folder, with nothing but Python; then what its last line says to type."""
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--sdist", "--outdir", tmp_path, ROOT],
        capture_output=True,
        check=True,
    )
    (source,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path, filter="data")
    home = source.with_name(source.name.removesuffix(".tar.gz"))
    printed = make("demo", cwd=home)
    assert "solve: certified" in printed
    hint = printed.splitlines()[-1]
    activated = "source .venv/bin/activate && kiteocp --help"
    assert all(part in hint for part in activated.split(" && "))
    for command in (activated, ".venv/bin/kiteocp --help"):
        done = subprocess.run(["bash", "-c", command], cwd=home, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("usage: kiteocp")
    frozen = subprocess.run(
        [home / ".venv" / "bin" / "python", "-m", "pip", "freeze", "--exclude-editable", "--all"],
        capture_output=True,
        text=True,
        check=True,
    )
    installed = {canonicalize_name(line.partition("==")[0]) for line in frozen.stdout.splitlines()}
    assert installed - {"pip", "setuptools"} <= {pin.name for pin in pins_of("demo")}
