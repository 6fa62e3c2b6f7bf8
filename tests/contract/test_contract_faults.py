"""The public byte hook as fault injection: what is damaged is counted, never believed."""

from __future__ import annotations

import random

import pytest

from dart_hal.car import Car, Fleet
from dart_hal.core.errors import LinkLost
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE
from dart_lab.sim.truth import world_of

URL = "sim://?nano=mock&seed=2"
STREAM_SECONDS = 8.0


def flip(data: bytearray, rng: random.Random) -> bytes:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def truncate(data: bytearray, rng: random.Random) -> bytes:
    return bytes(data[:rng.randrange(len(data))])


def duplicate(data: bytearray, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return bytes(data[:at + 1] + data[at:])


def shift(data: bytearray, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return bytes(data[:at] + data[at + 1:])


def noise(data: bytearray, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return bytes(data[:at]) + rng.randbytes(rng.randrange(1, 30)) + bytes(data[at:])


def swallow(data: bytearray, rng: random.Random) -> bytes:
    return b""


STREAM_FAULTS = (flip, truncate, duplicate, shift, noise, swallow)


class Clean:
    """What the Nano really sent: every frame, by its unwrapped number."""

    def __init__(self, seq: int) -> None:
        self.seq, self.frames, self._decoder = seq, {}, FrameDecoder(UP)

    def feed(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            self.seq += (frame.seq - self.seq) & 0xFF
            self.frames[self.seq] = frame.as_dict() if frame.message is STATE else None


def heard(tmp_path, spoil=None):
    """States of a car whose wheels turn, what was sent, and how many frames were spoilt."""
    backend = open_backend(URL)
    rng = random.Random(5)
    with Car.over(backend, cars=tmp_path) as car:
        nano = world_of(backend).nano
        nano.set_wheel(2.0)
        nano.set_wheel = lambda rate: None          # turned by hand
        for first in car.states(duration=1.0):
            pass
        clean = Clean(first.seq)
        touched = 0

        def hook(direction, data, t):
            nonlocal touched
            if direction == "rx":
                clean.feed(data)
                if spoil is not None and rng.random() < 0.1:
                    touched += 1
                    return spoil(bytearray(data), rng)
            return data

        car.on_bytes(hook)
        states = list(car.states(duration=STREAM_SECONDS))
        return states, clean, car.timing, touched


@pytest.fixture(scope="module")
def undamaged_stream(tmp_path_factory):
    return heard(tmp_path_factory.mktemp("clean"))


def test_without_a_fault_nothing_is_lost(undamaged_stream):
    states, _, timing, touched = undamaged_stream
    assert len(states) in (799, 800)
    assert (timing.lost, timing.damaged, touched) == (0, 0, 0)
    assert states[-1].pose.x > 0.3


@pytest.mark.parametrize("spoil", STREAM_FAULTS, ids=lambda f: f.__name__)
@pytest.mark.slow_except("flip")
def test_damage_is_counted_and_never_a_wrong_number(tmp_path, undamaged_stream, spoil):
    states, clean, timing, touched = heard(tmp_path, spoil)
    got = {s.seq: s for s in states}
    missing = 0
    for seq, sent in clean.frames.items():
        if sent is None or seq > states[-1].seq:
            continue
        state = got.pop(seq, None)
        missing += state is None
        if state is not None:
            assert state.ticks & 0xFFFF == sent["enc_count"] & 0xFFFF
            assert state.accel_x == pytest.approx(sent["lin_acc"][0] * 0.01)
    assert not got, "States that were never sent"
    assert touched > 50
    assert 30 < missing <= timing.lost <= 2 * touched    # a torn frame spoils the next one
    assert states[-1].health.lost == timing.lost
    turned = states[-1].pose.x - states[0].pose.x
    whole = undamaged_stream[0][-1].pose.x - undamaged_stream[0][0].pose.x
    assert turned == pytest.approx(whole, rel=0.02)


@pytest.mark.slow
def test_commands_that_are_damaged_on_the_way_down_do_no_harm(tmp_path):
    with Car.open("sim://?nano=mock&cutoff=oe", cars=tmp_path) as car:
        rng = random.Random(3)

        def hook(direction, data, t):
            if direction == "tx" and rng.random() < 0.05:
                return rng.choice(STREAM_FAULTS)(bytearray(data), rng)
            return data

        car.on_bytes(hook)
        car.arm()
        for state in car.states(duration=2.0):
            car.drive_speed(steering=0.0, speed=0.5)
        assert car.mode == "ARMED"
        assert state.speed > 0.2


def test_a_hook_sees_both_directions(tmp_path):
    with Car.open(URL, cars=tmp_path) as car:
        chunks = []
        car.on_bytes(lambda direction, data, t: chunks.append((direction, t)) or data)
        for _ in car.states(duration=0.5):
            pass
        assert {d for d, _ in chunks} == {"rx", "tx"}
        times = [t for d, t in chunks if d == "rx"]
        assert times == sorted(times)


def test_silence_ends_in_link_lost_and_neutral(tmp_path):
    backend = open_backend(URL)
    with Car.over(backend, cars=tmp_path) as car:
        car.arm()
        deaf_from = [float("inf")]
        car.on_bytes(lambda d, data, t: data if d == "tx" or t < deaf_from[0] else b"")
        for state in car.states(duration=0.5):
            car.drive(throttle=0.3, valid_for=0.5)
        assert state.applied.throttle > 0.1
        deaf_from[0] = state.t
        car.drive(throttle=0.3, valid_for=0.5)
        pulses = []
        world_of(backend).watchers.append(lambda ch, p: pulses.append((ch, p)))
        with pytest.raises(LinkLost, match="no frame"):
            next(car.states(timeout=0.5))
        esc = [(rise, fall - rise) for channel, (rise, fall) in pulses if channel == 1]
        late = [width for rise, width in esc if rise > state.t + 0.15]
        assert late
        assert max(late) < 1505e-6, "neutral 100 ms and a PWM frame after the last one"
        assert car.mode == "TRIPPED"


@pytest.mark.usefixtures("armed_esc")
def test_a_fleet_goes_in_lockstep(tmp_path):
    urls = [f"sim://?nano=mock&seed={n}" for n in (1, 2, 3)]
    with Fleet.open(urls) as fleet:
        fleet.arm()
        ticks = 0
        begin = None
        for states in fleet.states(duration=1.5):
            ticks += 1
            begin = begin or [s.t for s in states]
            passed = [s.t - t for s, t in zip(states, begin, strict=True)]
            assert max(passed) - min(passed) < 0.0151
            for n, car in enumerate(fleet.cars):
                car.drive_speed(steering=0.1 * n, speed=0.5)
        assert abs(ticks - 150) <= 2
        assert all(s.speed > 0.1 for s in states)
        assert {car.mode for car in fleet.cars} == {"ARMED"}
    assert {car.mode for car in fleet.cars} == {"CLOSED"}


def test_a_fleet_opens_whole_or_not_at_all(tmp_path):
    before = len(_open_files())
    with pytest.raises(ValueError, match="no backend"):
        Fleet.open(["sim://?nano=mock", "nope://"])
    assert len(_open_files()) <= before + 1


def _open_files():
    import os

    return os.listdir("/proc/self/fd")
