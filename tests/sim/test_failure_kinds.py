"""Each kind of failure as a host sees it while it lasts, and that its end heals."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import BEAT_REQUESTS, HEARTBEAT, STATE_FLAGS
from dart_lab.sim.failure_kinds import FAILURE_KINDS
from dart_lab.sim.failures import parse_failure

START, LASTS = 3.0, 0.6
"""s; the car turns and still gains speed."""


def flags(state):
    return {n for k, n in enumerate(STATE_FLAGS) if int(state["flags"]) & 1 << k}


class FailureRecord:
    """States of a turning car while a failure lasts, and when it is over."""

    def __init__(self, car):
        self.car, timed = car, []
        car.arm().pulses(1500 + 375 * 0.4, 1500 + 450 * 0.3)
        now = car.backend.clock.now
        car.run(3.0, lambda f: timed.append((now(), f.as_si()))
                if f.message.name == "STATE" else None)
        self.times = [t for t, _ in timed]
        self.during = [s for t, s in timed if START + 0.05 < t < START + LASTS]
        self.after = [s for t, s in timed if t > START + LASTS + 0.9]

    def gyro(self, part):
        return [s["gyro"][2] for s in part]

    def counts(self, part):
        counts = [int(s["enc_count"]) for s in part]
        return [(b - a) & 0xFFFF for a, b in pairwise(counts)]


def rate(record, part):
    """Edges per second."""
    steps = record.counts(part)
    return 100 * sum(steps) / len(steps)


def invalid(record, part):
    return sum("IMU_VALID" not in flags(s) for s in part) / len(part)


def equal(values):
    return sum(a == b for a, b in pairwise(values)) / len(values)


def turn(record):
    """Yaw rate by the truth at the end of the failure [rad/s]."""
    return record.car.world.truth(START + LASTS).yaw_rate


SYMPTOMS = {
    "imu:off": lambda s, p: invalid(s, p) > 0.9,
    "imu:stuck": lambda s, p: equal(s.gyro(p)) > 0.9,
    "imu:garbage": lambda s, p: max(map(abs, s.gyro(p))) > 10.0,
    "imu:zero": lambda s, p: invalid(s, p) > 0.9,
    "imu:wrong=3": lambda s, p: s.gyro(p)[-1] > 2.5 * turn(s),
    "imu:slow=5": lambda s, p: equal(s.gyro(p)) > 0.85,
    "imu:intermittent=0.5": lambda s, p: 0.02 < equal([s["imu_age"] < 0.012 for s in p]) < 0.9,
    "imu:reset": lambda s, p: invalid(s, p) > 0.9,
    "enc:off": lambda s, p: rate(s, p) == 0.0,
    "enc:stuck": lambda s, p: rate(s, p) == 0.0,
    "enc:wrong=0.5": lambda s, p: rate(s, p) < 0.7 * rate(s, s.after),
    "enc:garbage=900": lambda s, p: rate(s, p) > 800.0,
    "enc:intermittent=0.5": lambda s, p: 0.1 < s.counts(p).count(0) / len(p) < 0.9,
    "line:garbage=0.02": lambda s, p: len(p) < 30,
    "line:wrong=0.2": lambda s, p: len(p) < 30,
    "line:intermittent=0.5": lambda s, p: 10 < len(p) < 45,
    "line:delayed=0.3": lambda s, p: 20 < len(p) < 40,
    "i2c:off": lambda s, p: invalid(s, p) > 0.9,
    "power:nano": lambda s, p: not p,
    "power:droop=2.5": lambda s, p: not p,
}
IN_THE_BRIDGE = {f"imu:{k}" for k in ("off", "stuck", "garbage", "wrong", "intermittent", "reset")
                 } | {"enc:off", "enc:garbage", "i2c:off", "power:nano", "power:droop"}
"""What another code does with the firmware; the rest acts outside the Nano."""


def drive(raw_car, nano, failure):
    text = f"{failure}@{START}+{LASTS}"
    car = raw_car(f"sim://?nano={nano}" + (f"&fail={text}" if failure else ""))
    return FailureRecord(car)


@pytest.mark.parametrize(("nano", "failure"), [
    pytest.param(nano, failure, marks=pytest.mark.emulator if nano == "avr" else ())
    for nano in ("mock", "avr") for failure in SYMPTOMS
    if nano == "mock" or failure.split("=")[0] in IN_THE_BRIDGE])
@pytest.mark.slow
def test_symptom_and_healing(raw_car, nano, failure):
    record, symptom = drive(raw_car, nano, failure), SYMPTOMS[failure]
    assert symptom(record, record.during)
    assert len(record.after) > 30
    assert not symptom(record, record.after)


@pytest.mark.slow
@pytest.mark.parametrize("nano", ["mock", pytest.param("avr", marks=pytest.mark.emulator)])
def test_no_symptom_without_a_failure(raw_car, nano):
    """The control of all of them."""
    record = drive(raw_car, nano, "")
    assert [f for f, symptom in SYMPTOMS.items() if symptom(record, record.during)] == []


@pytest.mark.slow
@pytest.mark.emulator
@pytest.mark.parametrize("failure", ["mcu:hang", "mcu:freeze"])
def test_a_program_at_rest_sends_nothing(raw_car, failure):
    times = [t for t in drive(raw_car, "avr", failure).times if t > START - 0.1]
    assert max(b - a for a, b in zip(times, [*times[1:], START + LASTS], strict=True)) > 0.06


@pytest.mark.emulator
@pytest.mark.parametrize(("name", "ring"), [("enc", 0), ("enc2", 1)])
def test_chatter_is_electrical(raw_car, name, ring):
    """What the firmware makes of it is the firmware's; the edges are at the pin."""
    car = raw_car(f"sim://?nano=avr&fail={name}:chatter=500000@0.1+0.1").run(0.25)
    assert car.world.nano.edges(ring) == pytest.approx(50_000, abs=600)


@pytest.mark.slow
@pytest.mark.emulator
def test_after_a_silent_config_the_firmware_sets_the_imu_up_again(raw_car):
    car = raw_car("sim://?nano=avr&fail=imu:config@1").run(0.99)
    modes = []
    for _ in range(130):
        modes.append(car.world.nano.imu_register(0x3D))
        car.run(0.01)
    assert modes[0] == modes[-1] != 0
    assert 0 in modes


@pytest.mark.slow
@pytest.mark.emulator
@pytest.mark.parametrize("nth", [1, 5, 9])
def test_a_torn_eeprom_byte_leaves_the_parameters_at_old_or_new(raw_car, nth):
    """The store keeps two slots: a reset in the middle of a write loses the new one, no more."""
    from dart_hal.wire.messages import PARAM_BY_NAME, PARAM_GET, PARAM_SET

    car = raw_car(f"sim://?nano=avr&cutoff=mux&fail=eeprom:torn={nth}@0.8").run(1.0)
    ident = PARAM_BY_NAME["edge_min_us"].id
    car.backend.link.write(encode(PARAM_SET, 0, (ident, 0, 77)))
    car.run(1.5)
    assert car.frames_named("HELLO")[-1].as_dict()["boot_count"] >= 1
    assert len({f.as_dict()["boot_nonce"]
                for f in car.frames_named("HELLO")}) == 2  # the brown-out came
    car.backend.link.write(encode(PARAM_GET, 1, (PARAM_BY_NAME["safety_out"].id,)))
    car.run(0.3)
    assert car.frames_named("PARAM_VALUE")[-1].as_dict()["value"] == 2  # others are whole


@pytest.mark.slow_except("mock")
@pytest.mark.parametrize("nano", ["mock", pytest.param("avr", marks=pytest.mark.emulator)])
def test_the_rc_signal_ends_and_returns(raw_car, nano):
    car = raw_car(f"sim://?nano={nano}&rc=1&fail=rc:off@0.5+0.4")
    pulses = {}
    for beat in range(12):
        car.backend.link.write(encode(HEARTBEAT, beat, (0, 0, 0, 0, 0, BEAT_REQUESTS["RC"])))
        car.run(0.1)
        if car.frames_named("RC"):
            pulses[beat] = car.frames_named("RC")[-1].as_dict()["pulse"]
    rest = pytest.approx((3000, 3000, 0), abs=4)
    assert pulses[4] == pulses[11] == rest
    assert pulses[7] == pulses[8] == (0, 0, 0)


def test_a_car_without_a_receiver_has_no_signal_to_lose(raw_car):
    with pytest.raises(UsageError, match="no RC receiver"):
        raw_car("sim://?nano=mock&fail=rc:off@0.1").run(0.2)


def test_every_target_names_what_it_has():
    with pytest.raises(UsageError) as caught:
        parse_failure("enc:delayed@3")
    assert "enc:wrong=SHARE" in caught.value.expected
    assert len(FAILURE_KINDS) > 40


@pytest.mark.parametrize("text", ["imu:stuck=3@1", "enc:wrong=1.5@1", "power:droop=9@1",
                                  "enc:garbage=1e9@1", "eeprom:torn=0@1", "imu:slow=0@1"])
def test_a_value_out_of_range_is_refused(text):
    with pytest.raises(UsageError):
        parse_failure(text)


@pytest.mark.parametrize("text", ["enc:chatter@0.1", "imu:config@0.1", "eeprom:torn@0.1",
                                  "mcu:freeze@0.1"])
def test_what_needs_the_firmware_is_refused_by_the_mock(raw_car, text):
    car = raw_car(f"sim://?nano=mock&fail={text}")
    with pytest.raises(UsageError):
        car.run(0.3)


@pytest.mark.slow_except("line:garbage=0.05")
@pytest.mark.parametrize("kind", ["line:wrong=0.5", "line:garbage=0.05", "line:delayed=0.3",
                                  "line:intermittent=0.9"])
def test_two_that_overlap_leave_the_line_as_it_was(raw_car, kind):
    car = raw_car(f"sim://?nano=mock&ber=1e-7&fail={kind}@1+0.5,{kind}@1.3+0.5")
    before = [line.faults for line in car.world.lines]
    car.run(1.4)
    assert [line.faults for line in car.world.lines] != before
    car.run(0.5)
    assert [line.faults for line in car.world.lines] == before
