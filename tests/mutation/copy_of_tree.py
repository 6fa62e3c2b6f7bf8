"""A private copy of the checkout in which one mutant at a time is tested."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mutant import CHECKOUT, Mutant
from subjects import WIDE, Subject

NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv*", ".hypothesis", ".*_cache", "__pycache__")
NO_VERDICT = ("tests/firmware/test_nano_budgets.py", "tests/mutation")
"""Sizes, cycles and the committed image: any change at all fails these, which is no verdict."""
QUICK_MARKS = "not (slow or long or realtime)"
SLOWER = "(slow or realtime) and not long"
"""Marks of the tests of `make test`, and of those of `make test-more`."""
ANY = "not long"
TEST_LIMIT = {QUICK_MARKS: 120.0, SLOWER: 300.0}
"""s of one test until it counts as hung. A quick one takes a few CPU s, the longest of the
slower ones 60; a busy machine takes five times that, and some quick ones compile first."""
PASS_LIMIT = 1800.0
"""s of one pytest run until it counts as hung: a mutant can also hang while tests are collected.
The longest selection takes 300 CPU s."""
HUNG = "time limit"
FAILURE = re.compile(r"^(?:FAILED|ERROR) (\S+?\.py(?:::\w+)*(?:\[.*?\])?)(?: - |$)", re.MULTILINE)
"""The line of pytest's summary that names a test; a case's name may contain spaces."""
MARK = "DART_HAL_MUTANT"


@dataclass(frozen=True, slots=True)
class MutantVerdict:
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
    """One private copy of the checkout in the folder ``home``; ``close`` removes it."""

    def __init__(self, home: Path) -> None:
        self.home = home
        shutil.copytree(CHECKOUT, home, ignore=NOT_COPIED, symlinks=True)
        self._built = True
        self._sound: set[str] = set()
        self._excluded: list[str] = []
        self._build("emulator")

    def judge(self, subject: Subject, mutant: Mutant, widely: bool = True) -> MutantVerdict:
        """Apply the mutant, run the tests that can notice it, restore the file.

        Raises RuntimeError if pytest crashes without the mutant.

        1. The quick tests of the subject: its files, then its folders, which take long to collect.
        2. If ``widely``, for a survivor: the quick tests of ``WIDE``, then the slower ones of
           the subject.
        3. A test counts as a kill only if it passes without the mutant (tried once for each
           test); a slower one must also fail again with it, because it may depend on time. A
           test that does not hold to this is reported, excluded, and the selection runs again.
        """
        begin = time.monotonic()
        own = self._existing(subject.tests)
        files = tuple(t for t in own if t.endswith(".py"))
        folders = self._existing(own, files)
        first = ANY if subject.realtime else QUICK_MARKS
        selections = [(t, s, marks) for t, s, marks in (
            (files, (), first), (folders, files, QUICK_MARKS)) if t]
        if widely:
            selections += [(self._existing(WIDE, own), own, QUICK_MARKS), (own, (), SLOWER)]
        for tests, skipped, marks in selections:
            by = HUNG
            while by:
                with self._apply(subject, mutant) as broken:
                    by = broken or self._run(tests, marks, skipped)
                    again = by if broken or marks == QUICK_MARKS else self._repeat(by)
                if broken or (again and self._is_sound(by, tests, marks, skipped)):
                    return MutantVerdict(mutant, subject.name, by, time.monotonic() - begin)
                if by and ".py" not in by:
                    raise RuntimeError(f"without any mutant: {by} of {' '.join(tests)}")
                if by:
                    print(f"excluded, its failure does not depend on the mutant: {by}", flush=True)
                    self._excluded.append(by)
        return MutantVerdict(mutant, subject.name, "", time.monotonic() - begin)

    def close(self) -> None:
        """Remove the copy."""
        shutil.rmtree(self.home, ignore_errors=True)

    @contextmanager
    def _apply(self, subject: Subject, mutant: Mutant) -> Iterator[str]:
        """Break the copy for a while; yields "compiler" if the firmware does not compile."""
        path = self.home / mutant.file
        original = path.read_bytes()
        path.write_text(mutant.text, encoding="utf-8")
        try:
            yield self._build() if subject.firmware or not self._built else ""
        finally:
            path.write_bytes(original)
            self._built = self._built and not subject.firmware

    def _repeat(self, failure: str) -> str:
        """Run the one test that failed again; "" when it passes now."""
        return self._run((failure,), ANY) if ".py" in failure else failure

    def _is_sound(self, failure: str, tests: tuple[str, ...], marks: str,
                  skipped: tuple[str, ...]) -> bool:
        """Whether the test that failed passes without a mutant; tried once for each test.

        A crash names no test: then the whole selection must pass.
        """
        if failure == HUNG or failure in self._sound:
            return True
        if not self._built:
            self._build()
        named = ".py" in failure
        if self._run((failure,), ANY) if named else self._run(tests, marks, skipped):
            return False
        if named:
            self._sound.add(failure)
        return True

    def _existing(self, tests: tuple[str, ...], excluded: tuple[str, ...] = ()) -> tuple[str, ...]:
        return tuple(t for t in tests if t not in excluded and (self.home / t).exists())

    def _build(self, *more: str) -> str:
        """Firmware image and native core as the sources are; "compiler" if that fails."""
        command = ["make", "-s", "-C", str(self.home / "firmware"), "WARN=-w", "hex", "native",
                   *more]
        done = subprocess.run(command, capture_output=True, check=False)
        self._built = True
        return "compiler" if done.returncode else ""

    def _run(self, tests: tuple[str, ...], marks: str, skipped: tuple[str, ...] = ()) -> str:
        """The first test that fails, "time limit", or "" when all pass."""
        options = [*(f"--ignore={t}" for t in (*NO_VERDICT, *skipped)),
                   *(f"--deselect={t}" for t in self._excluded)]
        limit = TEST_LIMIT.get(marks, TEST_LIMIT[SLOWER])
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", marks, "--tb=no",
                   "-o", f"faulthandler_timeout={limit}",
                   "-o", "faulthandler_exit_on_timeout=true",
                   "--no-header", "-p", "no:cacheprovider", "--hypothesis-seed=0", *options,
                   *tests]
        environment = os.environ | {"PYTHONPATH": str(self.home / "host"), MARK: str(self.home),
                                    "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.Popen(command, cwd=self.home, env=environment, text=True,
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, start_new_session=True)
        try:
            output, _ = run.communicate(timeout=PASS_LIMIT)
        except subprocess.TimeoutExpired:
            run.kill()
            run.communicate()
            return HUNG
        finally:
            self._end_children()
        if run.returncode in (0, 5):          # 5: every test is excluded or has another mark
            return ""
        if "Timeout (" in output:
            return HUNG
        failure = FAILURE.search(output)
        return failure[1] if failure else f"exit status {run.returncode}"

    def _end_children(self) -> None:
        """End processes that the tests of this copy have started, known by a mark."""
        mark = f"{MARK}={self.home}".encode()
        for entry in Path("/proc").glob("[0-9]*/environ"):
            try:
                if mark in entry.read_bytes().split(b"\0"):
                    os.kill(int(entry.parent.name), signal.SIGKILL)
            except OSError:
                continue
