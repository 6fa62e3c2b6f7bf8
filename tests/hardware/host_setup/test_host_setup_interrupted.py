"""The set-up killed on its way: nothing is half, and the next run ends it."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path

import pytest
from setup_box import Box, list_announced
from setup_laws import nothing_half

Change = tuple[str, str, str]
"""File, old text, new text: how a control breaks the script."""


def interrupt_and_rerun(folder: Path, whole: dict[str, str], call: int,
                        broken: Change | None) -> None:
    """Kill -9 at the call ``at``, look, and run again."""
    shutil.rmtree(folder)
    box = Box(folder)
    if broken:
        box.change(*broken)
    cut = box.run(KILL_AT=str(call))
    assert cut.returncode == -signal.SIGKILL
    nothing_half(box, whole)
    done = box.run()
    assert done.returncode == 0, done.stderr + done.stdout
    assert box.tree() == whole, f"killed at call {call}"
    output = list_announced(cut.stdout) + list_announced(done.stdout)
    for file, text in (("80-dart.rules", "$ sudo udevadm settle --timeout=10"),
                       ("dart-hal.service", "$ sudo systemctl enable dart-hal.service")):
        written = max(i for i, line in enumerate(output) if line.endswith(file))
        assert text in output[written:], f"killed at call {call}: {file} is written, not announced"


def every(step: int, folder: Path, first: int = 1, broken: Change | None = None) -> int:
    """Interrupt at every ``step``-th call; how many interruptions there were."""
    box = Box(folder)
    if broken:
        box.change(*broken)
    box.run()
    calls = len(box.calls)
    whole = box.tree()
    cuts = range(first, calls + 1, step)
    for call in cuts:
        interrupt_and_rerun(folder, whole, call, broken)
    return len(cuts)


@pytest.mark.slow
def test_killed_on_the_way_it_leaves_nothing_half_and_the_next_run_ends_it(tmp_path: Path) -> None:
    assert every(23, tmp_path / "box", first=25) >= 3


@pytest.mark.long
def test_killed_at_any_call_of_all(tmp_path: Path) -> None:
    assert every(1, tmp_path / "box") > 80


@pytest.mark.long
@pytest.mark.parametrize("broken", [
    ("lib.sh", ': >"$state/todo.$1"', ":"),
    ("environment.sh", '        in_home pip install',
     '        run touch "$venv/.complete"\n        in_home pip install'),
], ids=["a mark that does not outlive the run", "complete before it is"])
def test_a_script_that_minds_being_killed_is_found_out(broken: Change, tmp_path: Path) -> None:
    with pytest.raises((AssertionError, ValueError)):
        every(1, tmp_path / "box", first=20, broken=broken)
