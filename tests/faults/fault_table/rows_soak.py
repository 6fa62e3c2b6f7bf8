"""Row 32: a random fault each second. `make soak` has the hours."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from fault_table.bench import Bench
from fault_table.row import Measured, Row, case
from fault_table.stand import environment

TESTS = Path(__file__).resolve().parents[2]


INHERITING = """
import runpy, sys
from fault_table import table
from fault_table.layers import inherit
with inherit():
    runpy.run_path(sys.argv[0], run_name="__main__")
"""


def run_soak(nano: str, minutes: float) -> Callable[[Bench], Measured]:
    """Laws that the soak found broken: its exit status, 0 = every law held."""
    def measure(bench: Bench) -> Measured:
        words = [str(TESTS / "soak" / "soak.py"), "--nano", nano, "--hours", str(minutes / 60)]
        code = f"import sys; sys.argv = {words!r}\n{INHERITING}"
        done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True,
                              text=True, env=environment())
        return Measured(done.returncode, (done.stdout + done.stderr).strip()[-200:])
    return measure


ROWS = (
    Row(32, "soak: a random fault each second", "no leak, no dead thread, sent = ok + lost", (
        case("mock", "20 s simulated", run_soak("mock", 1 / 3), 0, "status", "ledger", fast=True),
        case("elf", "6 min simulated", run_soak("avr", 6.0), 0, "status", "ledger"),
    )),
)
