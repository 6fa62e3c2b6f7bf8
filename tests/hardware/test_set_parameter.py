"""Parameters of the Nano from a terminal: written, confirmed, refused."""

from __future__ import annotations

import sys

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.cutoff import CUTOFFS
from tests.common import MOCK_URL, ROOT

sys.path.insert(0, str(ROOT / "hardware"))

import set_parameter


def run(monkeypatch, *args: str) -> int:
    monkeypatch.setattr(sys, "argv", ["set_parameter.py", *args])
    return set_parameter.main()


@pytest.mark.parametrize(("name", "value", "now"), [
    ("safety_out", "mux", 2), ("safety_out", "oe", 1), ("safety_out", "0", 0), ("ring_b", "1", 1)])
def test_it_is_written_and_confirmed(monkeypatch, capsys, name, value, now):
    assert run(monkeypatch, name, value, MOCK_URL) == 0
    assert capsys.readouterr().out.startswith(f"{name} = {now};")


@pytest.mark.emulator
def test_the_firmware_confirms(monkeypatch, capsys):
    try:
        open_backend("avr://default").close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    assert run(monkeypatch, "safety_out", "mux", "avr://default") == 0
    assert "safety_out = 2;" in capsys.readouterr().out


@pytest.mark.emulator
def test_what_the_firmware_refuses_is_reported_at_once(monkeypatch, capsys):
    """There is no Optiboot under this address: its watchdog would reset for ever."""
    try:
        open_backend("avr://default").close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    assert run(monkeypatch, "wdt_reset", "1", "avr://default") == 2
    message = capsys.readouterr().err
    assert "the Nano refuses wdt_reset = 1" in message
    assert "it stays 0" in message


@pytest.mark.emulator
def test_what_it_confirms_is_in_the_eeprom(monkeypatch):
    """The Nano may lose its supply in the moment of the answer."""
    try:
        backend = open_backend("avr://default")
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    param, value = set_parameter.wanted("safety_out", "mux")
    assert set_parameter.write(backend, param, value) == 2
    nano = backend.link.nano
    nano.reset("power")
    nano.run(nano.now + 0.3)
    assert nano.pins()["D5"] == 0  # driven: the multiplexer is fitted
    backend.close()


@pytest.mark.parametrize(("args", "message"), [
    (("safety_out", "3", MOCK_URL), "0 to 2 (none, oe, mux)"),
    (("safety_out", "multiplexer", MOCK_URL), "safety_out cannot be 'multiplexer'"),
    (("ring_c", "1", MOCK_URL), "there is no parameter 'ring_c'"),
    (("ring_b",), "a name and a value are needed"),
])
def test_nothing_is_sent_for_a_wrong_word(monkeypatch, capsys, args, message):
    monkeypatch.setattr(set_parameter, "open_backend", lambda url: pytest.fail("opened"))
    assert run(monkeypatch, *args) == 2
    assert message in capsys.readouterr().err


def test_a_silent_nano_is_reported(monkeypatch, capsys):
    monkeypatch.setattr(set_parameter, "encode", lambda *_: b"")
    assert run(monkeypatch, "ring_b", "1", MOCK_URL) == 2
    assert "did not confirm ring_b" in capsys.readouterr().err


def test_the_words_are_those_of_the_guide():
    text = (ROOT / "docs" / "build_guide" / "06_wiring.md").read_text(encoding="utf-8")
    for word in ("mux", "oe"):
        assert f"hardware/set_parameter.py safety_out {word}" in text
        assert word in CUTOFFS
