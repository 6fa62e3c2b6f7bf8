"""The harness: the firmware's pins, each used once, nothing without supply and ground."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from dart_lab.sim.cutoff import CUTOFFS
from tests.common import ROOT, WIRING

sys.path[:0] = [str(WIRING), str(ROOT / "hardware")]

yaml = pytest.importorskip("yaml")
import bom_table  # noqa: E402 - found through the line above
import build  # noqa: E402
import drawing  # noqa: E402
import harness  # noqa: E402
import overview  # noqa: E402
import pinout  # noqa: E402

PINS_H = ROOT / "firmware" / "src" / "board" / "pins.h"
ENDS = {
    "kRingA": ("minimal", ("IR", "OUT")),
    "kIrPower": ("minimal", ("IR", "VCC")),
    "kImuPower": ("minimal", ("IMU", "VIN")),
    "kSda": ("minimal", ("IMU", "SDA")),
    "kScl": ("minimal", ("IMU", "SCL")),
    "kRingB": ("second_ring", ("HALL", "OUT")),
    "kCapture": ("capture", ("R_CLOCK", "b")),
    "kGate": ("cutoff_oe", ("L3", "gate by 1k")),
    "kReceiver 0": ("receiver", ("RX", "CH1")),
    "kReceiver 1": ("receiver", ("RX", "CH2")),
    "kReceiver 2": ("receiver", ("RX", "CH3")),
    "kDivider": ("divider", ("R_LOW", "a")),
    "kMuxSelect": ("cutoff_mux", ("MUX", "1 (S by 1k)")),
    "kOwnPulse": ("cutoff_mux", ("MUX", "2 (1I0 by 1k)")),
}
"""Firmware constant -> diagram and the far end of its wire."""
BEHIND = {"kCapture": ("cutoff_mux", ("MUX", "7 (2Y by 1k)"))}
"""The same for a pin that a cut-off wires otherwise."""
CUTOFF_PINS = {"D6": "oe", "D5": "mux", "D9": "mux"}
PORTS = {"D": 0, "B": 8}
"""First Nano pin of an AVR port; port C is A0 on."""


def firmware_pins(text: str | None = None) -> dict[str, str]:
    """Constant -> Nano pin, from the bits that are set and not from the comment; of several bits
    "constant N"."""
    found = {}
    for name, value in re.findall(r"(k\w+) = (_BV[^;]+);",
                                  text or PINS_H.read_text(encoding="utf-8")):
        bits = re.findall(r"_BV\(P([BCD])(\d)\)", value)
        for n, (port, bit) in enumerate(bits):
            pin = f"A{bit}" if port == "C" else f"D{PORTS[port] + int(bit)}"
            found[f"{name} {n}" if len(bits) > 1 else name] = pin
    return found


def wrong_pins(folder: Path, text: str | None = None) -> list[str]:
    """Constants of the firmware whose pin does not lead where it should."""
    wrong = []
    for constant, pin in firmware_pins(text).items():
        if constant == "kLed":  # on the Nano itself
            continue
        for diagram, far in (where[constant] for where in (ENDS, BEHIND) if constant in where):
            ends = {w.start: w.end for w in harness.wires(diagram, folder)}
            ends |= {b: a for a, b in ends.items()}
            if ends.get(("NANO", pin)) != far:
                wrong.append(f"{constant} {pin}: {ends.get(('NANO', pin))}, expected {far}")
    return wrong


def find_unpowered(folder: Path, diagram: str) -> list[str]:
    """Devices of a diagram without supply or ground."""
    used = {end for w in harness.wires(diagram, folder) for end in (w.start, w.end)}
    need = harness.parts(folder)["metadata"]["supply"]
    return [f"{device} {pin}" for device in {d for d, _ in used} if device in need
            for pin in map(str, need[device])
            if not any(d == device and p.split(" (")[0] == pin for d, p in used)]


def twice(folder: Path, *diagrams: str) -> list[str]:
    """Pins of the Nano with more than one wire when all these are built, where none branches."""
    branches = harness.parts(folder)["metadata"]["branches"]
    gone = {name for d in diagrams
            for name in harness.load(d, folder)["metadata"].get("replaces", [])}
    pins = [p for d in diagrams for w in harness.wires(d, folder) if w.cable not in gone
            for device, p in (w.start, w.end) if device == "NANO"]
    return sorted({p for p in pins if pins.count(p) > 1 and p not in branches})


def find_undeclared(folder: Path, diagram: str) -> list[str]:
    """Cut-off pins of a diagram that does not name the value of safety_out."""
    value = harness.load(diagram, folder)["metadata"]["safety_out"]
    return [p for w in harness.wires(diagram, folder)
            if (p := w.pin_at("NANO")) in CUTOFF_PINS and CUTOFF_PINS[p] != value]


def test_the_pins_are_those_of_the_firmware():
    assert set(firmware_pins()) - {"kLed"} == set(ENDS)
    assert wrong_pins(WIRING) == []


def test_a_swapped_pin_is_detected(copy):
    folder = copy("minimal.yml", "[D4, GND by VIN, A4, A5]", "[D4, GND by VIN, A5, A4]")
    assert [x.split(":")[0] for x in wrong_pins(folder)] == ["kSda A4", "kScl A5"]


def test_a_pin_moved_in_the_firmware_is_detected():
    text = PINS_H.read_text(encoding="utf-8").replace("_BV(PD7);", "_BV(PD6);")
    assert any("kIrPower" in x for x in wrong_pins(WIRING, text))


@pytest.mark.parametrize("diagram", harness.DIAGRAMS)
def test_every_device_has_supply_and_ground(diagram):
    assert find_unpowered(WIRING, diagram) == []


def test_every_plug_is_powered_or_declared_passive():
    data = harness.parts()
    need = data["metadata"]["supply"]
    passive = data["metadata"]["passive"]
    assert set(need) | set(passive) == set(data["connectors"])
    assert not set(need) & set(passive)


def test_a_missing_ground_is_detected(copy):
    folder = copy("minimal.yml", "[{NANO: [D7, GND by D2, D2]}, {W_IR: [1, 2, 3]}, "
                  "{IR: [VCC, GND, OUT]}]",
                  "[{NANO: [D7, D2]}, {W_IR: [1, 3]}, {IR: [VCC, OUT]}]")
    assert find_unpowered(folder, "minimal") == ["IR GND"]


@pytest.mark.parametrize("cutoff", ["cutoff_oe", "cutoff_mux"])
def test_each_pin_of_the_nano_carries_one_wire(cutoff):
    assert twice(WIRING, "minimal", "second_ring", "capture", "lidar_feed", "receiver",
                 "divider", cutoff) == []


def test_a_pin_used_twice_is_detected(copy):
    assert twice(copy("second_ring.yml", "GND ICSP 6, D3", "GND by D2, D3"),
                 "minimal", "second_ring") == ["GND by D2"]


def test_a_wire_that_branches_is_declared(copy):
    folder = copy("parts.yml", "branches: [GND ICSP 6]", "branches: []")
    assert twice(folder, "second_ring", "cutoff_mux") == ["GND ICSP 6"]


@pytest.mark.parametrize("diagram", harness.DIAGRAMS)
def test_cut_off_pins_only_with_their_parameter(diagram):
    assert harness.load(diagram)["metadata"]["safety_out"] in CUTOFFS
    assert find_undeclared(WIRING, diagram) == []


def test_a_cut_off_without_its_parameter_is_detected(copy):
    assert find_undeclared(copy("cutoff_mux.yml", "safety_out: mux", "safety_out: none"),
                           "cutoff_mux") == ["D9", "D5"]


def test_the_enum_of_the_firmware_has_the_same_values():
    text = (PINS_H.parent / "outputs.h").read_text(encoding="utf-8")
    values = dict(re.findall(r"k(None|Enable|Multiplexer) = (\d)", text))
    assert [int(values[k]) for k in ("None", "Enable", "Multiplexer")] == [
        CUTOFFS[k] for k in ("none", "oe", "mux")]


def test_every_part_is_in_the_bill():
    ids = {r.id for r in bom_table.load()}
    data = harness.parts()["connectors"]
    named = {c["pn"] for c in data.values()}
    named |= {x["pn"] for c in data.values() for x in c.get("additional_components", [])}
    named |= {pn for c in data.values() for pn in c.get("on_board", ())}
    named |= {c["pn"] for d in harness.DIAGRAMS for c in harness.load(d)["cables"].values()}
    assert named <= ids


def test_every_connector_is_drawn_somewhere():
    drawn = {n for d in harness.DIAGRAMS for n in harness.load(d)["connectors"]}
    assert drawn == set(harness.parts()["connectors"])


def test_the_committed_diagrams_and_tables_are_those_of_the_sources():
    assert build.stale() == [], "make hardware ARGS=--write"


@pytest.mark.slow
def test_an_older_diagram_is_detected(copy):
    """A colour changed in the source alone: its diagram and the pins of the Nano are old."""
    folder = copy("capture.yml", "[GN]}\nconnections", "[YE]}\nconnections")
    assert build.stale(folder) == ["capture.svg", "nano_pins.svg"]


def test_a_table_without_its_end_is_named():
    with pytest.raises(harness.WiringError, match="wires: pi5 --> has no <!-- end of wires -->"):
        build.with_tables("<!-- wires: pi5 -->\n| a |\n<!-- end of pi5 -->\n")


def test_every_diagram_is_a_table_in_the_guide():
    stated = re.findall(r"<!-- wires: (\w+) -->\n\|", build.GUIDE.read_text(encoding="utf-8"))
    assert set(stated) == set(harness.DIAGRAMS) - {"smallest"}, "that one has two wires, and a link"


def test_each_step_of_the_guide_shows_its_wires():
    steps = harness.load("minimal")["metadata"]["steps"]
    text = build.GUIDE.read_text(encoding="utf-8")
    for step, cables in steps.items():
        section = text.split(f"\n## {step}: ")[1].split("\n## ")[0]
        assert f"wiring/minimal_{step}.svg" in section
        assert set(cables) <= set(harness.load("minimal")["cables"])
    drawn = {c for cables in steps.values() for c in cables}
    assert set(harness.load("minimal")["cables"]) - drawn == {"W_CELLS"}  # a step with a picture


def test_the_pinout_shows_every_wire_of_the_nano():
    svg = pinout.nano()
    known = harness.parts()["connectors"]
    for diagram in harness.DIAGRAMS:
        for wire in harness.wires(diagram):
            if (pin := wire.pin_at("NANO")) is None:
                continue
            device, end = wire.end if wire.start[0] == "NANO" else wire.start
            words = f"{known[device]['short']} {re.sub(' by [^)]+', '', end)}"
            assert svg.count(f">{words}") == (2 if "ICSP" not in pin else 0), (pin, words)
    assert {"Hall GND", "mux 8", "MOSFET GND"} <= set(re.findall(r"Hall GND|mux 8|MOSFET GND", svg))


def test_from_below_left_and_right_change_places():
    """The USB socket stays above: the same pin is left once and right once."""
    at = [float(x) for x in re.findall(r"<text x='([\d.]+)'[^>]*>D2</text>", pinout.nano())]
    assert len(at) == 2
    assert sum(at) == pytest.approx(drawing.WIDTH)


def test_a_typing_error_is_refused_with_the_known_names(copy):
    with pytest.raises(harness.WiringError, match="no pin 'D77'; it has D7, "):
        harness.wires("minimal", copy("minimal.yml", "[D7,", "[D77,"))


def test_an_unknown_name_is_refused_with_the_known_ones(copy):
    with pytest.raises(harness.WiringError, match=r"'NANNO'.*one of NANO, "):
        harness.wires("minimal", copy("minimal.yml", "{NANO: [D7", "{NANNO: [D7"))


def test_a_wire_too_few_is_reported(copy):
    with pytest.raises(harness.WiringError, match="W_IR"):
        harness.wires("minimal", copy("minimal.yml", "{W_IR: [1, 2, 3]}", "{W_IR: [1, 2]}"))


def pins_in_text(text: str) -> set[tuple[str, str]]:
    """(what, pin) of sentences: "VCC to D7", "red D4", "blue A4"."""
    return set(re.findall(r"\b(VCC|OUT) to ([DA]\d)\b", text)) | set(
        re.findall(r"\b(red|blue|yellow|white) ([DA]\d)\b", text))


def test_the_sentences_of_the_guide_name_the_same_pins():
    stated: set[tuple[str, str]] = set()
    for page in sorted(build.GUIDE.parent.glob("*.md")):
        stated |= pins_in_text(page.read_text(encoding="utf-8"))
    true = {(w.end[1], w.start[1]) for w in harness.wires("minimal") if w.end[0] == "IR"}
    true |= {(harness.WORDS[w.colour], w.start[1]) for w in harness.wires("minimal")
             if w.end[0] == "IMU"}
    assert stated <= true
    assert {("VCC", "D7"), ("OUT", "D2"), ("red", "D4"), ("blue", "A4"), ("yellow", "A5")} <= stated
    assert not pins_in_text("red D4, blue A5") <= true, "the control: a swapped pin"


def test_the_table_of_the_hardware_page_names_the_same_pins():
    text = (ROOT / "hardware" / "README.md").read_text(encoding="utf-8")
    table = text.split("## Wiring of the Nano")[1].split("##")[0]
    pins = re.findall(r"\b[DA]\d+\b", " ".join(re.findall(r"^\| ([^|]+) \|", table, re.MULTILINE)))
    firmware = {p for name, p in firmware_pins().items() if name != "kLed"}
    assert sorted(pins) == sorted(firmware)


def test_the_picture_of_the_harness_has_every_cable_and_connector():
    svg = overview.drawing()
    for _, cable, _, _ in harness.chains("minimal"):
        data = harness.load("minimal")
        assert str(data["cables"][cable]["type"]).split()[-1] in svg, cable
        for end in overview.find_ends(data, cable):
            assert end.split()[0].rstrip(",") in svg, cable


def test_a_cable_without_connectors_is_refused(copy):
    folder = copy("minimal.yml", "    W_MOTOR: [fixed, \"bullets [a]\"]\n", "")
    with pytest.raises(harness.WiringError, match=r"metadata\.ends: W_MOTOR has None"):
        overview.drawing(folder)
