"""The electrical check: the harness passes, and each documented way to break it is refused."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest

from tests.common import ROOT, WIRING

sys.path[:0] = [str(WIRING), str(ROOT / "hardware")]

pytest.importorskip("yaml")
import electrical  # noqa: E402 - found through the line above
import harness  # noqa: E402
import nets  # noqa: E402


def read_table() -> list[list[str]]:
    """(what, file, instead of, value, car, refusal) of the table on the hardware page."""
    text = (ROOT / "hardware" / "README.md").read_text(encoding="utf-8")
    table = text.split("| what is wrong | file |")[1].split("\n\n")[0].splitlines()[2:]
    return [[re.sub(r"^`|`$", "", cell) for cell in re.split(r" ?\| ", row.strip("|").strip(" "))]
            for row in table]


BROKEN = read_table()


def car_of(words: str) -> nets.Car:
    return nets.Car(tuple(word for word in words.split(" + ") if word != "minimal"))


def test_every_car_passes_with_every_supply_on_and_off():
    assert [str(fault) for fault in electrical.check()] == []


def test_every_option_every_computer_and_every_supply_is_among_them():
    cars = list(nets.Harness().cars())
    assert {o for car in cars for o in car.options} == set(harness.DIAGRAMS) - {"minimal"}
    assert {car.variant for car in cars} == set(nets.Harness().facts["variants"])
    words = [word for word, _ in electrical.states(car_of("minimal"), nets.Harness())]
    assert len(words) == len(set(words)) == 8
    assert sum("cable out" in word for word in words) == 4


@pytest.mark.parametrize(("file", "old", "new", "car", "refusal"), [row[1:] for row in BROKEN],
                         ids=[row[0] for row in BROKEN])
def test_a_documented_fault_is_refused_by_name(copy, file, old, new, car, refusal):
    before = electrical.judge(car_of(car), nets.Harness())
    assert before == []
    faults = electrical.judge(car_of(car), nets.Harness(copy(file, old, new)))
    assert any(str(fault).startswith(refusal) for fault in faults), [str(f) for f in faults]
    assert all(fault.case.startswith("minimal") and fault.expected for fault in faults)


def test_there_is_a_control_for_every_rule():
    assert {row[5].split(":")[0] for row in BROKEN} == {*electrical.RULES, electrical.NEVER}
    assert len(BROKEN) >= 10


def test_the_state_of_the_supplies_is_part_of_the_case(copy):
    """1 kOhm at S matters only while the Nano is on and the chip's supply is off."""
    folder = copy("parts.yml", "[lead 1, 1], [lead 2, 2], ", "[lead 2, 2], ")
    faults = electrical.judge(car_of("cutoff_mux"), nets.Harness(folder))
    assert [f.case for f in faults] == ["minimal + cutoff_mux; ESC off, board on"]


@pytest.mark.parametrize(("old", "new", "message"), [
    ("NANO D4: &feed {kind: source", "NANO D4: &feed {kind: sauce",
     r"NANO D4: .*'sauce'.*expected one of ground"),
    ("amps: 0.02}  # measured", "ampere: 0.02}  # measured", "IR VCC: .*'ampere'"),
    ("takes: [2.7, 24]", "takes: [24, 2.7]", r"HALL VCC: .*\[least, most\]"),
])
def test_an_impossible_fact_names_the_place(copy, old, new, message):
    with pytest.raises(harness.WiringError, match=message):
        nets.Harness(copy("electrical.yml", old, new))


WITHOUT = {
    "the board feeds V+ and so does the ESC": "red wire of the ESC lifted",
    "1 kOhm at S left out": "smallest",  # one switch for Nano and chip: never one without the other
    "a BEC of 6 V at the multiplexer": "BEC gives 6 V",  # this car has bec_5v
    "the receiver on the BEC: it drives a Nano without supply": "^(?!.*cutoff).*smallest",
    "the divider's thin wire on the battery, 20 kOhm at its other end": "smallest",  # no fuse
    "battery and Nano without a ground in common": "cutoff_mux|smallest",  # joined by another wire
    "the fuse left out": "smallest",  # it has no LiPo
    "a fuse of 40 A": "smallest",
    "the 5 V wires lifted out of the plug that feeds the Jetson Nano": "pi5|orin|desk",
}
"""Fault -> cars that are built with it and right: they have no such part, or another supply."""


@pytest.mark.slow
@pytest.mark.parametrize(("what", "file", "old", "new", "car", "refusal"), BROKEN,
                         ids=[row[0] for row in BROKEN])
def test_a_fault_is_refused_in_every_car_that_has_it(copy, what, file, old, new, car, refusal):
    """Every option, computer and other measurement; a control for each rule in each car."""
    broken = nets.Harness(copy(file, old, new))
    rule = refusal.split(":")[0]
    cars = [c for c in broken.cars() if set(car_of(car).options) <= set(c.options)]
    right = [c for c in cars if what in WITHOUT and re.search(WITHOUT[what], str(c))]
    refused = [c for c in cars if any(f.rule == rule for f in electrical.judge(c, broken))]
    assert len(refused) >= 36
    assert set(cars) - set(refused) == set(right)


@pytest.mark.slow
def test_nothing_is_drawn_from_a_harness_with_a_fault(tmp_path):
    """The whole tree, for the builder writes into its folder and into the pages."""
    shutil.copytree(ROOT / "hardware", tmp_path / "hardware",
                    ignore=shutil.ignore_patterns("__*", "stl", "pictures"))
    shutil.copytree(ROOT / "docs" / "build_guide", tmp_path / "docs" / "build_guide")
    wiring = tmp_path / "hardware" / "wiring"
    path = wiring / "parts.yml"
    path.write_text(path.read_text(encoding="utf-8").replace("[1, 8], [2, 8], ", "[1, 8], "),
                    encoding="utf-8")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    done = subprocess.run([sys.executable, "-B", str(wiring / "build.py")], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("FLOATING: MUX 2: nothing holds it")
    assert done.stderr.endswith("nothing was written\n")
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
