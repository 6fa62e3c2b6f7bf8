"""What may come in: origins, hosts, tokens, messages."""

from __future__ import annotations

import json
from contextlib import suppress

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_lab.live.view import access
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import LOOPBACK, Access
from dart_lab.live.view.messages import MalformedMessage, parse_message
from dart_lab.live.view.operator import MAX_WRONG_TOKENS, Operator, Refused


@pytest.mark.parametrize("message", [m.Stop(), m.Take("x"), m.DriveRequest(0.5, -1.0, 3.25),
                                     m.Release(), m.Release(3.5), m.Record(True)])
def test_what_a_page_may_send_is_read_back(message):
    assert parse_message(msgspec.json.encode(message)) == message


@pytest.mark.parametrize("text", [
    "", "{", "[]", "null", '"stop"', '{"type":"go"}', '{"type":"stop","x":1}', '{"type":"take"}',
    '{"type":"take","token":7}', '{"type":"drive","steering":1,"throttle":"1","heard":0}',
    '{"type":"drive","steering":0,"throttle":1,"heard":0,"unchanged":1e999}',
    '{"type":"drive","steering":NaN,"throttle":1,"heard":0}',
    '{"type":"drive","steering":1e999,"throttle":1,"heard":0}', '{"type":"drive"}',
    '{"type":"take","token":"' + "x" * 5000 + '"}', "[" * 900, b"\xff\xfe", b"\x00" * 40])
def test_everything_else_is_refused(text):
    with pytest.raises(MalformedMessage):
        parse_message(text)


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200), st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=12).map(json.dumps)))
def test_nothing_that_comes_raises_another_error(data):
    with suppress(MalformedMessage):
        parse_message(data)


ACTS = ("take", "leave", "release", "drive", "stop", "armed", "wanted")


@given(st.lists(st.tuples(st.sampled_from(ACTS), st.sampled_from("ab"), st.floats(-0.1, 0.4),
                          st.floats(0.0, 0.3)), max_size=60))
def test_only_the_driver_is_obeyed_and_not_for_long(steps):
    """A reference that keeps no state but the last command of the page that holds the wheel."""
    one = Operator(Access(1, token="t"))
    now = 10.0
    last = None
    for what, page, old, later in steps:
        now += later
        try:
            if what == "take":
                one.take(page, "t")
            elif what == "leave":
                one.remove_page(page)
            elif what == "release":
                one.release(page)
            elif what == "drive":
                one.drive(page, 0.5, 0.5, now - old, now)
                last = (page, now - old)
            elif what == "stop":
                one.stop()
            elif what == "armed":
                one.require_release()
        except Refused:
            pass
        command = one.current_command(now)
        if command is not None:
            assert last is not None
            assert one.page == last[0]
            assert now < last[1] + 0.2
            assert what not in ("stop", "armed")
            assert not (what in ("leave", "release") and page == last[0])
            assert 0.0 < command.remaining_s <= 0.2


def test_wrong_tokens_are_counted_and_the_page_sent_away():
    one = Operator(Access(1, token="right"))
    for n in range(MAX_WRONG_TOKENS):
        with pytest.raises(Refused) as refused:
            one.take("page", f"wrong{n}")
        assert refused.value.away is (n == MAX_WRONG_TOKENS - 1)
    assert one.page is None
    one.take("page", "right")


@pytest.fixture
def own_files(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


def test_the_token_of_a_page_survives_a_restart(own_files):
    token = access.load_token()
    assert len(token) >= access.MIN_TOKEN_LENGTH
    assert access.load_token() == token
    assert access.token_file().stat().st_mode & 0o777 == 0o600
    access.token_file().unlink()
    assert access.load_token() != token, "a new token after the file was removed"


@pytest.mark.parametrize(("text", "mode"), [("correct-horse-battery", 0o644), ("short", 0o600),
                                            ("", 0o600), ("\u00e4" * 20, 0o600)])
def test_a_token_that_others_could_know_is_not_used(own_files, text, mode):
    path = access.token_file()
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    assert access.load_token() != text
    assert len(access.load_token()) >= access.MIN_TOKEN_LENGTH


def test_a_folder_that_cannot_be_written_gives_a_new_token(monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", "/dev/null/none")
    assert access.load_token() != access.load_token()


def test_the_address_has_the_token_behind_its_hash():
    made = Access.of_this_computer(8642, lan=False)
    (url,) = made.urls
    assert url == f"http://localhost:8642/#{made.token}"
    assert len(made.token) >= 12
    assert made.token != Access.of_this_computer(8642, lan=False).token


def test_the_addresses_for_other_computers_come_first():
    names = (*LOOPBACK, "10.0.0.5", "192.168.1.7", "car")
    assert Access(8642, lan=True, token="t", names=names).urls == (
        "http://10.0.0.5:8642/#t", "http://192.168.1.7:8642/#t", "http://localhost:8642/#t")
    assert Access(8642, token="t", names=names).urls == ("http://localhost:8642/#t",)


def test_own_addresses_are_those_of_the_routes_once_and_not_loopback(monkeypatch):
    """The second route has the address of the first; the port of a socket is none."""
    sources = iter(["10.0.0.5", "10.0.0.5", "127.0.0.1", "192.168.1.7"])

    class CommandProbe:
        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def connect(self, address):
            self.name = (next(sources), 40000)

        def getsockname(self):
            return self.name

    monkeypatch.setattr(access.socket, "socket", lambda *kind: CommandProbe())
    assert access.own_addresses() == ("10.0.0.5",)
    assert access.own_addresses() == ("192.168.1.7",)


@pytest.mark.parametrize(("host", "own"), [
    ("localhost:8642", True), ("127.0.0.1:8642", True), ("[::1]:8642", True),
    ("localhost", False), ("evil.example:8642", False), ("localhost:8642.evil.example", False),
    ("", False), ("x" * 4000, False)])
def test_only_names_of_this_computer_are_served(host, own):
    made = Access.of_this_computer(8642, lan=False)
    assert made.is_own_host(host) is own
    assert made.is_own_origin(f"http://{host}") is own
    assert not made.is_own_origin(f"https://{host}")


def test_the_address_at_which_a_visitor_arrived_is_served_in_a_network_of_its_own():
    """Without a route to the internet this computer does not know its addresses."""
    open_page = Access(8642, lan=True, names=("localhost", "Lab-PC"))
    assert open_page.is_own_host("10.42.0.1:8642", "10.42.0.1")
    assert open_page.is_own_host("lab-pc:8642")
    assert not open_page.is_own_host("evil.example:8642", "10.42.0.1")
    assert not open_page.is_own_host("10.42.0.2:8642", "10.42.0.1")
    assert not Access(8642, names=("localhost",)).is_own_host("10.42.0.1:8642", "10.42.0.1")
    assert Access(80, names=("localhost",)).is_own_host("localhost")


@pytest.mark.parametrize("answers", [True, False])
def test_an_armed_car_is_disarmed_unless_its_page_answers(answers):
    one = Operator(Access(1, token="t"))
    one.take("a", "t")
    one.begin(10.0)
    assert one.current_command(10.9).throttle == 0.0
    if answers:
        one.release("a", 10.9, 10.9, "ARMED")
    one.current_command(11.05)
    assert one.take_end_reason() == ("" if answers else "silent")
    one.begin(20.0)
    assert one.remove_page("a", "ARMED")
    assert one.take_end_reason() == "gone"


def test_a_stick_held_during_arming_keeps_the_car_armed_and_does_not_drive():
    one = Operator(Access(1, token="t"))
    one.take("a", "t")
    one.drive("a", 0.5, 0.5, 9.9, 9.9)
    one.begin(10.0)
    for k in range(1, 40):
        now = 10.0 + 0.05 * k
        one.drive("a", 0.5, 0.5, now, now)
        assert one.current_command(now).throttle == 0.0
    one.release("a", now, now, "ARMED")
    one.drive("a", 0.5, 0.5, now, now)
    assert one.current_command(now).throttle == 0.5
