"""A copy of the process that works meanwhile: answers, failures, ends, and where there can be none."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process is copied on Linux only")

#: A program of its own, as this process has threads: nothing is loaded that starts one.
HEAD = """
import os, signal, sys, time
from kiteocp import forked

def count(upto):
    for number in range(upto):
        yield number

def answers_of(copy, *task):
    found = []
    try:
        for answer in copy.answers(*task):
            found.append(answer)
    except forked.LostError:
        found.append("lost")
    return found

def left():
    try:
        return os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return "none left"

def closed_in(copy):
    began = time.monotonic()
    copy.close()
    return time.monotonic() - began
"""


def run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", HEAD + code], capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    assert done.returncode == 0
    return done.stdout.splitlines()


def test_it_answers_and_ends() -> None:
    assert run("""
ready = []
copy = forked.fork(lambda: ready.append(1), lambda upto: iter([*count(upto), len(ready), os.getpid() == %d]))
print(answers_of(copy, 3), ready, closed_in(copy) < 0.5, left())
""".replace("%d", "os.getppid()")) == ["[0, 1, 2, 1, False] [] True none left"]  # fmt: skip


@pytest.mark.parametrize(
    ("make_ready", "work", "task", "expected"),
    [
        ("lambda: None", "lambda upto: (1 / (1 - number) for number in count(upto))", "3", "[1.0, 'lost']"),
        ("lambda: 1 / 0", "count", "3", "['lost']"),
        ("lambda: os.kill(os.getpid(), signal.SIGKILL)", "count", "3", "['lost']"),
        ("lambda: sys.exit('no')", "count", "3", "['lost']"),
        ("lambda: None", "count", "lambda: None", "['lost']"),
        ("lambda: None", "lambda size: [bytes(size)] * 3 if size else []", "0", "[]"),
    ],
)
def test_a_copy_that_fails_is_lost_without_a_word(make_ready: str, work: str, task: str, expected: str) -> None:
    code = f"copy = forked.fork({make_ready}, {work})\nprint(answers_of(copy, {task}), closed_in(copy) < 0.5, left())"
    assert run(code) == [f"{expected} True none left"]


def test_much_is_sent_both_ways() -> None:
    code = "copy = forked.fork(lambda: None, lambda data: [data, data])\ndata = os.urandom(1 << 20)\n"
    assert run(code + "print(answers_of(copy, data) == [data, data]); copy.close()") == ["True"]


def test_a_copy_that_is_not_asked_clears_up_and_ends(tmp_path: Path) -> None:
    assert run(f"""
def slow():
    open({str(tmp_path / "lock")!r}, "w").close()
    try:
        time.sleep(60)
    finally:
        os.unlink({str(tmp_path / "lock")!r})

copy = forked.fork(slow, count)
while not os.path.exists({str(tmp_path / "lock")!r}):
    time.sleep(0.01)
print(closed_in(copy) < 0.5, os.path.exists({str(tmp_path / "lock")!r}), left())
""") == ["True False none left"]


def test_a_copy_that_does_not_listen_is_killed() -> None:
    assert run("""
def deaf():
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    time.sleep(60)

copy = forked.fork(deaf, count)
time.sleep(0.2)
print(0.9 < closed_in(copy) < 3.0, left())
""") == ["True none left"]


def test_a_key_of_the_terminal_does_not_end_it() -> None:
    assert run("""
copy = forked.fork(lambda: time.sleep(0.2), count)
os.kill(copy._process, signal.SIGINT)
print(answers_of(copy, 2)); copy.close()
""") == ["[0, 1]"]


def test_it_does_not_outlive_the_process_that_it_copies() -> None:
    code = HEAD + "copy = forked.fork(lambda: None, count)\nprint(copy._process, flush=True)\ntime.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    copy = int(process.stdout.readline())
    process.kill()
    # The copy has the stream too: it is at its end once both have gone.
    assert process.communicate(timeout=10) == ("", None)
    for _ in range(100):
        try:
            os.kill(copy, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{copy}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.05)
    os.kill(copy, signal.SIGKILL)
    pytest.fail("the copy is still there")


@pytest.mark.parametrize(
    "preparation",
    [
        "import threading; threading.Thread(target=time.sleep, args=(1,), daemon=True).start()",
        "forked.sys = type('', (), {'platform': 'darwin'})",
        "def refuse(): raise BlockingIOError(11, 'no process more')\nos.fork = refuse",
        "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir('/proc/self/fd')) + 1,) * 2)",
    ],
)
def test_where_there_can_be_no_copy_there_is_none(preparation: str) -> None:
    code = """
before = sorted(os.listdir("/proc/self/fd"))
found = forked.fork(lambda: None, count)
print(found, sorted(os.listdir("/proc/self/fd")) == before, signal.pthread_sigmask(signal.SIG_BLOCK, ()), left())
"""
    assert run(f"{preparation}\n{code}") == ["None True set() none left"]
