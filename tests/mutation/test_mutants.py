"""What `make mutants` tries: the choice is fixed, the picks fit the code, the verdict is strict."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from copy_of_tree import ANY, FAILURE, QUICK_MARKS, SLOWER, Copy, MutantVerdict
from cpp_mutants import cpp_mutants
from equivalent import EQUIVALENTS, equivalence
from mutant import Mutant, chosen, make_mutant
from mutation_run import GOAL, report
from picked import PICKS
from subjects import SUBJECTS

SUPERVISOR = "firmware/src/core/supervisor.cpp"


@pytest.mark.parametrize("pick", PICKS, ids=lambda p: p.name)
def test_a_picked_mutant_still_fits_the_code(pick):
    assert pick.mutant().file == pick.file
    assert pick.subject in {s.name for s in SUBJECTS}


@pytest.mark.parametrize("known", EQUIVALENTS, ids=lambda e: f"{e.file}: {e.before}")
def test_an_equivalent_mutant_still_fits_the_code_and_is_that_one_alone(known):
    assert known.occurrences() == 1
    assert len(known.reason) > 10
    mutant = Mutant(known.file, 1, "op", known.before, known.after, "")
    assert equivalence(mutant) == known.reason
    assert equivalence(replace(mutant, after="something else")) == ""
    assert equivalence(replace(mutant, file="another file")) == ""


@pytest.mark.parametrize("known", [e for e in EQUIVALENTS if e.file.endswith(".cpp")],
                         ids=lambda e: f"{e.file}: {e.before}")
def test_an_equivalent_mutant_of_cpp_is_one_that_is_made(known):
    assert sum(known.matches(mutant) for mutant in cpp_mutants(known.file)) == 1


def test_tests_and_files_of_each_subject_exist():
    root = Path(__file__).parents[2]
    for subject in SUBJECTS:
        for name in (*subject.files, *subject.tests):
            assert (root / name).exists(), name


def test_there_are_enough():
    assert sum(s.count for s in SUBJECTS) + len(PICKS) == 200


def test_the_choice_is_fixed_and_takes_a_line_once():
    made = list(cpp_mutants(SUPERVISOR))
    first = chosen(made, 12)
    again = chosen(reversed(made), 12)
    assert first == again
    assert len({m.line for m in first}) == 12


def test_a_line_added_elsewhere_leaves_the_choice():
    old = [make_mutant("a", "op", f"x\n{k}\n", f"x\n{k} changed\n") for k in range(20)]
    new = [make_mutant("a", "op", f"x\ny\n{k}\n", f"x\ny\n{k} changed\n") for k in range(20)]
    lines = {m.line for m in (*old, *new)}
    assert lines == {2, 3}
    assert chosen(old, 1)[0].after == chosen(new, 1)[0].after


def test_a_mutant_of_cpp_changes_one_line_and_no_comment():
    made = list(cpp_mutants(SUPERVISOR))
    assert {"== to !=", "|| to &&", "number + 1", "statement left out", "! left out"} <= \
        {m.operator for m in made}
    for mutant in made:
        assert not mutant.before.startswith(("//", "#", "static_assert"))


def test_a_mutant_of_python_means_something_else():
    pytest.importorskip("cosmic_ray", reason="cosmic-ray is not installed: make mutants brings it")
    from python_mutants import python_mutants

    made = list(python_mutants("host/dart_hal/wire/cobs.py"))
    assert {"AndWithOr", "Comparison_LtE_Lt", "Binary_Add_Sub"} <= {m.operator for m in made}
    for mutant in made:
        compile(mutant.text, mutant.file, "exec")


class ScriptedCopy(Copy):
    """A copy whose tests fail by ``failures``: (marks, broken) to what fails in this order."""

    def __init__(self, failures: dict[tuple[str, bool], list[str]]) -> None:
        self.home = Path(__file__).parents[2]
        self.failures = failures
        self.broken = False
        self._built, self._sound, self._excluded = True, set(), []

    @contextmanager
    def _apply(self, subject, mutant):
        self.broken = True
        yield ""
        self.broken = False

    def _run(self, tests, marks, skipped=()):
        remaining = self.failures.get((marks, self.broken), [])
        return remaining.pop(0) if remaining else ""


NOTICED = "tests/wire/test_crc.py::test_x"


@pytest.mark.parametrize(("failures", "killers"), [
    ({(QUICK_MARKS, True): [NOTICED]}, NOTICED),
    ({}, ""),
    ({(QUICK_MARKS, True): [NOTICED], (ANY, False): [NOTICED]}, ""),
    ({(SLOWER, True): [NOTICED], (ANY, True): [NOTICED]}, NOTICED),
    ({(SLOWER, True): [NOTICED]}, ""),
    ({(QUICK_MARKS, True): ["time limit"]}, "time limit"),
    ({(QUICK_MARKS, True): ["exit status -11"]}, "exit status -11"),
], ids=["killed", "survived", "fails anyway", "slower, twice", "slower, once", "hangs", "crashes"])
def test_a_kill_does_not_fail_without_the_mutant_and_a_slower_one_repeats(failures, killers,
                                                                          capsys):
    copy = ScriptedCopy(failures)
    verdict = copy.judge(SUBJECTS[0], Mutant("f.py", 1, "op", "a", "b", "b\n"))
    assert verdict.by == killers
    assert copy._excluded == ([] if killers or not failures else [NOTICED])
    assert ("excluded" in capsys.readouterr().out) == bool(copy._excluded)


def test_a_crash_without_the_mutant_ends_the_run():
    copy = ScriptedCopy({(QUICK_MARKS, True): ["exit status 4"],
                         (QUICK_MARKS, False): ["exit status 4"]})
    with pytest.raises(RuntimeError, match="exit status 4"):
        copy.judge(SUBJECTS[0], Mutant("f.py", 1, "op", "a", "b", "b\n"))


@pytest.mark.parametrize("name", ["tests/a.py::test_x", "tests/a.py::test_x[32-20 s, not refused]",
                                  "tests/a.py"])
def test_the_name_of_a_failed_test_is_read_with_its_spaces(name):
    for line in (f"FAILED {name}", f"ERROR {name} - ImportError: x - y"):
        assert FAILURE.search(f"....F\n{line}\n1 failed")[1] == name


@pytest.mark.parametrize(("killed", "broken", "status"), [(9, 0, 0), (8, 0, 1), (9, 5, 0)])
def test_below_the_goal_it_fails_and_what_does_not_compile_is_not_counted(killed, broken, status,
                                                                         capsys):
    assert GOAL == 0.90
    mutant = Mutant("f.cpp", 1, "op", "a", "b", "b\n")
    fates = ["test_x"] * killed + [""] * (10 - killed) + ["compiler"] * broken
    assert report([MutantVerdict(mutant, "guard", killers, 1.0) for killers in fates],
                  60.0) == status
    output = capsys.readouterr().out
    assert f"10 mutants, {killed} killed" in output
    assert output.count("SURVIVED") == 10 - killed
