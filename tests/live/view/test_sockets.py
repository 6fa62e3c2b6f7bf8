"""The page over real sockets, in real time: who gets in, what arrives, who delays whom."""

from __future__ import annotations

import hashlib
import json
import re
import time
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress
from itertools import pairwise
from pathlib import Path
from socket import SO_RCVBUF, SOL_SOCKET

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

import dart_lab.live.view
from dart_hal.core.errors import UsageError
from dart_lab.live.view import server
from tests.live.view.junk import Junk
from tests.live.view.sockets import join, live_page, send_message, until

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("armed_esc")]
ROOM = Path(dart_lab.live.view.__file__).parent


def fetch(page, path, host=None):
    request = urllib.request.Request(f"http://127.0.0.1:{page.access.port}{path}")
    if host:
        request.add_header("Host", host)
    with urllib.request.urlopen(request, timeout=5.0) as answer:
        return answer.headers, answer.read()


def read_on(socket):
    while True:
        socket.recv(timeout=5.0)


def test_the_page_is_small_and_requests_nothing_from_elsewhere():
    with live_page(drives=False) as (_, page):
        headers, html = fetch(page, "/")
        assert "default-src 'self'" in headers["Content-Security-Policy"]
        parts = re.findall(rb'(?:src|href)="([^"]+)"', html)
        whole = len(html)
        for part in parts:
            if not part.startswith(b"data:"):
                assert not part.startswith((b"http", b"//"))
                whole += len(fetch(page, f"/{part.decode()}")[1])
        assert whole <= 100_000
        for path in ("/x", "/../pyproject.toml", "/vendor/../desk.py", "/desk.py"):
            with pytest.raises(urllib.error.HTTPError) as wrong:
                fetch(page, path)
            assert wrong.value.code == 404
        with pytest.raises(urllib.error.HTTPError) as wrong:
            fetch(page, "/", host=f"evil.example:{page.access.port}")
        assert wrong.value.code == 403


def test_vendored_files_are_those_that_were_published():
    stated = (ROOM / "vendor" / "README.md").read_text(encoding="utf-8")
    for name in server.VENDOR_FILES:
        assert hashlib.sha256((ROOM / "vendor" / name).read_bytes()).hexdigest() in stated


def test_a_foreign_page_gets_no_socket():
    with live_page(drives=False) as (_, page):
        for origin in ("http://evil.example", "null", f"https://localhost:{page.access.port}"):
            with pytest.raises(InvalidStatus) as refused:
                join(page, origin=origin)
            assert refused.value.response.status_code == 403
        with join(page, origin=f"http://localhost:{page.access.port}") as own:
            until(own, "begin")


def test_every_sample_arrives_at_each_of_five_pages():
    with live_page(drives=False) as (_, page), ExitStack() as opened:
        sockets = [opened.enter_context(join(page)) for _ in range(5)]
        times = [[] for _ in sockets]
        ends = time.monotonic() + 1.0
        while time.monotonic() < ends:
            for socket, own_times in zip(sockets, times, strict=True):
                own_times += [row[0] for row in until(socket, "rows")["rows"]]
        for own_times in times:
            steps = [round(100 * (b - a)) for a, b in pairwise(own_times)]
            assert len(steps) > 75
            assert set(steps) == {1}


@pytest.mark.slow  # until the kernel's buffers are full
def test_a_page_that_does_not_read_is_closed_and_delays_no_other(monkeypatch, caplog):
    monkeypatch.setattr(server, "MAX_WAITING_BYTES", 2_000)
    with live_page(drives=False) as (_, page), join(page) as stalled, join(page) as other:
        stalled.socket.setsockopt(SOL_SOCKET, SO_RCVBUF, 2048)  # little fits on the way
        began = time.monotonic()
        gaps = []
        last = time.monotonic()
        while time.monotonic() - began < 15.0 and "does not read" not in caplog.text:
            until(other, "rows")
            gaps.append(time.monotonic() - last)
            last = time.monotonic()
        assert max(gaps) < 0.5
        assert "does not read" in caplog.text


def test_a_drive_over_the_socket_and_its_wrong_turns():
    with live_page() as (car, page), join(page) as one, join(page) as two:
        send_message(one, type="take", token="wrong")
        assert "wrong token" in until(one, "said")["text"]
        send_message(one, type="take", token=page.access.token)
        until(one, "yours")
        two.send("nonsense")
        assert "invalid message" in until(two, "said")["text"]
        send_message(two, type="arm")
        assert "does not drive" in until(two, "said")["text"]
        send_message(one, type="arm")
        until(one, "status", where=lambda s: s["mode"] == "ARMED")
        moving = 0.0
        while moving < 0.3:
            news = until(one, "rows")
            moving = news["rows"][-1][4] if news["rows"] else moving
            send_message(one, type="drive", steering=0.2, throttle=0.8, heard=news["now"])
        send_message(two, type="stop")
        status = until(two, "status", where=lambda s: s["mode"] == "TRIPPED")
        assert status["trips"]["name"] == "RUN_STOP"
        assert car.mode == "TRIPPED"


def test_a_page_that_sends_too_much_or_only_guesses_is_closed():
    with live_page() as (_, page):
        with join(page) as huge:
            huge.send("x" * 100_000)
            with pytest.raises(ConnectionClosed):
                read_on(huge)
        with join(page) as guesser:
            for n in range(5):
                send_message(guesser, type="take", token=f"guess {n}")
            with pytest.raises(ConnectionClosed):
                read_on(guesser)
        with join(page) as good:
            until(good, "rows")


@pytest.mark.slow
def test_no_message_of_a_page_gains_control_and_others_are_served():
    """Random, huge, malformed and nearly right messages over real sockets, opened again where they
    were closed."""
    junk = Junk(7)
    with live_page() as (car, page), join(page) as good, ExitStack() as opened:
        other = opened.enter_context(join(page))
        sent = 0
        closed = 0
        ends = time.monotonic() + 30.0
        while (sent < 200 or closed < 3) and time.monotonic() < ends:
            sent += 1
            try:
                other.send(junk.draw())
                with suppress(TimeoutError):
                    while True:  # a client that reads nothing sees no end either
                        other.recv(timeout=0)
            except ConnectionClosed:
                other = opened.enter_context(join(page))
                closed = closed + 1
        assert closed >= 3, "a page that sends too much is closed"
        until(good, "rows", where=lambda m: m["rows"])
        assert until(good, "status")["driven"] is False
        assert car.mode == "DISARMED"
        assert car.recorder.path is None


def test_a_port_in_use_is_reported():
    with live_page(drives=False) as (car, page), \
            pytest.raises(UsageError, match="cannot be served"):
        car.view(port=page.access.port)


def test_a_page_may_come_late_and_the_program_may_end_first():
    with ExitStack() as opened:
        with live_page(drives=False) as (_, page):
            socket = opened.enter_context(join(page))
            assert json.loads(socket.recv(timeout=5.0))["type"] == "begin"
        with pytest.raises(ConnectionClosed):
            read_on(socket)
