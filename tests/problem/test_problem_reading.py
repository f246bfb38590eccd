"""Reading problem files: scalars of YAML 1.2, and one sentence for whatever is not a problem file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from kiteocp.errors import InputError
from kiteocp.problem import load_problem, problem_template
from kiteocp.problem.reading import parse


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5e-3", 0.005),
        ("1e3", 1000.0),
        ("4E2", 400.0),
        ("1.", 1.0),
        ("-.5", -0.5),
        ("+7", 7),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("no", "no"),
        ("true", True),
        ("~", None),
        ("2012-06-23", "2012-06-23"),
        ("'5'", "5"),
    ],
)
def test_scalars_follow_yaml_1_2(text: str, value: object) -> None:
    read, _ = parse(f"key: {text}", "text")
    assert read == {"key": value}
    assert type(read["key"]) is type(value)


def test_infinities_and_nan_are_numbers() -> None:
    read, _ = parse("[.inf, -.INF, .nan]", "text")
    assert read[:2] == [math.inf, -math.inf]
    assert math.isnan(read[2])


def test_lines_of_nested_keys_are_known() -> None:
    _, lines = parse("a:\n  b: 1\n  c:\n    - 2\n    - 3\n", "text")
    assert lines == {"a": 1, "a.b": 2, "a.c": 3, "a.c[0]": 4, "a.c[1]": 5}


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        (b"", None, "is empty"),
        (b"# only a comment\n", None, "is empty"),
        (b"- 1\n", None, "holds a list"),
        (b"just text", None, "holds the text 'just text'"),
        (b"a: [\n", 2, "not valid YAML"),
        (b"a:\n\t- b\n", 2, "not valid YAML"),
        (b"a: *nowhere\n", 1, "undefined alias"),
        (b"a: &a [*a]\n", 1, "contains itself"),
        (b"a: !!python/object:os.system x\n", 1, "not valid YAML"),
        (b"a: !!bool x\n", None, "not true or false"),
        (b"a: 1\n---\nb: 2\n", 2, "single document"),
        (b"name: a\nkite: {}\nname: b\n", 3, "name is given twice, in lines 1 and 3"),
        (b"kite:\n  mass_kg: 1\n  mass_kg: 2\n", 3, "kite.mass_kg is given twice"),
        (b"name: \xe9\n", 1, "not UTF-8"),
        ("name: x".encode("utf-16"), 1, "not UTF-8"),
        (b"name: \x07\n", None, "not valid YAML"),
        (b"#" * 1_000_001, None, "larger than 1 MB"),
        # Deep enough to overflow the stack of the composer in C, were it to get that far.
        (b"[" * 100_000 + b"]" * 100_000, None, "nested too deeply"),
        (b"- " * 20_000, None, "nested too deeply"),
    ],
)
def test_what_is_no_problem_file_is_said_in_one_sentence(
    tmp_path: Path, content: bytes, line: int | None, words: str
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_problem(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert words in message
    assert "\n" not in message
    assert caught.value.exit_status == 2


def test_missing_file_and_directory_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_problem(tmp_path / "nothing.yaml")
    with pytest.raises(InputError, match="is a directory"):
        load_problem(tmp_path)
    with pytest.raises(InputError, match="its name holds a NUL character"):
        load_problem("a\0b.yaml")


def test_byte_order_mark_and_windows_line_ends_are_accepted(tmp_path: Path) -> None:
    path = tmp_path / "windows.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + problem_template("windows").replace("\n", "\r\n").encode())
    assert load_problem(path).name == "windows"
