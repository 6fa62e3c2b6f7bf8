"""Parameters of the Nano from a terminal: written, confirmed, refused."""

from __future__ import annotations

import pytest

from dart_hal.cli import parameter
from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.messages import PARAMS
from dart_lab.sim.cutoff import CUTOFFS
from tests.common import MOCK_URL, ROOT


@pytest.mark.slow_except("safety_out-mux-2")
@pytest.mark.parametrize(("name", "value", "now"), [
    ("safety_out", "mux", 2), ("safety_out", "oe", 1), ("safety_out", "0", 0), ("ring_b", "1", 1)])
def test_it_is_written_and_confirmed(verb, name, value, now):
    assert verb("parameter", name, value, "--url", MOCK_URL).out.startswith(f"{name} = {now};")
    answer = verb("parameter", name, value, "--url", MOCK_URL, "--json").json
    assert (answer["parameter"], answer["value"]) == (name, now)


@pytest.mark.slow
@pytest.mark.emulator
def test_the_firmware_confirms(verb):
    try:
        open_backend("avr://default").close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    ran = verb("parameter", "safety_out", "mux", "--url", "avr://default")
    assert ran.code == 0
    assert "safety_out = 2;" in ran.out


@pytest.mark.slow
@pytest.mark.emulator
def test_what_the_firmware_refuses_is_reported_at_once(verb):
    """There is no Optiboot under this address: its watchdog would reset for ever."""
    try:
        open_backend("avr://default").close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    error = verb("parameter", "wdt_reset", "1", "--url", "avr://default", "--json").error
    assert error["what"] == "the Nano refuses wdt_reset = 1"
    assert error["found"] == "it stays 0"


@pytest.mark.slow
@pytest.mark.emulator
def test_what_it_confirms_is_in_the_eeprom():
    """The Nano may lose its supply in the moment of the answer."""
    try:
        backend = open_backend("avr://default")
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    param, value = parameter.parse_parameter("safety_out", "mux")
    assert parameter.write_parameter(backend, param, value) == 2
    nano = backend.link.nano
    nano.reset("power")
    nano.run(nano.now + 0.3)
    assert nano.pins()["D5"] == 0  # driven: the multiplexer is fitted
    backend.close()


@pytest.mark.parametrize(("args", "message"), [
    (("safety_out", "3"), "0 to 2 (none, oe, mux)"),
    (("safety_out", "multiplexer"), "safety_out cannot be 'multiplexer'"),
    (("ring_c", "1"), "there is no parameter 'ring_c'"),
    (("ring_b",), "Missing argument 'VALUE'"),
])
def test_nothing_is_sent_for_a_wrong_word(verb, monkeypatch, args, message):
    monkeypatch.setattr(parameter, "open_backend", lambda url: pytest.fail("opened"))
    ran = verb("parameter", *args, "--url", MOCK_URL)
    assert ran.code == 2
    assert message in ran.err


def test_a_silent_nano_is_reported(verb, monkeypatch):
    monkeypatch.setattr(parameter, "encode", lambda *_: b"")
    error = verb("parameter", "ring_b", "1", "--url", MOCK_URL, "--json").error
    assert error["what"] == "the Nano did not confirm ring_b"


def test_help_lists_every_parameter(verb):
    text = " ".join(verb("parameter", "--help").out.split())
    for param in PARAMS:
        assert f"{param.name} {param.low} to {param.high}: {param.doc}" in text


def test_words_of_the_cut_off_are_those_of_guide_and_simulation():
    text = (ROOT / "docs" / "build_guide" / "06_wiring.md").read_text(encoding="utf-8")
    assert parameter.CUTOFF_WORDS == CUTOFFS
    for word in ("mux", "oe"):
        assert f"dart-hal parameter safety_out {word}" in text
