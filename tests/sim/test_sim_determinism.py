"""The same seed gives the same bytes, however the reader cuts its time."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.native.library import NATIVE_SWITCH
from dart_hal.vehicle.parameters import SLIP_FORMS
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HEARTBEAT, TIME_PING
from dart_lab.sim.motion import DynamicMotion

URL = "sim://?nano=mock&seed=7"


def scenario(raw_car, url, slice_s, seconds=6.0):
    """Drives by what it sees: commands and beats are answers to frames."""
    car = raw_car(url, slice_s)
    count = [0]

    def react(frame):
        if frame.message.name != "STATE":
            return
        count[0] += 1
        n = count[0]
        gyro = frame.as_si()["gyro"][2]
        car.backend.link.write(encode(HEARTBEAT, n, (1, 15000, 15000, 2, 0, 0)))
        if n % 25 == 0:
            car.backend.link.write(encode(TIME_PING, n, (n, 7)))
        if n % 2 == 0:
            throttle = 0 if n < 220 else 100 + 60 * (n % 200 > 100)
            car.pulses(1500 + 200 * (n % 300 > 150) - 20 * gyro, 1500 + throttle)

    car.run(seconds, react)
    chunks = repr(car.stamps).encode()
    return (hashlib.sha256(bytes(car.raw)).hexdigest(), hashlib.sha256(chunks).hexdigest(),
            car.truth)


FAILING = ("&boot=optiboot&fail=enc:garbage=500@1.5%2B1,imu:intermittent=0.3@2%2B1,"
           "line:intermittent=0.3@3%2B0.4,line:delayed=0.02@4%2B0.3,power:droop=2.5@4.5%2B0.3")


@pytest.mark.parametrize("extra", ["", "&jitter=usb", "&jitter=busy&ber=1e-4", FAILING])
@pytest.mark.slow
def test_read_slices_do_not_matter(raw_car, extra):
    first, *others = (scenario(raw_car, URL + extra, s) for s in (1e-2, 1e-3, 1e-4))
    assert all(o == first for o in others)


@pytest.mark.slow
@pytest.mark.emulator
def test_read_slices_do_not_matter_to_the_firmware(raw_car):
    url = "sim://?nano=avr&seed=7"
    first, *others = (scenario(raw_car, url, s, 3.5) for s in (1e-2, 1e-3, 1e-4))
    assert all(o == first for o in others)


@pytest.mark.emulator
@pytest.mark.slow
def test_read_slices_do_not_matter_while_things_fail(raw_car):
    url = f"sim://?nano=avr&seed=7{FAILING},enc:chatter=20000@0.5%2B0.3,imu:delayed=0.1@2%2B1"
    first, other = (scenario(raw_car, url, s, 5.0) for s in (1e-2, 7e-4))
    assert other == first


@pytest.mark.parametrize("effect", ["", "&effect=load_transfer:0.02"])
def test_compiled_and_python_motion_give_the_same_bytes(raw_car, monkeypatch, effect):
    compiled = scenario(raw_car, URL + effect, 0.01, 3.0)
    monkeypatch.setenv(NATIVE_SWITCH, "0")
    assert scenario(raw_car, URL + effect, 0.01, 3.0) == compiled


@pytest.mark.parametrize("slip", SLIP_FORMS)
def test_compiled_and_python_motion_of_a_kinematic_vehicle_are_the_same(monkeypatch, slip):
    vehicle = replace(PAPER, kind="kinematic", slip=slip)
    steps = []
    for switch in ("1", "0"):
        monkeypatch.setenv(NATIVE_SWITCH, switch)
        motion = DynamicMotion(vehicle, 1e-3)
        motion.v_x = 0.8
        steps.append([motion.step(0.3, 0.0, 0.2) for _ in range(50)])
    assert steps[0] == steps[1]


@pytest.mark.slow
def test_twice_the_same_and_another_seed_not(raw_car):
    assert scenario(raw_car, URL, 0.01) == scenario(raw_car, URL, 0.01)
    assert scenario(raw_car, URL, 0.01)[0] != scenario(raw_car, "sim://?nano=mock&seed=8", 0.01)[0]


def test_bytes_of_the_future_are_held_back(raw_car):
    car = raw_car(URL)
    link = car.backend.link
    for _ in range(2000):
        chunk = link.read(0.37e-3)
        assert chunk is None or chunk.t <= link.now
        assert car.world.t <= link.now + 1e-3


def test_a_command_acts_from_the_frame_it_answers(raw_car):
    """The STOP of a write follows the frame's last stop bit by its wire time."""
    car = raw_car("sim://?nano=mock")
    times = []

    def react(frame):
        if frame.message.name != "STATE":
            return
        car.pulses(1500, 1500)
        times.append((car.backend.clock.now(), car.backend.bus.log[-1]))

    car.run(0.5, react)
    assert all(log.t_start == now for now, log in times)


@pytest.mark.slow
def test_the_world_is_where_the_host_is_when_a_late_frame_comes(raw_car):
    """Else a bus write that answers it would act before the frame arrived."""
    car = raw_car("sim://?nano=mock&jitter=busy")
    link = car.backend.link
    for _ in range(500):
        if link.read(0.05) is not None:
            assert car.world.t >= link.now


def test_sleep_leaves_the_frames_to_be_read(raw_car):
    car = raw_car("sim://?nano=mock")
    car.backend.clock.sleep(1.0)
    assert car.backend.clock.now() == pytest.approx(1.0)
    frames = 0
    while (chunk := car.backend.link.read(0.0)) is not None:
        assert chunk.t <= 1.0
        frames += 1
    assert frames >= 99
    assert car.backend.clock.now() == pytest.approx(1.0)


@pytest.mark.slow
def test_usb_jitter_delays_and_keeps_the_order(raw_car):
    plain, late = raw_car("sim://?nano=mock").run(5.0), raw_car("sim://?nano=mock&jitter=usb")
    late.run(5.0)
    assert late.stamps == sorted(late.stamps)
    delays = [b - a for a, b in zip(plain.stamps, late.stamps, strict=False)]
    assert min(delays) >= 0.0
    assert max(delays) > 1.5e-3
    assert sum(d < 1e-3 for d in delays) > 0.8 * len(delays)
