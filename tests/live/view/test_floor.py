"""What lies around the car on its page: its map, the doubt about its place, the other cars."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from dart_hal import Fleet
from dart_hal.core.types import START_FRAME
from dart_hal.estimation.localisation.source import FRAME
from dart_lab.cli.view import load_map_lines
from dart_lab.live.view.player import Player
from dart_lab.live.view.rows import FIELDS
from dart_lab.live.view.told import others_message
from dart_lab.sim.lidar.maps import clearance
from dart_lab.sim.room_truth import lines_by_frame
from tests.live.view.at_the_desk import AtTheDesk
from tests.live.view.sockets import live_page

COUNT_SCRIPT = """
const c = document.getElementById('floor'), [r, g, b] = arguments[0];
const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
let n = 0;
for (let i = 0; i < d.length; i += 4)
  if (d[i + 3] > 200 && Math.hypot(d[i] - r, d[i + 1] - g, d[i + 2] - b) < 25) n++;
return n;"""
EXTENT = COUNT_SCRIPT.replace("let n = 0;", "let n = 0, box = [1e9, -1e9, 1e9, -1e9];").replace(
    "n++;", "{ const x = (i / 4) % c.width, y = Math.floor(i / 4 / c.width);"
    " box = [Math.min(box[0], x), Math.max(box[1], x), Math.min(box[2], y), Math.max(box[3], y)];"
    " n++; }").replace("return n;", "return n ? [box[1] - box[0], box[3] - box[2]] : [0, 0];")
ORANGE = (0xD5, 0x5E, 0x00)
INK = (0x1B, 0x22, 0x2C)
BACKGROUND = (0x5B, 0x66, 0x75)
URL = "sim://?nano=mock&pace=1&lidar=1&map=room&seed=2"


def pixels(browser, colour):
    return browser.driver.execute_script(COUNT_SCRIPT, colour)


def grows(browser, colour, least, within=8.0):
    ends = time.monotonic() + within
    while pixels(browser, colour) < least:
        assert time.monotonic() < ends, pixels(browser, colour)
        time.sleep(0.1)


@pytest.mark.slow
def test_the_room_of_a_simulated_car_is_drawn_where_its_scans_see_it():
    """In the frame of its start and in that of the room; each is sent with its frame."""
    lines = lines_by_frame("sim://?lidar=1&map=room&seed=2")
    at = AtTheDesk(url="sim://?nano=mock&seed=2&lidar=noise=0,scale=1,x=0.13,y=0,yaw=0&map=room",
                   lines=lines)
    with at:
        (begin,) = map(json.loads, at.desk.open_page("three"))
        assert set(begin["maps"]) == {START_FRAME, FRAME}
        at.drive(1.0)
        scan = [one for one in at.messages if one["type"] == "scan"][-1]["points"]
        walls = np.array(begin["maps"][START_FRAME])
        off = [clearance(walls, x, y) for x, y in np.reshape(scan, (-1, 2))[::20]]
        assert np.median(off) < 0.02
        elsewhere = [clearance(np.array(begin["maps"][FRAME]), x, y)
                     for x, y in np.reshape(scan, (-1, 2))[::20]]
        assert np.median(elsewhere) > 0.1, "control: the other frame does not fit"


@pytest.mark.parametrize("url", ["sim://", "sim://?nano=mock&seed=1", "replay://run.mcap",
                                 "serial:///dev/ttyUSB0"])
def test_a_car_without_a_room_has_no_map(url):
    assert load_map_lines(url, None) == {}


@pytest.mark.slow
def test_other_cars_are_given_in_the_frame_of_this_one_alone():
    urls = [f"sim://?nano=mock&mocap=1&world=others&seed={n}&at={n},0,0" for n in (1, 2)]
    with Fleet.open(urls, room="local://others") as fleet:
        for _ in fleet.states(duration=1.5):
            pass
        frame = fleet.cars[0]._state.estimate.frame
        assert frame != START_FRAME
        poses = fleet.members[0].other_poses()
        (other,) = others_message(frame, poses)["poses"]
        assert other["name"] == fleet.names[1]
        assert other["x"] == pytest.approx(2.0, abs=0.2)
        assert others_message(START_FRAME, poses)["poses"] == []


@pytest.mark.realtime
@pytest.mark.slow
def test_the_map_is_drawn(browsers):
    with live_page(url=URL, lines=lines_by_frame(URL)) as (_, page):
        one = browsers()
        one.open(page.urls[0])
        grows(one, INK, 300)
        one.run("Floor.map([])")
        time.sleep(0.5)
        assert pixels(one, INK) < 300, "control: without the map"


@pytest.mark.realtime
@pytest.mark.slow
def test_two_sigma_of_the_place_are_drawn_in_its_frame(browsers):
    """0.5 m along x, 0.25 m along y, turned by the correlation: an ellipse of 90 px a metre."""
    def run(sxx, sxy, syy):
        known = {"t": 0.0, "x": 0.0, "y": 0.0, "yaw": 0.0, "sxx": sxx, "sxy": sxy, "syy": syy}
        row = [known.get(name) for name in FIELDS]
        return {"type": "run", "car": "x", "url": "", "fields": FIELDS, "scans": [], "images": [],
                "rows": [row, [0.01, *row[1:]]]}

    sizes = []
    for sxx, sxy, syy in ((0.25, 0.0, 0.0625), (0.0625, 0.0, 0.25), (0.25, 0.2, 0.25), (0, 0, 0)):
        with Player(run(sxx, sxy, syy), 0, lan=False) as player:
            one = browsers()
            one.open(player.urls[0])
            one.until("recorded", "mode")
            time.sleep(0.7)
            sizes.append(one.driver.execute_script(EXTENT, ORANGE))
    assert sizes[0] == pytest.approx([180, 90], abs=6)
    assert sizes[1] == pytest.approx([90, 180], abs=6)
    assert sizes[2] == pytest.approx([180, 180], abs=6)
    assert sizes[3] == [0, 0], "control: nothing is drawn of a place that is certain"


@pytest.mark.realtime
@pytest.mark.slow
def test_other_cars_are_drawn_on_the_page_of_one(browsers):
    urls = [f"sim://?nano=mock&pace=1&mocap=1&world=page&seed={n}&at={0.8 * n},0,0"
            for n in (1, 2)]
    with Fleet.open(urls, room="local://page") as fleet, fleet.cars[0].view(
            port=0, others=fleet.members[0].other_poses) as page:
        one = browsers()
        one.open(page.urls[0])
        grows(one, BACKGROUND, 300)
        one.run("const draw = Floor.others; Floor.others = () => draw.call(Floor, [])")
        time.sleep(0.5)
        assert pixels(one, BACKGROUND) < 200, "control: without them"
