"""What the pages show in a real browser: channels of ``car.log``, a lost car, repeated refusals."""

from __future__ import annotations

import threading
import time

import pytest

from dart_hal.car import Fleet
from dart_hal.fleet.station import Station
from dart_lab.live.view.fleet_desk import FleetPage
from tests.live.view.sockets import live_page

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
CHOICES = "return [...document.getElementById('channel0').options].map((one) => one.value)"
WATCH = ("const made = uPlot; window.plots = [];"
         "uPlot = function (...a) { const one = new made(...a); plots.push(one); return one; };")
CHOOSE = "document.getElementById('channel0').value = 'slip/rear'"
DRAWN = "const [t, y] = plots.at(-1).data; return [t.length, y.filter((v) => v !== null)]"
INK = """
const canvas = document.querySelector('#plot0 canvas');
const { data, width } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
const rows = new Set();
for (let n = 0; n < data.length; n += 4)
  if (data[n + 3] > 200 && data[n] < 60 && data[n + 1] > 80 && data[n + 2] > 150)
    rows.add(Math.floor(n / 4 / width));
return rows.size ? Math.max(...rows) - Math.min(...rows) : 0
"""
"""Height [px] over which there is the line's blue."""
RED = "rgb(200, 16, 46)"
CARDS = """
return Object.fromEntries([...document.querySelectorAll('article')].map((one) =>
  [one.dataset.name, getComputedStyle(one).backgroundColor]))
"""


def within(seconds, done):
    """What ``done()`` is once it is true, and s until then. Fails when it does not become so."""
    begun = time.monotonic()
    while not (value := done()):
        assert time.monotonic() - begun < seconds
        time.sleep(0.03)
    return value, time.monotonic() - begun


def test_a_number_that_a_program_logs_is_a_channel_that_is_drawn(browsers):
    with live_page(drives=True) as (car, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        assert "slip/rear" not in one.run(CHOICES)
        car.on_state(lambda state: car.log("slip/rear", 0.25 if state.t % 1.0 < 0.5 else -0.25))
        within(30.0, lambda: "slip/rear" in one.run(CHOICES))
        one.run(WATCH)
        one.run(CHOOSE)
        within(30.0, lambda: one.run("return plots.length"))

        def is_drawn():
            rows, values = one.run(DRAWN)
            return rows > 100 and set(values) == {0.25, -0.25}

        within(30.0, is_drawn)
        assert one.run(INK) > 40, "of the plot's 130 px"


def test_a_lost_car_is_red_within_a_second_and_the_other_is_not(browsers):
    urls = [f"sim://?nano=mock&pace=1&seed={n}" for n in (1, 2)]
    ended = threading.Event()
    with Fleet.open(urls, room="local://red") as fleet, Station("local://red") as station, \
            FleetPage([station], 0, lan=False) as page:
        loop = threading.Thread(target=lambda: next(
            (None for _ in fleet.states() if ended.is_set()), None))
        loop.start()
        try:
            one = browsers()
            one.open(page.urls[0])
            within(30.0, lambda: len(one.run(CARDS)) == 2)
            assert RED not in one.run(CARDS).values()
            fleet.members[1].close()
            _, took = within(30.0, lambda: RED in one.run(CARDS).values())
            colours = one.run(CARDS)
            assert took <= 1.0
            assert colours[fleet.names[1]] == RED
            assert colours[fleet.names[0]] != RED
        finally:
            ended.set()
            loop.join()


def test_what_is_refused_thirty_times_a_second_is_shown_once_with_a_count(browsers):
    with live_page() as (_, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        before = one.run("return document.querySelectorAll('#said li').length")
        one.run("for (let n = 0; n < 30; n++) Notices.add(`a command ${201 + n} ms old`);"
                "Notices.add('STOP was pressed'); Notices.add('a command 250 ms old')")
        lines = one.run("return [...document.querySelectorAll('#said li')].map(l => l.textContent)")
        assert len(lines) - before == 3, "another sentence between them begins a new line"
        assert lines[0].endswith("a command 250 ms old")
        assert lines[2].endswith("a command 230 ms old  (30 times)")
