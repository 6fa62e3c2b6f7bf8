"""The run that plays in the handbook: static files, no program behind them."""

from __future__ import annotations

import json
import sys
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from websockets.sync.client import connect

from dart_lab.live.view.player import Player
from dart_lab.live.view.rows import FIELDS

DOCS = Path(__file__).parents[3] / "docs"
sys.path.insert(0, str(DOCS))
import recorded_run  # noqa: E402 - beside the handbook

MOST = 300_000
"""Bytes of the run."""
LAP = 22.92
RESTS = 2.0
"""m, and of way until it rests."""


def test_the_run_is_small_and_a_whole_lap():
    assert recorded_run.RUN.stat().st_size <= MOST
    run = json.loads(recorded_run.RUN.read_text())
    assert tuple(run["fields"]) == FIELDS
    t, speed = ([row[n] for row in run["rows"]] for n in (0, FIELDS.index("speed")))
    assert t == sorted(t)
    way = sum(v * (b - a) for v, a, b in zip(speed, t, t[1:], strict=False))
    assert LAP <= way <= LAP + RESTS
    assert len(run["scans"]) >= 20
    assert all(0 <= n < len(run["rows"]) and len(points) % 2 == 0 for n, points in run["scans"])


def test_thinning_keeps_rows_and_scans_together():
    run = {"rows": list(range(21)), "url": "replay://x", "car": "c",
           "scans": [(n, list(range(8))) for n in range(0, 21, 2)]}
    thin = recorded_run.thinned(run)
    assert thin["rows"] == list(range(0, 21, 2))
    assert thin["scans"] == [(0, [0, 1, 4, 5]), (5, [0, 1, 4, 5]), (10, [0, 1, 4, 5])]
    assert [thin["rows"][n] for n, _ in thin["scans"]] == [0, 10, 20]


@pytest.fixture
def served_folder(tmp_path):
    """Address of a folder as the handbook's build leaves it, and its requests."""
    recorded_run.copy(tmp_path / "live")
    requests = []

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, text, *words):
            requests.append(words)

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path)))
    threading.Thread(target=server.serve_forever).start()
    yield f"http://127.0.0.1:{server.server_port}/live/index.html", requests
    server.shutdown()
    server.server_close()


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("name", ["run.json", "none.json"])
def test_it_plays_in_a_browser_without_a_program(browsers, served_folder, name):
    url, requests = served_folder
    one = browsers()
    one.open(f"{url}?run={name}")
    if name == "none.json":  # the control: without the run it reports it, and plays nothing
        one.until("none.json cannot be read", "said")
        assert not one["bar"].is_displayed()
        return
    one.until("recorded", "mode")
    before = one.text("at")
    time.sleep(1.5)
    assert one.text("at") != before, "it plays by itself"
    one.run("const bar = document.getElementById('time'); bar.value = 1;"
            "bar.dispatchEvent(new Event('input'))")
    rows = json.loads(recorded_run.RUN.read_text())["rows"]
    length = rows[-1][0] - rows[0][0]
    one.until(f"{length:.1f} s of {length:.1f} s", "at")
    assert not one["stop"].is_displayed()
    assert [log for log in one.driver.get_log("browser") if log["level"] == "SEVERE"] == []
    names = one.run("return performance.getEntriesByType('resource').map((e) => e.name)")
    assert all(part.startswith(url.rsplit("/", 1)[0]) for part in names)
    assert requests


@pytest.mark.slow
def test_a_long_run_reaches_a_page_that_reads_slowly():
    """Sent as one message, 6 MB were more than a page may have unread, and it was cut off."""
    rows = [[0.01 * k, *[1.234 + 1e-3 * k] * 13, 1e-7] for k in range(50_000)]
    run = {"type": "run", "car": "x", "url": "", "fields": FIELDS, "rows": rows, "scans": [],
           "images": []}
    with (Player(run, 0, False) as player,
          connect(f"ws://localhost:{player.access.port}/socket", max_size=None,
                  max_queue=1) as page):
        time.sleep(0.3)     # ten batches, each of which would cut it off
        text = page.recv(timeout=20.0)
    assert len(text) > 5_000_000
    assert len(json.loads(text)["rows"]) == len(rows)
