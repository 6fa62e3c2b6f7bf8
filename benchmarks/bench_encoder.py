"""Encoder through the real firmware: counts, speed, and a minute of frames."""

from __future__ import annotations

import math

from bare_nano import BOOTED, BareNano
from figures import Figure

from dart_hal.car import Car
from dart_hal.estimation import ClockFit, FrameReader, WheelSpeed
from dart_hal.wire.frame import WireFrame
from dart_hal.wire.messages import STATE
from dart_lab.sim.ring import GEAR_REVOLUTION

EDGES = 20
SPEEDS = (0.3, 1.0, 3.0, 5.0, 0.0, -5.0)
"""m/s; the counts go on upwards when the ring turns back. Not without a stop: a gear
that reverses at once passes the same mark twice within the 100 us of the glitch rule."""
RATES = (5e3, 10e3, 20e3, 40e3)
"""Edges/s and ring."""
CLOCK_ERROR = 0.003
"""Of the resonator, to be found by the clock fit."""
SETTLING_S = 5.0
"""s until the clock's rate is known to 10 ppm."""


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; ``scale`` shortens the stretches of virtual time."""
    rows = [_exact("edges missed, rest to 5 m/s and back", {}, (EDGES, 0), 2.0 * scale,
                   [v * EDGES / GEAR_REVOLUTION for v in SPEEDS]),
            _exact("edges missed, both rings to 40 k/s", {"edge_min_us": 0, "ring_b": 1},
                   (EDGES, EDGES), 0.5 * scale, list(RATES))]
    rows += [speed_error(v, 10.0 * scale) for v in (0.3, 1.0, 3.0)]
    return rows + stream(60.0 * scale)


def count(rates: list[float], seconds: float, edges: tuple[int, int],
          params: dict[str, int]) -> tuple[list[int], list[int]]:
    """(edges on the pins, edges counted) per ring, each rate [edges/s] for ``seconds``."""
    with BareNano(edges, params) as bare:
        nano = bare.nano
        first = _last_state(bare.run(BOOTED))
        before = [nano.edges(ring) for ring in (0, 1)]
        for rate in rates:
            nano.set_wheel(rate / edges[0])
            bare.run(seconds)
        nano.set_wheel(0.0)
        last = _last_state(bare.run(0.05))
        given = [nano.edges(ring) - before[ring] for ring in (0, 1)]
    counted = [(last["enc_count"] - first["enc_count"]) % (1 << 32),
               (last["enc2_count"] - first["enc2_count"]) & 0xFFFF]
    counted[1] += (given[1] - counted[1] + 0x8000) // 0x10000 * 0x10000
    return given, counted


def _last_state(frames: list[tuple[WireFrame, float]]) -> dict[str, int]:
    return next(f for f, _ in reversed(frames) if f.message is STATE).as_dict()


def _exact(name: str, params: dict[str, int], edges: tuple[int, int], seconds: float,
           rates: list[float]) -> Figure:
    given, counted = count(rates, seconds, edges, params)
    missed = sum(abs(g - c) for g, c in zip(given, counted, strict=True))
    fitted = [f"{g:,} on {pin}" for g, n, pin in zip(given, edges, ("D2", "D3"), strict=True) if n]
    rule = f"edge_min_us {params.get('edge_min_us', 100)}"
    return Figure(name, missed, "", 0, 0, f"{', '.join(fitted)}; {rule}")


def speed_error(speed: float, seconds: float) -> Figure:
    """Relative rms error of the speed at a constant one, clock fitted on the way."""
    frames, clock = FrameReader(), ClockFit()
    wheel = WheelSpeed(GEAR_REVOLUTION / EDGES, EDGES)
    errors = []
    with BareNano((EDGES, 0), clock_error=CLOCK_ERROR) as bare:
        bare.roll(speed)
        begin = BOOTED + SETTLING_S
        for frame, t in bare.run(begin + seconds):
            if frame.message is not STATE:
                continue
            s = frames.read(frame.values(), t)
            clock.add_frame(s.t_dev, t, STATE.wire_size * clock.byte_time)
            clock.to_host(s.t_dev)
            v, _ = wheel.update(s.ticks, s.edge_t, s.edge_dt, s.t_dev, clock.rate, 1)
            if t > begin:
                errors.append(v / speed - 1.0)
    rms = math.sqrt(sum(e * e for e in errors) / len(errors))
    return Figure(f"speed error at {speed:g} m/s, rms", 100 * rms, "%", high=0.1,
                  note=f"{len(errors)} frames, clock {100 * CLOCK_ERROR:g} % off")


def stream(seconds: float) -> list[Figure]:
    """Frames of a closed loop: how many, how even, none lost or damaged."""
    with Car.open("sim://?seed=7&nano=avr") as car:
        car.arm()
        before = car.timing
        states = []
        for state in car.states(duration=seconds):
            car.drive_speed(steering=0.2, speed=1.5)
            states.append(state.t)
        after = car.timing
    rate = (len(states) - 1) / (states[-1] - states[0])
    bad = after.lost - before.lost + after.damaged - before.damaged
    note = f"{len(states)} frames of STATE in {seconds:g} s, driving"
    return [Figure("STATE rate", rate, "Hz", 99.5, 100.5, "clock of the Nano: +-0.5 %"),
            Figure("frames lost or damaged", bad, "", 0, 0, note)]
