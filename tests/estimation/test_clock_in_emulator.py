"""Host time of the real firmware's frames, against the emulator's cycles."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.core.clock_fit import LATCH_DELAY
from dart_hal.core.errors import DartHalError
from dart_hal.recording.run import RunReader
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_lab.sim.hidden import hidden_car

pytestmark = pytest.mark.emulator

SEED = 4
BYTE = 10 / 500_000


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """(States, device latch times [s], least latch delay [s]) in world time.

    The Nano's tick 0 in world time comes from TIME_PONG, whose tx_ck is the
    start of its own first byte.
    """
    path = tmp_path_factory.mktemp("clock") / "run.mcap"
    try:
        with Car.open(f"sim://?seed={SEED}&nano=avr", record=path) as car:
            states = list(car.states(duration=8.0))
    except DartHalError as why:
        pytest.skip(f"no emulator: {why.what}")
    scale = 1.0 + hidden_car(SEED).clock_error
    decoder = FrameDecoder(UP)
    ticks = []
    zeros = []
    for chunk in RunReader(path).chunks():
        for frame in decoder.feed(chunk.data):
            start = chunk.t - frame.message.wire_size * BYTE / scale
            if frame.message.name == "STATE":
                ticks.append((frame.as_dict()["t_ck"] / 2e6 / scale, start))
            elif frame.message.name == "TIME_PONG":
                zeros.append(start - frame.as_dict()["tx_ck"] / 2e6 / scale)
    zero = sorted(zeros)[len(zeros) // 2]
    latched = [zero + t for t, _ in ticks]
    return states, latched, min(start - zero - t for t, start in ticks)


@pytest.mark.slow
def test_latch_delay_is_the_firmwares(run):
    assert run[2] == pytest.approx(LATCH_DELAY, abs=30e-6)


@pytest.mark.slow
def test_state_time_is_the_time_of_its_latch(run):
    states, latched, _ = run
    late = [s for s in states if s.t > states[0].t + 3.0]
    errors = [min(abs(s.t - t) for t in latched) for s in late]
    assert max(errors) < 50e-6
    assert max(abs(e) / s.health.t_std for e, s in zip(errors, late, strict=True)) < 5


@pytest.mark.slow
def test_stated_uncertainty_is_small_on_a_virtual_link(run):
    states, _, _ = run
    assert states[-1].health.t_std < 50e-6
