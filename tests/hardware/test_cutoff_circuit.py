"""The cut-offs' circuits: safe with each wire low, off, or with a chip without supply.

Judged from the harness as data, and wiring, bill, guide and safety page against each other. Each
checker sees the fault that it is there for.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.common import ROOT, WIRING

sys.path[:0] = [str(WIRING), str(ROOT / "hardware")]

yaml = pytest.importorskip("yaml")
import bom_table  # noqa: E402 - found through the line above
import circuit  # noqa: E402
import guide  # noqa: E402
import harness  # noqa: E402

SHEET = ["S", "1I0", "1I1", "1Y", "2I0", "2I1", "2Y", "GND",
         "3Y", "3I1", "3I0", "4Y", "4I1", "4I0", "/E", "VCC"]
"""Pins 1 to 16 of a 74HCT157 by its data sheet."""
GROUND = {"MUX": "8", "L3": "GND"}
SUPPLY = {"MUX": "16", "L3": "VDD"}
STEPS = {"MUX": "W09", "L3": "W10"}
DIAGRAM = {"MUX": "cutoff_mux", "L3": "cutoff_oe"}
HCT_HIGH = 2.0
WEAKEST = 3.3
"""V that an HCT input takes for a high, and the least that a board gives."""
PCA_HIGH = 0.7
USUAL_PULL = 10e3
"""Share of VDD that the PCA9685 takes for a high; Ohm by which many boards pull /OE low."""
CLAMP = 0.02
NANO = 5.0
"""A that an input's clamp takes, V of the Nano."""
SAFETY_PAGE = ROOT / "docs" / "explanation" / "safety.md"


def inputs(device: str) -> list[str]:
    """CMOS inputs of the chip."""
    if device == "L3":
        return ["gate"]
    return [str(n) for n, name in enumerate(SHEET, 1) if re.fullmatch(r"S|/E|\dI\d", name)]


def ohms(value: str) -> float:
    number, unit = value.split()
    return float(number) * {"Ohm": 1.0, "kOhm": 1e3, "nF": float("inf")}[unit]


def resistance(folder: Path, device: str, a: str, b: str) -> float:
    """Ohm of one component or bare wire from ``a`` to ``b``; infinite if there is none."""
    wired = circuit.joined(device, folder)
    if b in wired.get(a, []) or a in wired.get(b, []):
        return 0.0
    return min((ohms(c.value) for c in circuit.components(device, folder)
                if set(c.ends) == {a, b}), default=float("inf"))


def floating(folder: Path, device: str) -> list[str]:
    """Inputs that nothing holds low while every wire is off."""
    return [pin for pin in inputs(device)
            if resistance(folder, device, pin, GROUND[device]) > 10e3]


def bare(folder: Path, device: str) -> list[str]:
    """Pins of the Nano that meet the chip without 1 kOhm, which keeps a clamp below its limit."""
    wrong = []
    for wire in harness.wires(DIAGRAM[device], folder):
        pin = wire.pin_at("NANO")
        here = wire.pin_at(device)
        if pin is None or here is None or pin.startswith("GND"):
            continue
        at = here.split(" ")[0]
        series = resistance(folder, device, f"lead {at}", at)
        if series == float("inf") or NANO / series > CLAMP:
            wrong.append(pin)
    return wrong


def without_ground(folder: Path) -> list[str]:
    """Cut-offs to which no wire leads from a ground of the Nano."""
    return [device for device, diagram in DIAGRAM.items()
            if not any((wire.pin_at("NANO") or "").startswith("GND")
                       and (wire.pin_at(device) or "").split(" ")[0] == GROUND[device]
                       for wire in harness.wires(diagram, folder))]


def find_miscounted(folder: Path, rows: list[bom_table.Row]) -> list[str]:
    """Components of a board that the bill has in another number, with another value or step."""
    bill = {r.id: r for r in rows}
    wrong = []
    for device in DIAGRAM:
        found = circuit.components(device, folder)
        for part, value in {(c.part, c.value) for c in found}:
            row = bill[part]
            needed = sum(c.part == part for c in found)
            if row.quantity != needed or value not in row.part or STEPS[device] not in row.used_in:
                wrong.append(f"{part}: {needed} of {value} in {STEPS[device]}, bill {row.quantity} "
                             f"of {row.part} in {', '.join(row.used_in)}")
    return wrong


def lead(folder: Path, pin: str, label: str) -> str:
    """What an input of the multiplexer sees of a wire that is high, low, pulse or off."""
    if label != "off":
        return label
    return "low" if resistance(folder, "MUX", pin, "8") <= 10e3 else "undefined"


def esc_gets(folder: Path, d5: str, d9: str, channel: str, supply: str) -> str:
    """By the circuit: the words of the safety page."""
    if supply == "off":
        return "nothing"
    select = lead(folder, "1", d5)
    if select == "undefined":
        return "undefined"
    shown = lead(folder, "3", channel) if select == "high" else lead(folder, "2", d9)
    own = "pulse of the PCA9685" if select == "high" else "own neutral"
    return {"pulse": own, "low": "nothing"}.get(shown, "undefined")


def oe(folder: Path, d6: str) -> str:
    """Level of /OE with a board that pulls it low as many do."""
    if d6 == "off" and resistance(folder, "L3", "gate", "GND") > 10e3:
        return "undefined"
    if d6 == "high":
        return "low"
    share = USUAL_PULL / (USUAL_PULL + resistance(folder, "L3", "drain", "VDD"))
    return "high" if share >= PCA_HIGH else "undefined"


def cases(text: str, head: str) -> list[list[str]]:
    """Rows of the table of the safety page that begins with ``head``."""
    table = text.split(head)[1].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table]


L4_HEAD = "| what happens, L4 |"
L3_HEAD = "| what happens, L3 |"


def test_the_pins_are_those_of_the_data_sheet():
    assert list(circuit.names("MUX").values()) == SHEET
    entry = harness.parts()["connectors"]["MUX"]
    for pin, label in zip(entry["pins"], entry["pinlabels"], strict=True):
        assert label.split(" by")[0] == SHEET[pin - 1]


@pytest.mark.parametrize("device", list(DIAGRAM))
def test_no_input_floats_with_any_wire_off(device):
    assert floating(WIRING, device) == []


@pytest.mark.parametrize(("device", "old", "new", "finding"), [
    ("MUX", "[1, 8], [2, 8], ", "[1, 8], ", ["2"]),
    ("MUX", "[[1, 8], [2, 8]", "[[2, 8]", ["1"]),
    ("MUX", "[2, 8]", "[2, 16]", ["2"]),
    ("MUX", "joined: {8: [5, 10, 11, 13, 14, 15]}", "joined: {8: [5, 10, 11, 13, 14]}", ["15"]),
    ("L3", "[[gate, GND]]", "[[lead gate, GND]]", ["gate"]),
])
def test_a_missing_pull_down_is_detected(copy, device, old, new, finding):
    assert floating(copy("parts.yml", old, new), device) == finding


@pytest.mark.parametrize("device", list(DIAGRAM))
def test_a_resistor_lies_between_every_pin_of_the_nano_and_the_chip(device):
    assert bare(WIRING, device) == []


@pytest.mark.parametrize(("device", "old", "new", "finding"), [
    ("MUX", "[lead 1, 1], [lead 2, 2], ", "[lead 1, 1], ", ["D9"]),
    ("MUX", ", [lead 7, 7]", "", ["D8"]),
    ("MUX", "res_1k_mux: {value: 1 kOhm", "res_1k_mux: {value: 100 Ohm", ["D9", "D5", "D8"]),
    ("L3", "[lead gate, gate], ", "", ["D6"]),
])
def test_a_missing_series_resistor_is_detected(copy, device, old, new, finding):
    folder = copy("parts.yml", old, new)
    assert sorted(bare(folder, device)) == sorted(finding)


def test_every_cut_off_has_a_ground_wire_of_its_own():
    assert without_ground(WIRING) == []


@pytest.mark.parametrize(("file", "old", "new", "finding"), [
    ("cutoff_mux.yml", "[D9, D5, D8, GND ICSP 6]}, {W_NANO: [1, 2, 3, 4]}, {MUX: [2, 1, 7, 8]}",
     "[D9, D5, D8]}, {W_NANO: [1, 2, 3]}, {MUX: [2, 1, 7]}", "MUX"),
    ("cutoff_oe.yml", "[D6, GND ICSP 6]}, {W_GATE: [1, 2]}, {L3: [gate by 1k, GND]}",
     "[D6]}, {W_GATE: [1]}, {L3: [gate by 1k]}", "L3"),
])
def test_a_missing_ground_wire_is_detected(copy, file, old, new, finding):
    assert without_ground(copy(file, old, new)) == [finding]


def test_a_label_states_1k_where_a_resistor_lies_in_the_wire():
    for device in DIAGRAM:
        entry = harness.parts()["connectors"][device]
        labels = dict(zip(map(str, entry["pins"]), entry.get("pinlabels", entry["pins"]),
                          strict=True))
        stated = {pin.split(" by")[0] for pin, label in labels.items() if "by 1k" in str(label)}
        assert stated == {c.ends[1] for c in circuit.components(device)
                          if c.ends[0].startswith("lead ")}


def test_a_high_stays_high_behind_its_resistors():
    """Lead by 1 kOhm against 10 kOhm to ground; the pull-up of /OE against that of the board."""
    for pin in ("1", "2", "3", "6"):
        series, down = (resistance(WIRING, "MUX", a, pin) for a in (f"lead {pin}", "8"))
        assert WEAKEST * down / (series + down) >= HCT_HIGH
    assert USUAL_PULL / (USUAL_PULL + resistance(WIRING, "L3", "drain", "VDD")) >= PCA_HIGH


def test_a_pull_up_of_10_kilo_ohm_is_no_high_on_a_board_that_pulls_low(copy):
    folder = copy("parts.yml", "res_1k_oe: {value: 1 kOhm", "res_1k_oe: {value: 10 kOhm")
    assert oe(folder, "off") == "undefined"


def test_the_bill_has_what_the_boards_carry():
    assert find_miscounted(WIRING, bom_table.load()) == []


@pytest.mark.parametrize(("old", "new", "finding"), [
    (", [6, 8]]", "]", "res_10k_mux"), ("res_10k_oe: {value: 10", "res_10k_oe: {value: 1",
                                        "res_10k_oe")])
def test_another_number_or_value_in_the_bill_is_detected(copy, old, new, finding):
    spoilt = find_miscounted(copy("parts.yml", old, new), bom_table.load())
    assert [x.split(":")[0] for x in spoilt] == [finding]


def test_the_capacitor_is_across_the_supply():
    for device in ("MUX",):
        assert [set(c.ends) for c in circuit.components(device) if "F" in c.value] == [
            {SUPPLY[device], GROUND[device]}]


def test_step_and_hardware_page_show_every_pin_and_component():
    step = guide.pages()["06_wiring.md"]
    page = (ROOT / "hardware" / "README.md").read_text(encoding="utf-8")
    for device in DIAGRAM:
        section = step.split(f"\n### {STEPS[device]}: ")[1].split("\n### ")[0]
        assert circuit.part_table(device) in section
        assert circuit.pin_table(device) in page
    assert circuit.pin_table("MUX").count("\n") == 17, "head, rule, and sixteen pins"


def test_the_safety_page_matches_the_circuit():
    text = SAFETY_PAGE.read_text(encoding="utf-8")
    for what, d5, d9, channel, supply, outcome in cases(text, L4_HEAD):
        assert esc_gets(WIRING, d5, d9, channel, supply) == outcome, what
    for what, d6, level, outcome in cases(text, L3_HEAD):
        assert oe(WIRING, d6) == level, what
        assert outcome == {"low": "pulse of the PCA9685", "high": "nothing"}[level], what


def test_the_safety_page_has_each_wire_low_and_off():
    rows = cases(SAFETY_PAGE.read_text(encoding="utf-8"), L4_HEAD)
    for column in (1, 2):
        assert {"low", "off"} <= {row[column] for row in rows}
    assert "off" in {row[3] for row in rows}
    assert "off" in {row[4] for row in rows}
    assert {"low",
            "off"} <= {row[1] for row in cases(SAFETY_PAGE.read_text(encoding="utf-8"), L3_HEAD)}


def test_without_its_pull_down_the_table_of_the_safety_page_is_wrong(copy):
    folder = copy("parts.yml", "[1, 8], [2, 8], ", "[1, 8], ")
    rows = cases(SAFETY_PAGE.read_text(encoding="utf-8"), L4_HEAD)
    assert "undefined" in {esc_gets(folder, *row[1:5]) for row in rows}
