"""The shape of the package: which room may import which, and what stays out of a start."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

import kiteocp

PACKAGE = Path(kiteocp.__file__).parent
ROOT = PACKAGE.parent
#: Each may import only from itself and those before it.
ROOMS = (
    "_version",
    "errors",
    "execution",
    "forked",
    "writing",
    "verbs",
    "numerics",
    "report",
    "ocp",
    "problem",
    "physics",
    "result",
    "recording",
    "cycle",
    "optimum",
    "studies",
    "plots",
    "cli",
)
HEAVY = ("casadi", "matplotlib", "numpy", "scipy")
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path.parent != PACKAGE or path.stem in ROOMS)


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and dotted name of everything a module imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # A relative import would hide the room it comes from.
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_one_way(path: Path) -> None:
    room = room_of(path)
    allowed = ROOMS[: ROOMS.index(room) + 1]
    for line, name in imports(path):
        package, _, rest = name.partition(".")
        target = rest.partition(".")[0]
        if package == "kiteocp" and target in ROOMS:
            assert target in allowed, f"{path}:{line}: {room} imports {name}"
        if package == "matplotlib":
            assert room == "plots", f"{path}:{line}: only plots imports matplotlib"


def test_every_room_has_its_place_in_the_order() -> None:
    assert {room_of(path) for path in MODULES} <= set(ROOMS)


@pytest.mark.parametrize(
    "code",
    [
        "import kiteocp",
        "import kiteocp.problem; kiteocp.problem.load_problem('v3-kite')",
        "import kiteocp.cli.main",
        "from kiteocp.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass",
        "from kiteocp.cli.main import main\ntry: main(['list'])\nexcept SystemExit: pass",
    ],
)
def test_a_light_start_loads_nothing_heavy(code: str) -> None:
    report = f"{code}\nimport sys\nprint('loaded:', *[name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded:"


def test_versions_and_licence_agree() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == kiteocp.__version__
    assert citation["license"] == project["license"] == (ROOT / "LICENSE").read_text().split()[0]
    assert re.search(
        r"^## \[(Unreleased|" + re.escape(kiteocp.__version__) + r")\]", (ROOT / "CHANGELOG.md").read_text(), re.M
    )
    assert citation["references"][0]["doi"] == "10.1016/j.renene.2018.07.023"


def imports_of_modules() -> dict[str, set[str]]:
    """What each module of the package imports of it, in functions too; what only type checkers read does not count."""
    modules = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        modules[".".join(parts).removesuffix(".__init__")] = path
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        typing_only = {
            id(inner)
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and getattr(node.test, "id", None) == "TYPE_CHECKING"
            for part in node.body
            for inner in ast.walk(part)
        }
        found[name] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and id(node) not in typing_only:
                for alias in node.names:
                    full = f"{node.module}.{alias.name}"
                    found[name].add(full if full in modules else str(node.module))
            elif isinstance(node, ast.Import) and id(node) not in typing_only:
                found[name].update(alias.name for alias in node.names)
        found[name] = (found[name] & set(modules)) - {name}
    return found


def circle_in(graph: dict[str, set[str]]) -> list[str]:
    """Return what can be reached from itself: what is left after taking away what imports nothing that is left."""
    left = dict(graph)
    while free := [name for name, needs in left.items() if not needs & set(left)]:
        for name in free:
            del left[name]
    return sorted(left)


def test_no_module_imports_in_a_circle() -> None:
    assert circle_in(imports_of_modules()) == []
    assert circle_in({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == ["a", "b", "c", "d"]


def test_no_room_imports_in_a_circle() -> None:
    """Each room of ``studies`` counts for itself."""

    def room(module: str) -> str:
        parts = module.split(".")[1:]
        return ".".join(parts[:2] if parts[:1] == ["studies"] else parts[:1])

    rooms: dict[str, set[str]] = {}
    for module, needs in imports_of_modules().items():
        rooms.setdefault(room(module), set()).update(room(need) for need in needs)
    assert circle_in({name: needs - {name} for name, needs in rooms.items()}) == []


@pytest.mark.parametrize("room", ["ocp", "numerics", "report"])
def test_what_is_general_knows_nothing_of_kites(room: str) -> None:
    words = re.compile(r"\b(kite|kites|tether|reel|reeling|winch|retraction|traction|elevation|wind)\b", re.IGNORECASE)
    strangers = ("problem", "physics", "cycle", "optimum", "studies", "recording", "result", "plots", "cli")
    for path in sorted((PACKAGE / room).glob("*.py")):
        for line, name in imports(path):
            assert not name.startswith(tuple(f"kiteocp.{other}" for other in strangers)), f"{path}:{line}: {name}"
        # That it knows nothing of kites is what it may say.
        text = re.sub(r"(nothing|knows|no).{0,25}kites", "", path.read_text(encoding="utf-8"))
        assert [line for line in text.splitlines() if words.search(line)] == [], path
