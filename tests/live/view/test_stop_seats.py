"""STOP when other pages have taken every place, and what a page of another origin may request."""

from __future__ import annotations

import logging
import socket
import time
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.http11 import Request

from dart_hal.fleet.station import Station
from dart_lab.live.view import messages as m
from dart_lab.live.view import server
from dart_lab.live.view.access import Access
from dart_lab.live.view.desk import Desk
from dart_lab.live.view.fleet_desk import FleetDesk, FleetPage
from tests.live.view.sockets import join, live_page, send_message, until

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("armed_esc")]
STOP_HEADER = {"X-Dart-Stop": "1"}


ALL_PLACES = server.MAX_PAGES


@pytest.fixture(autouse=True)
def few_places(monkeypatch):
    """As many clients as a page has places are slow to open and close."""
    monkeypatch.setattr(server, "MAX_PAGES", 4)


def request(page, path="/stop", method="GET", **headers):
    """Status and text of an answer."""
    request_of = urllib.request.Request(f"http://localhost:{page.access.port}{path}", method=method,
                                        headers={name.replace("_", "-"): value
                                                 for name, value in headers.items()})
    try:
        with urllib.request.urlopen(request_of, timeout=5.0) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read().decode()


def wait_until_tripped(car, within=1.0):
    ends = time.monotonic() + within
    while car.mode != "TRIPPED" and time.monotonic() < ends:
        time.sleep(0.01)
    return car.mode == "TRIPPED"


def fill_places(page, stack, extra=0):
    """Pages that take every place, the first of which come at once."""
    opened = [stack.enter_context(join(page)) for _ in range(server.MAX_PAGES - extra)]
    ends = time.monotonic() + 5.0
    while len(page._server._pages) < server.MAX_PAGES and time.monotonic() < ends:
        time.sleep(0.01)
    assert len(page._server._pages) == server.MAX_PAGES
    return opened


def code_of_end(opened):
    """Read until the server closes this page; the code that it states."""
    with pytest.raises(ConnectionClosed) as closed:
        read_on(opened)
    return closed.value.rcvd.code


def read_on(opened):
    while True:
        opened.recv(timeout=10.0)


def arm(page, driver):
    """Take the wheel and arm; a busy computer is refused at times, as frames come late."""
    send_message(driver, type="take", token=page.access.token)
    for _ in range(4):
        send_message(driver, type="arm")
        with suppress(TimeoutError):
            until(driver, "status", where=lambda s: s["mode"] == "ARMED")
            return
    raise AssertionError("the car does not arm")


@pytest.mark.slow
def test_stop_needs_no_place_at_a_page_that_is_really_full(monkeypatch):
    monkeypatch.setattr(server, "MAX_PAGES", ALL_PLACES)
    test_stop_needs_no_place_and_takes_none_from_who_drives()


def test_stop_needs_no_place_and_takes_none_from_who_drives():
    with live_page() as (car, page), join(page) as driver, ExitStack() as stack:
        arm(page, driver)
        fill_places(page, stack, extra=1)
        assert request(page, **STOP_HEADER) == (200, "stopped")
        assert wait_until_tripped(car)
        assert until(driver, "status", where=lambda s: s["mode"] == "TRIPPED")["driven"]


def newcomer(page, stack):
    """A page that comes last, at the first moment at which a place is made free for it."""
    ends = time.monotonic() + 5.0
    while True:
        try:
            return stack.enter_context(join(page))
        except InvalidStatus:
            assert time.monotonic() < ends
            time.sleep(0.05)


def test_a_newcomer_takes_the_place_of_who_watched_longest_and_never_of_who_drives():
    with live_page() as (car, page), join(page) as driver, ExitStack() as stack:
        arm(page, driver)
        opened = fill_places(page, stack, extra=1)
        for n in range(3):
            new = newcomer(page, stack)
            assert code_of_end(opened[n]) == server.REPLACED
        assert until(driver, "status")["driven"]
        assert car.mode == "ARMED"
        send_message(new, type="stop")
        assert wait_until_tripped(car)


def test_control_a_driver_that_is_no_exception_loses_the_wheel(monkeypatch):
    monkeypatch.setattr(Desk, "is_driver", lambda self, page: False)
    with live_page() as (_, page), join(page) as driver, ExitStack() as stack:
        arm(page, driver)
        fill_places(page, stack, extra=1)
        newcomer(page, stack)
        assert code_of_end(driver) == server.REPLACED


def test_a_flood_of_sockets_replaces_few_pages_a_second():
    with live_page() as (_, page), ExitStack() as stack:
        fill_places(page, stack)
        began = time.monotonic()
        came = 0
        refused = 0
        while refused < 60:
            try:
                stack.enter_context(join(page))
                came += 1
            except InvalidStatus:
                refused += 1
        assert came <= 2 + (time.monotonic() - began) / server.MIN_REPLACE_PERIOD_S


def test_a_page_of_another_origin_replaces_no_page():
    with live_page() as (_, page), ExitStack() as stack:
        fill_places(page, stack)
        for _ in range(3):
            with pytest.raises(InvalidStatus), join(page, origin="http://evil.example"):
                pass
            time.sleep(0.25)
        assert len(page._server._pages) == server.MAX_PAGES


@pytest.mark.slow
def test_control_without_that_request_a_newcomer_at_a_full_page_cannot_stop(monkeypatch):
    monkeypatch.setattr(server, "STOP_PATH", "/none")
    with live_page() as (car, page), join(page) as driver, ExitStack() as stack:
        arm(page, driver)
        fill_places(page, stack, extra=1)
        assert request(page, **STOP_HEADER)[0] == 404
        assert not wait_until_tripped(car)


@pytest.mark.parametrize(("headers", "status"), [
    ({}, 403), (STOP_HEADER, 200), ({"Origin": "http://evil.example"}, 403),
    (STOP_HEADER | {"Origin": "http://evil.example"}, 403),
    (STOP_HEADER | {"Host": "evil.example"}, 403)])
def test_a_page_of_another_origin_stops_nothing(headers, status):
    """A browser sends no such header for another origin without our consent."""
    with live_page() as (car, page):
        assert request(page, **headers)[0] == status
        assert bool(car._engine.driver.holders) is (status == 200)


@pytest.mark.skipif(not hasattr(Request, "method") and "method" not in Request.__annotations__,
                    reason="websockets before 17 takes no POST")
def test_a_post_of_a_program_or_of_our_own_page_stops():
    with live_page() as (car, page):
        assert request(page, method="POST", Origin="http://evil.example")[0] == 403
        assert not car._engine.driver.holders
        own = f"http://localhost:{page.access.port}"
        assert request(page, method="POST", Origin=own) == (200, "stopped")
        assert request(page, method="POST") == (200, "stopped")
        assert car._engine.driver.holders


def test_connections_that_request_nothing_do_not_keep_others_out():
    with live_page() as (car, page), join(page) as driver, ExitStack() as stack:
        for _ in range(3 * server.MAX_HANDSHAKES):
            idle = stack.enter_context(socket.create_connection(("localhost", page.access.port)))
            idle.sendall(b"GET /stop HTTP/1.1\r\n")
        arm(page, driver)
        assert request(page, **STOP_HEADER) == (200, "stopped")
        assert len(page._server._handshakes) <= server.MAX_HANDSHAKES
        assert wait_until_tripped(car)
        until(driver, "status", where=lambda s: s["driven"])


def test_control_without_the_limit_they_are_all_kept(monkeypatch):
    monkeypatch.setattr(server, "MAX_HANDSHAKES", 10**6)
    with live_page() as (_, page), ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(socket.create_connection(("localhost", page.access.port)))
        ends = time.monotonic() + 5.0
        while len(page._server._handshakes) < 200 and time.monotonic() < ends:
            time.sleep(0.02)
        assert len(page._server._handshakes) == 200


def test_the_page_of_a_fleet_stops_without_a_place(monkeypatch):
    calls = []
    monkeypatch.setattr(Station, "call_stop", lambda self, why: calls.append(why))
    monkeypatch.setattr(Station, "press", lambda self: False)
    monkeypatch.setattr(FleetDesk, "batch", lambda self: ())
    with Station("local://full") as station, FleetPage([station], 0, lan=False) as page, \
            ExitStack() as stack:
        fill_places(page, stack)
        assert request(page, **STOP_HEADER) == (200, "stopped")
        assert calls == ["STOP at the page of the fleet"]


def test_the_token_is_in_no_text_of_an_object_and_in_no_log(caplog):
    token = "correct-horse"
    access = Access.of_this_computer(8642, lan=True, token=token)
    read = m.parse_message(f'{{"type":"take","token":"{token}"}}')
    for value in (access, [access], read, {"message": read}):
        assert token not in f"{value} {value!r}"
    with caplog.at_level(logging.DEBUG), live_page() as (_, page), join(page) as one:
        send_message(one, type="take", token=page.access.token)
        until(one, "yours")
        send_message(one, type="take", token=page.access.token, more=1)
        assert page.access.token not in until(one, "said")["text"]
        assert page.access.token not in f"{page!r} {page.access} {page.desk!r}"
        served = [record for record in caplog.records if record.name != "websockets.client"]
        assert page.access.token not in " ".join(record.getMessage() for record in served)


def test_control_the_library_logs_messages_where_it_may(caplog):
    """At DEBUG the client, which is in this process too, writes what it sends."""
    with caplog.at_level(logging.DEBUG), live_page() as (_, page), join(page) as one:
        send_message(one, type="take", token=page.access.token)
        until(one, "yours")
        assert page.access.token in caplog.text


def test_a_page_that_ends_right_after_its_stop_leaves_the_car_free():
    """A program ends with STOP, and its page with it: nothing else released the run-stop."""
    with live_page() as (car, page):
        assert request(page, **STOP_HEADER) == (200, "stopped")
        assert car._engine.driver.holders, "negative control"
        page.close()
        assert not car._engine.driver.holders
