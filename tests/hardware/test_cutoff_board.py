"""The perforated board of the multiplexer: what is drawn joins what the circuit joins."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from tests.common import ROOT, WIRING

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

sys.path[:0] = [str(WIRING), str(ROOT / "hardware")]

pytest.importorskip("yaml")
import circuit  # noqa: E402 - found through the line above
import harness  # noqa: E402
import perfboard  # noqa: E402
import schematic  # noqa: E402

Ends = tuple[str, frozenset[str]]


def joints(folder: Path) -> tuple[set[frozenset[str]], set[frozenset[str]]]:
    """Groups of joined pins: on the board, in the circuit."""
    data = perfboard.layout(folder)
    net = perfboard.nets(data)
    at = perfboard.socket(data, 16)
    drawn = {frozenset(p for p in at if net[at[p]] == net[hole]) for hole in at.values()}
    wired = [{pin, *others} for pin, others in circuit.joined("MUX", folder).items()]
    alone = set(at) - {p for group in wired for p in group}
    return drawn, {frozenset(g) for g in wired} | {frozenset({p}) for p in alone}


def list_wires(folder: Path) -> tuple[list[Ends], list[Ends]]:
    """Components by the pins that they join: on the board, in the circuit."""
    data = perfboard.layout(folder)
    net = perfboard.nets(data)
    at = perfboard.socket(data, 16)
    name = {net[at[p]]: p for p in at} | {net[at["8"]]: "8"}
    drawn = [(part, frozenset(name.get(net[hole], hole) for hole in ends))
             for part, pairs in data["parts"].items() for ends in pairs]
    wired = [(c.part, frozenset(c.ends)) for c in circuit.components("MUX", folder)
             if not c.ends[0].startswith("lead ")]
    return sorted(drawn, key=str), sorted(wired, key=str)


def find_misled_leads(folder: Path) -> list[str]:
    """Holes of leads that are not joined to their pin; wires of the harness without a hole."""
    data = perfboard.layout(folder)
    net = perfboard.nets(data)
    at = perfboard.socket(data, 16)
    wrong = [hole for hole, (pin, _) in data["leads"].items() if net[hole] != net[at[str(pin)]]]
    declared = {(str(pin), far) for pin, far in data["leads"].values()}
    for wire in harness.wires("cutoff_mux", folder):
        for (a, pin), (far, _) in ((wire.start, wire.end), (wire.end, wire.start)):
            if a == "MUX" and (pin.split(" ")[0], far) not in declared:
                wrong.append(f"{far} to {pin}")
    return wrong


def find_crowded_holes(folder: Path) -> list[str]:
    """Holes that take more than one leg."""
    data = perfboard.layout(folder)
    used = [*perfboard.socket(data, 16).values(), *data["leads"],
            *(hole for pairs in data["parts"].values() for ends in pairs for hole in ends)]
    return sorted({hole for hole in used if used.count(hole) > 1})


@pytest.fixture
def copy(tmp_path):
    """``copy(old, new)``: a copy of the sources with one thing of the board broken."""
    folder = tmp_path / "wiring"
    shutil.copytree(WIRING, folder, ignore=shutil.ignore_patterns("__*"))

    def broken(old: str, new: str) -> Path:
        path = folder / "mux_board.yml"
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return folder

    return broken


def test_the_board_is_the_circuit():
    drawn, wired = joints(WIRING)
    assert drawn == wired
    drawn, wired = list_wires(WIRING)
    assert len(drawn) == len(wired) == 5
    assert [(p, sorted(e)) for p, e in drawn] == [(p, sorted(e)) for p, e in wired]
    assert find_misled_leads(WIRING) == []
    assert find_crowded_holes(WIRING) == []


def test_it_fits_the_board_that_its_holder_is_printed_for():
    text = (ROOT / "hardware" / "cad" / "parameters.toml").read_text(encoding="utf-8")
    cutoff = tomllib.loads(text)["cutoff"]
    row, columns = perfboard.layout()["size"]
    assert 2.54 * columns <= cutoff["board_length"]["value"]
    assert 2.54 * (ord(row) - ord("A") + 1) <= cutoff["board_width"]["value"]


def test_a_missing_and_a_wrong_wire_are_detected(copy):
    drawn, wired = joints(copy("  - [A4, B4]\n", ""))
    assert frozenset({"15"}) in drawn - wired


def test_pins_that_are_joined_by_mistake_are_detected(copy):
    drawn, wired = joints(copy("- [D6, E6]", "- [D6, G6]"))
    assert "4" in max(drawn - wired, key=len)


def test_a_resistor_in_another_column_is_detected(copy):
    drawn, wired = list_wires(copy("[F4, G4]", "[F9, G9]"))
    assert drawn != wired


def test_a_lead_in_another_hole_is_detected(copy):
    assert find_misled_leads(copy("E4: [2, NANO]", "E7: [2, NANO]")) == ["E7"]


def test_a_lead_that_is_missing_is_detected(copy):
    assert find_misled_leads(copy("  F11: [8, NANO]\n", "")) == ["NANO to 8 (GND)"]


def test_two_legs_in_one_hole_are_detected(copy):
    assert find_crowded_holes(copy("E3: [1, NANO]", "F3: [1, NANO]")) == ["F3"]


def test_a_slanted_wire_and_one_off_the_board_are_refused(copy):
    with pytest.raises(harness.WiringError, match="from A4 to B5 lies in no row or column"):
        perfboard.nets(perfboard.layout(copy("[A4, B4]", "[A4, B5]")))
    with pytest.raises(harness.WiringError, match="'B12', which is no hole"):
        perfboard.nets(perfboard.layout(copy("[B2, B11]", "[B2, B12]")))


def test_the_schematic_has_every_pin_component_and_wire():
    svg = schematic.drawing()
    chip = schematic.Chip("MUX", WIRING)
    assert set(chip.left) | set(chip.right) == set(map(str, range(1, 17)))
    assert len(chip.left) + len(chip.right) == 16, "each pin once"
    assert svg.count("width='24' height='9'") + svg.count("width='9' height='24'") == sum(
        "Ohm" in c.value for c in circuit.components("MUX"))
    for wire in harness.wires("cutoff_mux"):
        if (pin := wire.pin_at("MUX")) is not None:
            far, other = wire.end if wire.start[0] == "MUX" else wire.start
            short = harness.parts()["connectors"][far]["short"]
            assert f">{short} {other}".replace(" ICSP 6", "") in svg, (pin, short, other)


def test_a_component_that_is_gone_is_gone_from_the_schematic(copy):
    folder = copy("size: ", "size: ")
    parts = folder / "parts.yml"
    parts.write_text(parts.read_text(encoding="utf-8").replace(", [lead 7, 7]", ""),
                     encoding="utf-8")
    assert schematic.drawing(folder).count(">1k<") == schematic.drawing().count(">1k<") - 1
