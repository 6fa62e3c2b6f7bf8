"""The printed circuit of the multiplexer, read back from its Gerber files."""

from __future__ import annotations

import re
import shutil
import sys
import warnings
from itertools import combinations
from math import dist, inf
from pathlib import Path

import pytest

from tests.common import ROOT, WIRING

sys.path[:0] = [str(WIRING), str(ROOT / "hardware")]

pytest.importorskip("yaml")
pytest.importorskip("gerber_writer")
import circuit  # noqa: E402 - found through the lines above
import pcb  # noqa: E402
import perfboard  # noqa: E402

Point = tuple[float, float]
Stroke = tuple[Point, Point, float]
"""From, to, width [mm]; a pad is a stroke without length."""
CLEARANCE = 0.3
RING_MM = 0.3
EDGE_MM = 0.5
"""mm that any board house makes: between copper, around a hole, to the edge."""


def strokes(gerber: str) -> list[Stroke]:
    """What a Gerber file with round apertures and millimetres paints."""
    assert "%MOMM*%" in gerber
    assert "%FSLAX36Y36*%" in gerber
    widths = {int(n): float(w) for n, w in re.findall(r"%ADD(\d+)C,([\d.]+)\*%", gerber)}
    found: list[Stroke] = []
    width = 0.0
    at = (0.0, 0.0)
    for line in gerber.splitlines():
        if tool := re.fullmatch(r"D(\d+)\*", line):
            width = widths[int(tool[1])]
        elif move := re.fullmatch(r"X(-?\d+)Y(-?\d+)D0([123])\*", line):
            there = (int(move[1]) / 1e6, int(move[2]) / 1e6)
            if move[3] != "2":
                found.append((there if move[3] == "3" else at, there, width))
            at = there
    return found


def holes(excellon: str) -> dict[Point, float]:
    """x, y -> diameter [mm]."""
    sizes = {int(n): float(d) for n, d in re.findall(r"^T(\d+)C([\d.]+)$", excellon, re.MULTILINE)}
    found = {}
    size = 0.0
    for line in excellon.split("%", 1)[1].splitlines():
        if tool := re.fullmatch(r"T([1-9]\d*)", line):
            size = sizes[int(tool[1])]
        elif hit := re.fullmatch(r"X([\d.]+)Y([\d.]+)", line):
            found[float(hit[1]), float(hit[2])] = size
    return found


def from_line(p: Point, a: Point, b: Point) -> float:
    """Distance of a point from a straight line between two others [mm]."""
    length = dist(a, b) ** 2
    t = 0.0 if not length else max(0.0, min(1.0, sum(
        (p[i] - a[i]) * (b[i] - a[i]) for i in (0, 1)) / length))
    return dist(p, (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])))


def gap(one: Stroke, other: Stroke) -> float:
    """Between the edges of two strokes that do not cross [mm]; below 0 they touch."""
    (a, b, w), (c, d, v) = one, other
    ends = min(from_line(a, c, d), from_line(b, c, d), from_line(c, a, b), from_line(d, a, b))
    return ends - (w + v) / 2


def join_strokes(copper: list[Stroke]) -> tuple[list[int], float]:
    """Number of the net of each stroke, and the least gap between two nets [mm]."""
    net = list(range(len(copper)))
    gaps = {(i, j): gap(copper[i], copper[j]) for i, j in combinations(net, 2)}
    for (i, j), space in gaps.items():
        if space < 0:
            net = [net[i] if n == net[j] else n for n in net]
    return net, min((space for (i, j), space in gaps.items() if net[i] != net[j]), default=inf)


def netlist(files: dict[str, str], folder: Path = WIRING) -> tuple[set[frozenset[str]], float]:
    """Groups of holes that the copper joins, by their names on the board; the least gap [mm]."""
    data = perfboard.layout(folder)
    name = {pcb.place(data, hole): hole for hole in pcb.drills(data, folder)}
    copper = strokes(files["mux_board-B_Cu.gbr"])
    net, least = join_strokes(copper)
    groups: dict[int, set[str]] = {}
    for number, (a, b, _) in zip(net, copper, strict=True):
        groups.setdefault(number, set()).update(name[p] for p in (a, b) if p in name)
    return {frozenset(g) for g in groups.values() if g}, least


def list_required_nets(folder: Path = WIRING) -> set[frozenset[str]]:
    """The same by the perforated board, whose own test compares it with the circuit."""
    data = perfboard.layout(folder)
    net = perfboard.nets(data)
    groups = {}
    for hole in pcb.drills(data, folder):
        groups.setdefault(net[hole], set()).add(hole)
    return {frozenset(g) for g in groups.values()}


@pytest.fixture(scope="module")
def files() -> dict[str, str]:
    return {p.name: p.read_text(encoding="utf-8") for p in (WIRING / "pcb").iterdir()}


def test_the_copper_joins_what_the_circuit_joins(files):
    found, least = netlist(files)
    assert found == list_required_nets()
    assert least >= CLEARANCE
    at = perfboard.socket(perfboard.layout(), 16)
    for pin, others in circuit.joined("MUX").items():
        group = next(g for g in found if at[pin] in g)
        assert {at[x] for x in others} <= group


def test_a_track_too_few_and_one_too_many_are_detected(files):
    text = files["mux_board-B_Cu.gbr"]
    lines = text.splitlines()
    last = next(n for n in range(len(lines) - 1, 0, -1) if lines[n].endswith("D01*"))
    cut = "\n".join(lines[:last] + lines[last + 1:])
    assert netlist({"mux_board-B_Cu.gbr": cut})[0] != list_required_nets()
    short = text.replace("M02*", "X7380000Y10000000D02*\nX9920000Y10000000D01*\nM02*")
    assert netlist({"mux_board-B_Cu.gbr": short})[0] != list_required_nets()
    near = text.replace("M02*", "X1500000Y16050000D02*\nX2300000Y16050000D01*\nM02*")
    assert netlist({"mux_board-B_Cu.gbr": near})[1] < CLEARANCE


def test_a_broken_circuit_is_another_board(tmp_path):
    folder = tmp_path / "wiring"
    shutil.copytree(WIRING, folder, ignore=shutil.ignore_patterns("__*", "*.svg"))
    path = folder / "mux_board.yml"
    path.write_text(path.read_text(encoding="utf-8").replace("  - [A4, B4]\n", ""),
                    encoding="utf-8")
    assert netlist(pcb.files(folder), folder)[0] != list_required_nets()


def test_every_hole_has_its_ring_mask_and_place_on_the_board(files):
    pads = {a: w for a, b, w in strokes(files["mux_board-B_Cu.gbr"]) if a == b}
    drilled = holes(files["mux_board.drl"])
    assert set(pads) == set(drilled)
    assert min((pads[p] - size) / 2 for p, size in drilled.items()) >= RING_MM
    masks = {a: w for a, b, w in strokes(files["mux_board-B_Mask.gbr"]) if a == b}
    assert {p: w > pads[p] for p, w in masks.items()} == dict.fromkeys(pads, True)
    edge = [p for a, b, _ in strokes(files["mux_board-Edge_Cuts.gbr"]) for p in (a, b)]
    wide, high = (max(p[i] for p in edge) for i in (0, 1))
    assert (wide, high) == tuple(perfboard.layout()["board"])
    for x, y in pads:
        assert min(x, y, wide - x, high - y) - pcb.PAD / 2 >= EDGE_MM


def test_the_committed_files_have_no_date(files):
    assert set(files) == set(pcb.files())
    assert not [name for name, text in files.items() if "CreationDate" in text]


LAYERS = {"mux_board-B_Cu.gbr": "bottom copper", "mux_board-B_Mask.gbr": "bottom mask",
          "mux_board-Edge_Cuts.gbr": "mechanical outline", "mux_board-F_Silkscreen.gbr": "top silk",
          "mux_board.drl": "drill plated"}


def read_by_gerber_viewer(folder: Path) -> tuple[list[float], set[Point], list[str]]:
    """Size of the board, pads that have both copper and a hole, what covers none: gerbonara."""
    from gerbonara import LayerStack

    with warnings.catch_warnings():  # KiCad has its G90 behind the head of a drill file, too
        warnings.simplefilter("ignore")
        board = LayerStack.open(folder, autoguess=False, overrides={
            re.escape(name): use for name, use in LAYERS.items()})
    (x0, y0), (x1, y1) = board.board_bounds()
    copper = board.graphic_layers["bottom", "copper"].objects
    pads = {(round(o.x, 3), round(o.y, 3)) for o in copper if type(o).__name__ == "Flash"}
    drills = {(round(h.x, 3), round(h.y, 3)) for layer in board.drill_layers for h in layer.objects}
    return [x1 - x0, y1 - y0], pads & drills, sorted(map(str, pads ^ drills))


def test_a_viewer_that_is_not_ours_sees_the_same_board(files, tmp_path):
    """Reader and writer above may share a mistake; this reader knows nothing of them."""
    pytest.importorskip("gerbonara")
    size, pads, alone = read_by_gerber_viewer(WIRING / "pcb")
    assert size == pytest.approx([30.1, 20.1]), "30 x 20 and the width of the outline's stroke"
    assert pads == {(round(x, 3), round(y, 3)) for x, y in holes(files["mux_board.drl"])}
    assert alone == []
    shutil.copytree(WIRING / "pcb", tmp_path, dirs_exist_ok=True)
    drill = tmp_path / "mux_board.drl"
    drill.write_text(drill.read_text(encoding="utf-8").replace("X7.380Y10.000\n", "", 1),
                     encoding="utf-8")
    assert read_by_gerber_viewer(tmp_path)[2] == ["(7.38, 10.0)"], "the control"
