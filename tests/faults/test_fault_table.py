"""Every case of the fault table keeps its limit, and breaks it without its layer."""

from __future__ import annotations

import math
from fnmatch import fnmatchcase

import pytest
from fault_table.broken import FIRMWARE_FOLDER
from fault_table.judge import How, Verdict, judge
from fault_table.layers import VARIABLE, remove_layers
from fault_table.row import Case, Measured, Row
from fault_table.table import LAYERS, ROWS

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge


def parameters(fast: bool):
    for row in ROWS:
        for case in row.cases:
            if case.fast is fast:
                marks = [pytest.mark.emulator] if case.world == "elf" else []
                marks += [] if fast else [pytest.mark.long]
                yield pytest.param(case, marks=marks,
                                   id=f"{row.number}-{case.world}-{case.what}")


QUICK_CASES = ("1-wire-* lost", "2-wire-not counted", "4-mock*", "7-wire*", "10-wire*",
               "12-elf-freed",
               "18-mock-dead, throttle*", "19-wire*", "22-mock*", "24-mock*", "25-mock-oe",
               "26-mock*",
               "36-mock*", "40-mock*", "41-mock*", "45-mock-mux*", "51-mock*", "55-mock-27 MHz",
               "56-mock-after close()", "58-mock*", "59-mock*", "61-mock*")
"""With their controls: one each of line, board, bus, guard, owner, cut-off, power and human
input. The controls of the others are for ``make test-more``."""
UNCONTROLLED_CASES = (
    "3-mock-distance", "8-mock-none, mux", "11-elf*", "13-elf-SCL*", "14-elf-standing",
    "15-elf-stuck", "16-elf*", "17-mock-10 k*", "20-elf*", "27-mock-prescale",
    "29-mock-wild speeds", "31-elf*", "33-elf-mux", "43-elf-mux*", "46-mock*")
"""Without their controls, where another than the first fast case represents a row."""
REALTIME = ("6-pty*",)
"""Cases with real processes, without their controls."""
BY_NAME = {f"{row.number}-{case.world}-{case.what}": case for row in ROWS for case in row.cases}


def check(case: Case, full: bool, controls: bool = True) -> None:
    if case.world == "elf":
        try:
            bridge.load()
        except EmulatorMissing as error:
            pytest.skip(f"emulator: {error.what}")
    verdict = judge(case, How(full=full, controls=controls))
    assert verdict.holds, verdict.measured
    assert verdict.proves, verdict.control


@pytest.mark.parametrize("case", list(parameters(fast=True)))
@pytest.mark.slow_except(*QUICK_CASES)
def test_a_case_holds_and_its_control_does_not(case):
    check(case, full=False)


def find_cases(*patterns):
    """Names of cases that fit one of the patterns."""
    return [name for name in BY_NAME if any(fnmatchcase(name, p) for p in patterns)]


def one_of_every_row():
    """Names of one case of each row that QUICK and REALTIME leave out."""
    chosen = {number_of(name): name for name in find_cases(*UNCONTROLLED_CASES)}
    for name in BY_NAME:
        if BY_NAME[name].fast:
            chosen.setdefault(number_of(name), name)
    have = {number_of(name) for name in find_cases(*QUICK_CASES, *REALTIME)}
    return [name for number, name in sorted(chosen.items()) if number not in have]


def number_of(name):
    return int(name.partition("-")[0])


def alone(names):
    for name in names:
        marks = [pytest.mark.emulator] if BY_NAME[name].world == "elf" else []
        yield pytest.param(BY_NAME[name], marks=marks, id=name)


@pytest.mark.parametrize("case", list(alone(one_of_every_row())))
def test_one_case_of_every_other_row_holds(case):
    check(case, full=False, controls=False)


@pytest.mark.realtime
@pytest.mark.parametrize("case", list(alone(find_cases(*REALTIME))))
def test_one_case_of_every_other_row_holds_in_real_time(case):
    check(case, full=False, controls=False)


def test_every_row_has_a_case_in_the_quick_run():
    """A row without a fast case has to name one in ALONE or REALTIME."""
    quick = {number_of(name) for name in (*find_cases(*QUICK_CASES, *REALTIME),
                                          *one_of_every_row())}
    assert {row.number for row in ROWS} - quick == set()
    assert [p for p in (*QUICK_CASES, *UNCONTROLLED_CASES, *REALTIME) if not find_cases(p)] == []


@pytest.mark.parametrize("case", list(parameters(fast=False)))
def test_the_other_cases_hold_and_their_controls_do_not(case):
    check(case, full=True)


def test_every_case_has_a_control_of_known_layers():
    assert [(row.number, case.what) for row in ROWS for case in row.cases
            if not case.control] == []
    assert {name for row in ROWS for case in row.cases for name in case.control} <= set(LAYERS)


def test_every_layer_alone_turns_a_row_red():
    alone = {case.control[0] for row in ROWS for case in row.cases if len(case.control) == 1}
    assert set(LAYERS) - alone == set()


@pytest.mark.parametrize("layer", [x for x in LAYERS.values() if x.changes], ids=lambda x: x.name)
def test_what_removes_a_layer_of_the_firmware_is_in_its_sources(layer):
    for file, old, new in layer.changes:
        assert (FIRMWARE_FOLDER / file).read_text(encoding="utf-8").count(old) == 1, old
        assert old != new


def test_numbers_are_unique_and_the_first_33_are_there():
    numbers = [row.number for row in ROWS]
    assert numbers == sorted(set(numbers))
    assert set(range(1, 34)) - set(numbers) == set()


def test_a_layer_comes_back():
    from dart_hal.wire import decoder

    before = decoder.Gates.passes
    with remove_layers("frame_gates"):
        assert before is not decoder.Gates.passes
    assert before is decoder.Gates.passes


def test_children_know_which_layers_are_removed():
    import os

    with remove_layers("link_stale"), remove_layers("expiry"):
        assert os.environ[VARIABLE] == "link_stale,expiry"
    assert VARIABLE not in os.environ


def test_what_breaks_down_is_neither_green_nor_a_proof():
    good = Measured(1.0)
    bad = Measured(3.0)
    nan = Measured(math.nan)
    case = Case("wire", "", lambda bench: good, 2.0, "s", ("crc",))
    assert Verdict(case, good, bad, 0.0).is_green
    assert not Verdict(case, good, good, 0.0).is_green
    assert not Verdict(case, bad, bad, 0.0).is_green
    assert not Verdict(case, nan, bad, 0.0).is_green
    assert not Verdict(case, good, nan, 0.0).is_green


def test_a_row_is_printed_with_its_figures(capsys):
    from fault_table.show import line

    case = Case("wire", "what", lambda bench: Measured(1.0), 2.0, "ms", ("crc",))
    line(Row(1, "fault", "reaction", (case,)), Verdict(case, Measured(1.5), Measured(9.0), 0.0))
    assert "1.5 ms" in capsys.readouterr().out
