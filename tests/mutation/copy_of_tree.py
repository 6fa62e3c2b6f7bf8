"""A private copy of the checkout in which one mutant at a time is tested."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from mutant import ROOT, Mutant
from subjects import WIDE, Subject

NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv*", ".hypothesis", ".*_cache", "__pycache__")
NOT_ITS_TASK = ("tests/firmware/test_nano_budgets.py", "tests/mutation")
"""Sizes, cycles and the committed image: any change at all fails these, which is no verdict."""
HUNG = 300.0
"""s of one test: the longest, the whole demo, takes 60 of the processor, and a busy machine five
times that. A mutant that makes a test wait for ever."""
ENDLESS = 8.0
"""A room that takes this many times as long as without a mutant hangs: other work of the
machine slows it by two or three."""
MARK = "DART_HAL_MUTANT"
QUICK, ALL = "not (slow or more or realtime)", "not slow"
"""Marks of the tests that are tried first, and of those that a survivor of them meets."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """``by``: the test that failed, ``time limit``, ``compiler``; "" = survived. Time in s."""

    mutant: Mutant
    subject: str
    by: str
    seconds: float

    @property
    def counts(self) -> bool:
        """Whether it is a mutant at all: what does not compile is none."""
        return self.by != "compiler"


class Copy:
    """``home``: where it lies; removed by ``close``."""

    def __init__(self, home: Path) -> None:
        self.home, self._usual = home, dict[tuple[tuple[str, ...], str], float]()
        shutil.copytree(ROOT, home, ignore=NOT_COPIED, symlinks=True)
        self._built, self._left_out = True, list[str]()
        self._build("emulator")

    def usual(self, tests: tuple[str, ...], marks: str) -> float:
        """s that these tests take unchanged; those that fail even so are told and left out."""
        if (tests, marks) not in self._usual:
            if not self._built:
                self._build()
            begin = time.monotonic()
            while (by := self._tests(tests, None, marks)) and "::" in by:
                print(f"left out, fails without any mutant: {by}", flush=True)
                self._left_out.append(by)
                begin = time.monotonic()
            if by:
                raise RuntimeError(f"without any mutant: {by}")
            self._usual[tests, marks] = time.monotonic() - begin
        return self._usual[tests, marks]

    def judge(self, subject: Subject, mutant: Mutant, widely: bool = True) -> Verdict:
        """Apply, test in the room, if wished widely what survives there, take back."""
        room = self._there(subject.room)
        limits = {marks: ENDLESS * self.usual(room, marks) + 20.0 for marks in (QUICK, ALL)}
        begin = time.monotonic()
        path = self.home / mutant.file
        original = path.read_bytes()
        path.write_text(mutant.text, encoding="utf-8")
        try:
            by = self._build() if subject.firmware or not self._built else ""
            for marks, limit in limits.items():     # most die in the quick ones
                by = by or self._tests(room, limit, marks)
            if widely and not by and (by := self._tests(self._there(WIDE), None, ALL)):
                path.write_bytes(original)
                self._built = self._built and not subject.firmware
                known = len(self._left_out)
                self.usual((by,), ALL)
                if len(self._left_out) > known:     # it fails anyway: that was no kill
                    return self.judge(subject, mutant)
        finally:
            path.write_bytes(original)
            self._built = self._built and not subject.firmware
        return Verdict(mutant, subject.name, by, time.monotonic() - begin)

    def close(self) -> None:
        shutil.rmtree(self.home, ignore_errors=True)

    def _there(self, tests: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(t for t in tests if (self.home / t).exists())

    def _build(self, *more: str) -> str:
        """Firmware image and native core as the sources are; "compiler" if that fails."""
        command = ["make", "-s", "-C", str(self.home / "firmware"), "WARN=-w", "hex", "native",
                   *more]
        done = subprocess.run(command, capture_output=True, check=False)
        self._built = True
        return "compiler" if done.returncode else ""

    def _tests(self, tests: tuple[str, ...], limit: float | None, marks: str) -> str:
        """The first test that fails, "time limit", or "" when all pass."""
        without = [*(f"--ignore={t}" for t in NOT_ITS_TASK),
                   *(f"--deselect={t}" for t in self._left_out)]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", marks, "--tb=no",
                   "-o", f"faulthandler_timeout={HUNG}", "-o", "faulthandler_exit_on_timeout=true",
                   "--no-header", "-p", "no:cacheprovider", "--hypothesis-seed=0", *without,
                   *tests]
        environment = os.environ | {"PYTHONPATH": str(self.home / "host"), MARK: str(self.home),
                                    "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.Popen(command, cwd=self.home, env=environment, text=True,
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, start_new_session=True)
        try:
            said, _ = run.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            run.kill()
            run.communicate()
            return "time limit"
        finally:
            self._end_what_is_left()
        if run.returncode in (0, 5):          # 5: all there were are left out
            return ""
        if "Timeout (" in said:
            return "time limit"
        found = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
        return found[1] if found else f"exit status {run.returncode}"

    def _end_what_is_left(self) -> None:
        """Processes of this copy's tests that a mutant has left behind, known by a mark."""
        mark = f"{MARK}={self.home}".encode()
        for entry in Path("/proc").glob("[0-9]*/environ"):
            try:
                if mark in entry.read_bytes().split(b"\0"):
                    os.kill(int(entry.parent.name), signal.SIGKILL)
            except OSError:
                continue
