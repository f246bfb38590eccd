"""What README shows of the program: run it again, compare, refresh.

Made by the program are: a ``console`` block (each line ``$ command`` followed by what it prints), a ``text`` block
right after a ``python`` block (what that prints), a ``text`` block after the comment ``benchmark: FILE`` (the report of
that file), and what stands between the comments ``keys: SECTION`` and ``end`` (the keys of the problem file). Other
blocks are not run. ``python -m benchmarks.readme`` writes all of them anew, with the reference results; ``--check``
only compares.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from benchmarks.keys import key_table
from benchmarks.report import Report

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
REFERENCE = ROOT / "results" / "reference" / "strong-wind"

#: Dots per inch of the picture, and its number of colours: readable at the width of a page, and small.
PICTURE_DPI = 110
PICTURE_COLOURS = 128

_FENCE = re.compile(r"^(?:<!-- benchmark: (\S+) -->\n)?```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_KEYS = re.compile(r"^<!-- keys: (\S+) -->\n(.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)
_COMMAND = re.compile(r"^\$ ", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?: %)?")
#: What differs from run to run or from machine to machine: times of the solver, its iterations, and residuals that are
#: rounding errors. The checks that passed keep their names.
_MASKS = (
    (re.compile(r"^(  (?:ok|note) +[a-z-]+(?: [a-z]+)?)  .*$", re.MULTILINE), r"\1"),
    (re.compile(r"\d+ iterations"), "# iterations"),
    (re.compile(r"\bin \d+(?:\.\d+)? m?s\b"), "in # s"),
    (re.compile(r"\d(?:\.\d+)?e-\d+"), "#"),
)
#: What a slow run tells while it goes on.
_PROGRESS = re.compile(r"^\d+ of \d+ (?:.*, about \d+ s left|.* (?:done|solved|drawn))\n", re.MULTILINE)


class Example(msgspec.Struct, frozen=True):
    """One output shown in README.

    Attributes
    ----------
    what
        The command, the Python program, the report or the section of the problem file that it comes from.
    kind
        ``command``, ``python``, ``benchmark`` or ``keys``.
    start, end
        Where the output stands in the text.
    shown
        The output as README has it.
    """

    what: str
    kind: str
    start: int
    end: int
    shown: str


def examples(text: str) -> list[Example]:
    """Return the outputs shown in a text, in its order."""
    found = [Example(match[1], "keys", *match.span(2), match[2]) for match in _KEYS.finditer(text)]
    program = None
    for match in _FENCE.finditer(text):
        report, language, body = match.groups()
        if language == "console":
            found += _commands(body, match.start(3))
        elif language == "text" and (report or program is not None):
            found.append(Example(report or str(program), "benchmark" if report else "python", *match.span(3), body))
        program = body if language == "python" else None
    return sorted(found, key=lambda example: example.start)


def _commands(body: str, offset: int) -> Iterator[Example]:
    """Yield the commands of a console block that starts at an offset of the text."""
    starts = [command.start() for command in _COMMAND.finditer(body)]
    for first, last in zip(starts, [*starts[1:], len(body)], strict=True):
        command, _, output = body[first:last].partition("\n")
        yield Example(command[2:], "command", offset + last - len(output), offset + last, output)


def output_of(example: Example, directory: Path) -> str:
    """Return what an example prints now, run in a directory that the examples share."""
    if example.kind == "benchmark":
        return f"{Report.read(ROOT / example.what)}\n"
    if example.kind == "keys":
        return key_table(example.what)
    command = ["bash", "-c", example.what] if example.kind == "command" else [sys.executable, "-c", example.what]
    # The program of this environment before any other, at the width of a terminal.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    done = subprocess.run(
        command,
        cwd=directory,
        env=os.environ | {"PATH": path, "COLUMNS": "80"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return _PROGRESS.sub("", done.stdout)


def masked(output: str) -> str:
    """Return an output without what differs from run to run."""
    for pattern, replacement in _MASKS:
        output = pattern.sub(replacement, output)
    return output


def difference(shown: str, now: str) -> str | None:
    """Return the first line in which two outputs differ, or None.

    Fractions may differ by one in their last digit: that is what rounding makes of an optimum known to eight digits.
    """
    lines_shown, lines_now = masked(shown).splitlines(), masked(now).splitlines()
    for line_shown, line_now in zip(lines_shown, lines_now, strict=False):
        numbers = list(zip(_NUMBER.findall(line_shown), _NUMBER.findall(line_now), strict=False))
        same_words = _NUMBER.sub("#", line_shown).split() == _NUMBER.sub("#", line_now).split()
        if not same_words or not all(_nearly_equal(*pair) for pair in numbers):
            return f"shown: {line_shown}\nnow:   {line_now}"
    if len(lines_shown) != len(lines_now):
        return f"shown: {len(lines_shown)} lines\nnow:   {len(lines_now)} lines"
    return None


def _nearly_equal(shown: str, now: str) -> bool:
    percent = shown.endswith(" %")
    decimals = len(shown.removesuffix(" %").partition(".")[2])
    # Another integer is a count or a value of the problem file, and exact.
    return shown == now or (
        (percent or decimals > 0)
        and abs(float(shown.removesuffix(" %")) - float(now.removesuffix(" %"))) < 1.5 * 10.0**-decimals
    )


def refreshed(text: str) -> str:
    """Return README's text with the outputs of now; an output that says the same stays as it is."""
    found = examples(text)
    with tempfile.TemporaryDirectory() as directory:
        outputs = [output_of(example, Path(directory)) for example in found]
    for example, now in reversed(list(zip(found, outputs, strict=True))):
        keep = example.kind != "benchmark" and difference(example.shown, now) is None
        text = text[: example.start] + (example.shown if keep else now) + text[example.end :]
    return text


def write_reference() -> None:
    """Write the optimum of strong-wind that README shows: its summary and a small picture."""
    import kiteocp  # noqa: PLC0415  (the tests of README's text need neither)
    from kiteocp.plots.cycle import compose_optimum  # noqa: PLC0415

    result = kiteocp.solve(kiteocp.load_problem("strong-wind"))
    with tempfile.TemporaryDirectory() as directory:
        summary, *_ = result.save(directory)
        REFERENCE.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(summary, REFERENCE / "summary.json")
    stream = io.BytesIO()
    compose_optimum(result).savefig(stream, format="png", dpi=PICTURE_DPI)
    reduce_picture(stream, REFERENCE / "cycle.png")


def reduce_picture(stream: io.BytesIO, path: Path) -> None:
    """Write a PNG with few colours, a quarter of the size."""
    from PIL import Image  # noqa: PLC0415  (comes with matplotlib)

    with Image.open(stream) as image:
        reduced = image.convert("RGB").quantize(PICTURE_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        reduced.save(path, optimize=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Refresh or check README.

    Parameters
    ----------
    argv
        The arguments; those of the process where left out.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks.readme", description="Refresh what README shows.")
    parser.add_argument("--check", action="store_true", help="only say what is out of date; exit status 1 if anything")
    arguments = parser.parse_args(argv)
    text = README.read_text(encoding="utf-8")
    if arguments.check:
        stale = 0
        with tempfile.TemporaryDirectory() as directory:
            for example in examples(text):
                found = difference(example.shown, output_of(example, Path(directory)))
                if found:
                    stale += 1
                    print(f"{example.what.strip()}\n{found}\n")
        return min(stale, 1)
    write_reference()
    README.write_text(refreshed(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
