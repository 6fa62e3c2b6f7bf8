"""The pages can be read: contrast and names (axe-core), plots, no empty cards, old values."""

from __future__ import annotations

from importlib.resources import files

import pytest

from dart_hal.car import Fleet
from dart_hal.fleet.station import Station
from dart_lab.live.view.fleet_desk import FleetPage
from dart_lab.live.view.player import Player
from dart_lab.live.view.rows import FIELDS
from tests.live.view.browser import PHONE
from tests.live.view.sockets import live_page
from tests.live.view.test_browser_shows import WATCH, within

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
AXE = """
const done = arguments[0];
axe.run({ resultTypes: ['violations'] }).then((found) => done(found.violations
  .filter((one) => ['serious', 'critical'].includes(one.impact))
  .map((one) => one.id + ': ' + one.nodes.map((node) => node.target.join(' ')).join(', '))));
"""
EMPTY_CARDS = """
return [...document.querySelectorAll('main > section')].filter((one) => one.offsetParent
  && !one.innerText.replace('Notices', '').trim() && !one.querySelector('canvas'))
  .map((one) => one.className);
"""
PLOT = "const [one] = [plots.find((p) => p.root.parentElement.id === 'plot0')];"
LEGEND = "return document.querySelector('#plot0 .u-legend')?.innerText.replace(/\\s+/g, '') ?? ''"


def find_faults(browser):
    """Serious and critical findings of axe-core, in both colour schemes."""
    axe = files(pytest.importorskip("axe_core_python")).joinpath("axe.min.js").read_text("utf-8")
    found = []
    for scheme in ("light", "dark"):
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
            "features": [{"name": "prefers-color-scheme", "value": scheme}]})
        browser.run(axe)
        found += [f"{scheme}: {one}" for one in browser.driver.execute_async_script(AXE)]
    return found


def make_run(count=301, speed=lambda n: 0.0, car="test"):
    """A run of ``count`` rows, one each 10 ms."""
    rows = []
    for n in range(count):
        known = {"t": 5.0 + n / 100, "x": 0.01 * n, "y": 0.0, "yaw": 0.0, "speed": speed(n),
                 "steering": 0.005 * (n % 2), "throttle": 0.0}
        rows.append([known.get(name) for name in FIELDS])
    return {"type": "run", "car": car, "url": "", "fields": FIELDS, "scans": [], "images": [],
            "rows": rows}


BADGES = ("ARMED", "ARMING", "DISARMED", "TRIPPED", "LOCKED", "FAULT", "RAW", "gone", "full",
          "no news")


def test_axe_finds_nothing_serious_on_the_page_of_a_car(browsers):
    with live_page(url="sim://?nano=mock&pace=1&lidar=1&map=room") as (_, page):
        one = browsers()
        one.open(page.urls[0], PHONE)
        one.until("speed", "numbers")
        one.press("take")
        one.until("Let go of the wheel", "take")
        one.press("stop")
        one.until("STOP was pressed", "said")
        assert find_faults(one) == []
        one.open(page.urls[0])
        assert find_faults(one) == []
        # Each badge with the class of the page.
        one.run("document.querySelector('header').append(...arguments[0].map((text) => {"
                "const one = document.createElement('span'); one.textContent = text;"
                "one.className = `badge ${text.replace(/ /g, '-')}`; return one; }));"
                .replace("arguments[0]", str(list(BADGES))))
        assert find_faults(one) == []
        page.close()
        one.until("gone", "mode")
        assert find_faults(one) == []
        one.run("document.querySelector('.badge.ARMED').style.background = '#2fd0a0'")
        (control,) = {fault.partition(": ")[2].partition(":")[0] for fault in find_faults(one)}
        assert control == "color-contrast"


def test_axe_finds_nothing_serious_on_the_pages_of_a_run_and_of_a_fleet(browsers):
    one = browsers()
    with Player(make_run(), 0, lan=False) as player:
        one.open(player.urls[0])
        one.until("recorded", "mode")
        assert find_faults(one) == []
        one.run("document.getElementById('near').removeAttribute('aria-label');"
                "document.getElementById('near').textContent = ''")
        assert any("button-name" in fault for fault in find_faults(one)), "control"
    with Fleet.open(["sim://?nano=mock&pace=1"], room="local://axe") as fleet, \
            Station("local://axe") as station, FleetPage([station], 0, lan=False) as page:
        one.open(page.urls[0])
        for _ in fleet.states(duration=2.0):
            pass
        within(30.0, lambda: one.run("return document.querySelectorAll('article').length") == 1)
        assert find_faults(one) == []


def open_run(one, player):
    """Open a run that is paused at its end, with its plots made again under WATCH."""
    one.open(f"{player.urls[0]}#t=3")
    one.until("recorded", "mode")
    # The page draws each 100 ms: without this wait, WATCH could see the first plots, too.
    within(30.0, lambda: one.run("return document.querySelectorAll('.uplot').length") == 2)
    one.run(WATCH)
    one.run("matchMedia('x'); const menu = document.getElementById('channel0');"
            "menu.value = 'yaw rate'")
    within(30.0, lambda: one.run("return plots.length") == 1)
    one.run("document.getElementById('channel0').value = 'speed'")
    within(30.0, lambda: one.run("return plots.length") == 2)
    one.run("plots.shift()")


def test_a_plot_has_a_legend_with_unit_and_a_sensible_range_at_rest(browsers):
    with Player(make_run(), 0, lan=False) as player:
        one = browsers()
        open_run(one, player)
        within(30.0, lambda: "speed0.000m/s" in one.run(LEGEND))
        assert one.run(PLOT + "return [one.scales.y.min, one.scales.y.max]") == [0, 0.5]
        steering = one.run("return document.querySelector('#plot1 .u-legend').innerText")
        assert "requested" in steering
        assert "applied" in steering
        assert " rad" in steering
        # Equal commands: the one below is wider, so that both are visible.
        one.run("const [a, b] = ['channel0', 'channel1'].map((id) => document.getElementById(id));"
                "a.value = b.value")
        widths = "return plots.at(-1).series.slice(1).map((series) => series.width)"
        within(30.0, lambda: len(one.run(widths)) == 2)
        requested, applied = one.run(widths)
        assert requested > 2.0 * applied


def test_lidar_points_do_not_cross_the_scale_of_the_floor(browsers):
    reds = ("const pen = document.getElementById('floor').getContext('2d');"
            "const { height } = pen.canvas;"
            "const { data } = pen.getImageData(5, height - 24, 60, 18);"
            "return data.filter((v, n) => n % 4 === 0 && v > 150 && data[n + 1] < 60).length")
    with Player(make_run(), 0, lan=False) as player:
        one = browsers()
        one.open(f"{player.urls[0]}#t=3")
        one.until("recorded", "mode")
        within(30.0, lambda: one.run("return document.querySelectorAll('.uplot').length") == 2)
        one.run("const points = []; for (let n = 0; n < 4e5; n++) points.push("
                "20 * Math.random() - 10, 20 * Math.random() - 10); Floor.scan(points)")
        above = reds.replace("height - 24", "height - 80")
        within(30.0, lambda: one.run(above) > 100)
        assert one.run(reds) == 0


def test_a_plot_shows_the_value_at_the_cursor_and_zooms(browsers):
    with Player(make_run(speed=lambda n: n / 100), 0, lan=False) as player:
        one = browsers()
        open_run(one, player)
        within(30.0, lambda: "speed3.000m/s" in one.run(LEGEND))
        one.run(PLOT + "one.setCursor({ left: one.valToPos(6.5, 'x'), top: 20 })")
        within(30.0, lambda: "time6.50sspeed1.500m/s" in one.run(LEGEND))
        one.run(PLOT + "one.setCursor({ left: -10, top: -10 });"
                       "const left = one.valToPos(6, 'x'), width = one.valToPos(7, 'x') - left;"
                       "one.setSelect({ left, width, top: 0, height: 99 })")
        limits = PLOT + "return [one.scales.x.min, one.scales.x.max]"
        assert one.run(limits) == pytest.approx([6.0, 7.0], abs=0.05)
        one.run("Plots.add({ t: 9, speed: 1 })")
        within(30.0, lambda: one.run(limits) == pytest.approx([6.0, 7.0], abs=0.05))
        one.run("document.querySelector('#plot0 .u-over').dispatchEvent("
                "new MouseEvent('dblclick', { bubbles: true }))")
        within(30.0, lambda: one.run(limits) == pytest.approx([5.0, 9.0], abs=0.05))


def test_no_card_is_empty_and_all_numbers_are_in_sight_on_a_desk(browsers):
    one = browsers()
    with live_page() as (_, page):
        one.open(page.urls[0])
        one.until("speed", "numbers")
        assert one.run(EMPTY_CARDS) == []
        bottom = one["side"].rect["y"] + one["side"].rect["height"]
        assert bottom <= one["stop"].rect["y"], "and not behind STOP"
    with Player(make_run(), 0, lan=False) as player:
        one.open(player.urls[0])
        one.until("speed", "numbers")
        assert one.run(EMPTY_CARDS) == []
        for name in ("floor", "side", "bar"):
            box = one[name].rect
            assert box["y"] + box["height"] <= 800
            assert box["height"] > 30
        one.run("document.querySelector('.said').hidden = false;"
                "document.getElementById('said').replaceChildren()")
        assert one.run(EMPTY_CARDS) == ["said"], "control"


def test_values_are_dimmed_when_the_server_is_gone(browsers):
    with live_page() as (_, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("speed", "numbers")
        within(30.0, one["take"].is_enabled)
        opacity = "return getComputedStyle(document.getElementById('floor')).opacity"
        assert one.run(opacity) == "1"
        page.close()
        within(30.0, lambda: one.run(opacity) == "0.4")
        assert not one["take"].is_enabled()
        one.until("values of", "link")
