"""Row 32: a fault a second, for hours. Asked for with ``--soak``."""

from __future__ import annotations

import subprocess
import sys
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


def soaked(bench: Bench) -> Measured:
    """Exit status of the soak: 0 = every law held; what it says is told."""
    words = [str(TESTS / "soak" / "soak.py"), "--hours", "2" if bench.full else "0.2"]
    code = f"import sys; sys.argv = {words!r}\n{INHERITING}"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True,
                          text=True, env=environment())
    return Measured(done.returncode, (done.stdout + done.stderr).strip()[-200:])


ROWS = (
    Row(32, "soak: a random fault each second", "no leak, no dead thread, sent = ok + lost", (
        case("elf", "2 h simulated", soaked, 0, "status", "ledger"),), soak=True),
)
