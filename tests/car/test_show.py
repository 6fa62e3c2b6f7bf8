"""What Car, State and a run show of themselves: the numbers that they hold."""

from __future__ import annotations

import gzip
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from dart_hal import Car
from dart_hal.core.notebook import card
from dart_hal.recording.run import RunReader

OLD_RECORDING = Path(__file__).parents[1] / "recording" / "fixtures" / "v3" / "run.mcap.gz"


class Cells(HTMLParser):
    """Rows of a table as {name: value}; ``open`` holds tags that were not closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        if tag in ("th", "td"):
            self.texts.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1] in ("th", "td"):
            self.texts[-1] += data

    @property
    def rows(self):
        assert self.open == []
        return dict(zip(self.texts[::2], self.texts[1::2], strict=True))


@pytest.fixture
def state():
    with Car.open("sim://?seed=3&nano=mock") as car:
        return list(car.states(duration=1.0))[-1]


def test_a_state_prints_its_numbers(state):
    known = replace(state, t=1.5, speed=0.5, speed_std=0.01, yaw_rate=-0.25)
    rows = Cells(known._repr_html_()).rows
    assert rows["t"] == "1.500 s"
    assert rows["speed"] == "0.500 +- 0.010 m/s"
    assert rows["yaw rate"] == "-0.250 rad/s"
    assert "NOT_ARMED" in rows["limited"]
    for value in rows.values():
        assert value in repr(known)
    assert "\n" not in repr(known)


def test_what_is_not_measured_is_no_number(state):
    blind = replace(state, yaw_rate=None)
    assert Cells(blind._repr_html_()).rows["yaw rate"] == "none"


@pytest.mark.slow
def test_a_car_shows_itself_at_every_stage_and_moves_nothing():
    with Car.open("sim://?seed=3&nano=mock") as car:
        before = car._engine.now
        assert "none yet" in Cells(car._repr_html_()).rows["State"]
        assert "DISARMED" in repr(car)
        assert car._engine.now == before, "no frame was read for it"
        next(car.states())
        car.arm()
        rows = Cells(car._repr_html_()).rows
        assert (rows["mode"], rows["URL"]) == ("ARMED", "sim://?seed=3&nano=mock")
        assert "speed" in rows
    assert "CLOSED" in repr(car)


@pytest.mark.parametrize("cut", [None, 30_000])
def test_a_run_prints_its_length_contents_and_whether_it_is_whole(tmp_path, cut):
    path = tmp_path / "run.mcap"
    path.write_bytes(gzip.decompress(OLD_RECORDING.read_bytes())[:cut])
    run = RunReader(path)
    rows = Cells(run._repr_html_()).rows
    assert "sim-7" in rows["car"]
    assert f"/rx:{len(list(run.chunks()))}" in rows["messages"].split()
    assert rows["whole"].startswith("yes") == (cut is None)
    if cut is None:
        stamps = [item.t for what in (run.chunks, run.sent, run.i2c) for item in what()]
        assert rows["lasts"] == f"{max(stamps) - min(stamps):.1f} s"
        assert "/command:60" in rows["messages"].split()
    assert str(path) in repr(run)


def test_text_of_others_is_not_markup():
    shown = card("<b>", [("<script>", "a & b")])
    assert "<script>" not in shown
    assert Cells(shown).rows == {"<script>": "a & b"}
