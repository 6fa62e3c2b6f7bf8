"""Host time of a sample against the emulator's own cycles, behind a line with jitter."""

from __future__ import annotations

from bench_estimation import simulation
from figures import Figure

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import TICKS_PER_SECOND, TIME_PING, TIME_PONG
from dart_lab.sim.hidden import hidden_car

SEED = 7
URL = f"sim://?seed={SEED}&nano=avr"
BYTE = 10 / 500_000
AFTER = 20.0
"""s from opening to the first sample that counts."""


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; ``scale`` shortens the time after the 20 s, below 0.1 also these."""
    zero, ready = tick_zero(), AFTER if scale >= 0.1 else 3.0
    rows = []
    for jitter, share in (("usb", 2), ("busy", 30)):
        errors, arrivals = errors_of(jitter, zero, ready, 20.0 * scale)
        rows.append(Figure(f"host time error, jitter={jitter}, p99", 1e3 * p99(errors), "ms",
                           high=0.5, note=f"{share} % of frames disturbed; arrival stamps "
                                          f"{1e3 * p99(arrivals):.3g} ms"))
    sim = simulation()
    for disturbed in (0.05, 0.3):
        runs = [sim.simulate_clock(disturbed, seed, duration=60.0)
                for seed in range(max(1, round(5 * scale)))]
        rows.append(Figure(f"clock fit alone, {disturbed:.0%} disturbed, p99",
                           1e3 * max(sim.p99(run.late) for run in runs), "ms", high=0.5,
                           note=f"worst of {len(runs)} simulated, tails of 12 ms"))
    return rows


def tick_zero() -> float:
    """World time [s] at which the Nano's clock read 0: from the line without jitter.

    TIME_PONG carries the clock at the start of its own first byte.
    """
    backend = open_backend(URL)
    try:
        decoder, scale = FrameDecoder(UP), 1.0 + hidden_car(SEED).clock_error
        backend.clock.sleep(1.0)
        backend.link.write(encode(TIME_PING, 0, (1, 0)))
        while True:
            chunk = backend.link.read(1.0)
            assert chunk is not None
            for frame in decoder.feed(chunk.data):
                if frame.message is TIME_PONG:
                    start = chunk.t - TIME_PONG.wire_size * BYTE / scale
                    return start - frame.as_dict()["tx_ck"] / TICKS_PER_SECOND / scale
    finally:
        backend.close()


def errors_of(jitter: str, zero: float, ready: float,
              seconds: float) -> tuple[list[float], list[float]]:
    """Errors [s] of State.t, and of the frames' arrivals taken for it."""
    scale = 1.0 + hidden_car(SEED).clock_error
    errors, arrivals = [], []
    with Car.open(f"{URL}&jitter={jitter}") as car:
        engine = car._engine
        for state in car.states(duration=ready + seconds):
            if engine.now < ready:
                continue
            true = zero + engine.telemetry.last_dev / scale
            errors.append(state.t - true)
            arrivals.append(engine.now - true)
    return errors, arrivals


def p99(values: list[float]) -> float:
    """99th percentile of the magnitudes."""
    return sorted(map(abs, values))[int(0.99 * len(values))]
