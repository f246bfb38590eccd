"""Threads of one process: what they compute is what one after another computes."""

from __future__ import annotations

import json
import subprocess
import sys
import threading

import pytest

import kiteocp
from kiteocp import execution

PROGRAM = """
import json, sys, threading, kiteocp
call = getattr(kiteocp, sys.argv[1])
problem = kiteocp.load_problem("v3-kite")
variants = [problem.with_values({"kite.mass_kg": mass}) for mass in (20.0, 22.0, 24.0, 26.0)]
power = lambda variant: call(variant).cycle["mean_power_W"]
found = {}
def work(index):
    for turn in range(int(sys.argv[2])):
        found.setdefault(index, set()).add(power(variants[index]))
threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(json.dumps([[sorted(found[index]), power(variants[index])] for index in range(4)]))
"""


@pytest.mark.parametrize(("verb", "turns"), [("solve", 2), ("simulate", 20)])
def test_four_threads_compute_what_one_does(verb: str, turns: int) -> None:
    # A process of its own: a crash of the interpreter would end the tests.
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, verb, str(turns)], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    for in_threads, alone in json.loads(done.stdout):
        assert in_threads == [alone]


CALCULATIONS = (
    "crosswind", "estimate", "export_schedule", "flight_state", "representative_course", "sensitivities", "simulate",
    "simulate_batch", "solve", "solve_many", "validate_flight", "validate_paper",
)  # fmt: skip


@pytest.mark.parametrize("name", CALCULATIONS)
def test_every_calculation_waits_for_its_turn(name: str) -> None:
    ended = threading.Event()

    def call() -> None:
        try:
            getattr(kiteocp, name)()
        except TypeError:  # it got its turn, and no arguments
            ended.set()

    # `validate_paper` takes none and would compute.
    if name == "validate_paper":
        assert hasattr(kiteocp.validate_paper, "__wrapped__")
        return
    with execution._turn:
        thread = threading.Thread(target=call)
        thread.start()
        assert not ended.wait(0.05)
    thread.join(20)
    assert ended.is_set()


def test_every_public_function_is_a_calculation_or_needs_none() -> None:
    functions = {name for name in kiteocp.__all__ if type(getattr(kiteocp, name)).__name__ == "function"}
    assert functions - set(CALCULATIONS) == {"load_flight", "load_problem", "load_result", "shipped_problems"}
