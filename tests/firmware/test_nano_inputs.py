"""RC and BATTERY of the firmware, of MockNano by the same script, and what they cost."""

from __future__ import annotations

import pytest
from firmware_rig import Rig, eeprom_image

from dart_hal.wire.messages import BEAT_REQUESTS
from dart_lab.sim.mock_nano import MockNano

REQUEST_BOTH = sum(BEAT_REQUESTS.values())
PULSES_US = {"D10": 1234.0, "D11": 1750.0, "D12": 2000.0}
PWM_PERIOD_S = 0.02
PCINT0 = 3


@pytest.fixture(params=["firmware", "mock"])
def any_nano(request, nano, elf) -> Rig:
    """A rig that runs; the firmware's, or with MockNano in its place."""
    rig = nano(elf)
    if request.param == "mock":
        rig.nano.close()
        rig.nano = MockNano(eeprom=eeprom_image())
    rig.run(1.0)
    return rig


def pulse_train(rig: Rig, seconds: float, flags: int = REQUEST_BOTH,
                pulses_us: dict[str, float] | None = None) -> list[tuple[float, str, dict]]:
    """Heartbeats and pulses, one channel after the other; return the frames."""
    pulses = PULSES_US if pulses_us is None else pulses_us
    start = len(rig.frames)
    token = rig.hello()["boot_nonce"]
    for _ in range(round(seconds / PWM_PERIOD_S)):
        begin = rig.now
        rig.send("HEARTBEAT", arm_token=token, flags=flags)
        for pin, width in pulses.items():
            rig.nano.set_pin(pin, True)
            rig.run(1e-6 * width)
            rig.nano.set_pin(pin, False)
        rig.run(begin + PWM_PERIOD_S - rig.now)
    return rig.frames[start:]


def select(frames: list[tuple[float, str, dict]], name: str) -> list[dict]:
    return [values for _, kind, values in frames if kind == name]


def test_pulses_are_measured_to_the_microsecond(any_nano: Rig) -> None:
    found = select(pulse_train(any_nano, 1.0), "RC")
    assert len(found) == pytest.approx(50, abs=2)
    for message in found[10:]:
        widths = [0.5 * pulse for pulse in message["pulse"]]
        assert widths == pytest.approx(list(PULSES_US.values()), abs=8.0)
        assert max(message["age"]) <= 22
    middle = sorted(0.5 * message["pulse"][1] for message in found[10:])[len(found[10:]) // 2]
    assert middle == pytest.approx(PULSES_US["D11"], abs=1.0)


def test_nothing_is_sent_without_a_request(any_nano: Rig) -> None:
    """Control: with it, both messages come; and they end with the heartbeats."""
    frames = pulse_train(any_nano, 0.5, flags=0)
    assert not select(frames, "RC")
    assert not select(frames, "BATTERY")
    frames = pulse_train(any_nano, 0.5)
    assert select(frames, "RC")
    assert select(frames, "BATTERY")
    any_nano.run(0.15)
    frames = any_nano.run(0.5)
    assert not select(frames, "RC")
    assert not select(frames, "BATTERY")


@pytest.mark.parametrize(("volt", "pin", "pulled"), [(2.5, 2044, 601), (0.0, 0, 180),
                                                     (4.0, 3272, 854)])
def test_counts_of_the_divider(any_nano: Rig, volt: float, pin: int, pulled: int) -> None:
    any_nano.nano.set_divider(volt)
    found = select(pulse_train(any_nano, 0.5), "BATTERY")
    assert len(found) >= 3
    assert (found[-1]["pin"], found[-1]["reference"]) == (pin, 900)
    assert found[-1]["pulled"] == pytest.approx(pulled, abs=2)


def test_the_supply_is_measured_all_the_while(nano, elf) -> None:
    rig = nano(elf)
    rig.run(1.0)
    pulse_train(rig, 1.2)
    assert select(rig.frames, "DIAG")[-1]["vcc_mv"] == pytest.approx(5000, abs=60)


def test_an_open_pin_is_held_by_its_pull_up(any_nano: Rig) -> None:
    any_nano.nano.set_divider(None)
    assert {m["pulled"] for m in select(pulse_train(any_nano, 0.5), "BATTERY")} == {1023}


@pytest.mark.slow
def test_a_noisy_pin_costs_a_bounded_time_and_no_frame(nano, elf) -> None:
    """50,000 edges per second at D10 for half a second. Control: the calm pin is measured."""
    rig = nano(elf)
    rig.run(1.0)
    token = rig.hello()["boot_nonce"]
    before = rig.nano.isr(PCINT0)
    start = rig.now
    level = False
    while rig.now < start + 0.5:
        if round((rig.now - start) / 20e-6) % 1000 == 0:
            rig.send("HEARTBEAT", arm_token=token, flags=BEAT_REQUESTS["RC"])
        level = not level
        rig.nano.set_pin("D10", level)
        rig.run(20e-6)
    served = rig.nano.isr(PCINT0)
    assert served.n - before.n <= 16 * 51
    assert served.max <= 150
    assert len(rig.states(start)) == pytest.approx(50, abs=1)
    assert select(rig.frames, "DIAG")[-1]["loop_overruns"] == 0
    assert {m["pulse"] for m in select(rig.frames, "RC")} == {(0, 0, 0)}
    rig.nano.set_pin("D10", False)
    assert select(pulse_train(rig, 0.3), "RC")[-1]["pulse"][0] == pytest.approx(2468, abs=16)


def test_a_restart_forgets_the_request(any_nano: Rig) -> None:
    pulse_train(any_nano, 0.2)
    any_nano.nano.reset("external")
    frames = any_nano.run(0.5)
    assert not select(frames, "RC")
