"""Holds pulses on a car whose wheels are off the ground, and takes down where the ring stands.

One frame in, one pulse out, as in ``runner``; but no speed is held: the ESC is what is asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from dart_hal.car import Car
from dart_hal.core.errors import BadCommand, CalibrationFailed
from dart_hal.core.ports import Workshop
from dart_hal.core.types import FloatArray, State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.estimation.frames import Sample

from .by_hand import name_silence
from .sensor_log import SensorLog

SILENCE = 0.3
"""s without an edge of wheels that have to turn."""
STANDS = 0.3
"""s of neutral from which the accelerometer's offset is taken."""
SEARCH, STEP, FIRST = 200.0, 0.055, 6
"""us from neutral at which every ESC has begun to pull, s of each count until there (three PWM
frames), and edges that show it."""
SPEEDS_UP, FELT = 0.3, 0.5
"""m/s by which the wheels change their speed until it is asked whether that was felt, and the
share of it that is: lifted wheels give nothing, on the floor it is all of it."""


class NoEdges(Exception):
    """The wheels should turn, and no edge comes; the text says since when."""


@dataclass(frozen=True, slots=True)
class Spin:
    """One pulse held: ``pulse_us`` (0.0: none); edges of the ring, every second one.

    t [s] of the Nano's clock, since ``began``, the State before the first whose pins carried the
    pulse; x [m] of the tread, unsigned, as ``places`` has them; ``ended`` [s] as t.
    """

    pulse_us: float
    t: FloatArray
    x: FloatArray
    began: float
    ended: float

    def after(self, seconds: float) -> Spin:
        """The same without its beginning."""
        kept = self.t >= seconds
        return Spin(self.pulse_us, self.t[kept], self.x[kept], self.began, self.ended)

    def speed(self, seconds: float) -> float:
        """Mean speed [m/s] of the last ``seconds``, 0 without two edges in them."""
        late = self.after(self.ended - seconds)
        if len(late.t) < 2:
            return 0.0
        return float((late.x[-1] - late.x[0]) / (late.t[-1] - late.t[0]))


class Spinner:
    """Holds pulses for stretches of car time; call inside ``car.raw(lifted=True)``."""

    def __init__(self, car: Car, log: SensorLog) -> None:
        files = car.files
        self._car, self._log = car, log
        self.count = counter_of(files)[1]
        """us; pulses of whole counts are made without error."""
        self._metres = files.metres_per_edge.value
        self._center = files.config.steering.center_us
        self._frames = iter(car.states())
        self.neutral = self.whole(files.neutral_us)
        self._offset = 0.0
        still = self._run(STANDS, self.neutral, False)
        felt = [s.accel_x for _, s in still if s.accel_x is not None]
        self._offset = float(np.mean(felt)) if felt else 0.0

    def whole(self, pulse_us: float) -> float:
        """The nearest pulse of whole counts [us]."""
        return round(pulse_us / self.count) * self.count

    def hold(self, seconds: float, pulse_us: float | None, *, turns: bool = False) -> Spin:
        """Keep a pulse, None = none; ``turns``: the wheels have to turn.

        Errors: NoEdges if they do not; CalibrationFailed if the car is on the floor, what the
        Car raises.
        """
        return self._spin(pulse_us or 0.0, self._run(seconds, pulse_us, turns))

    def first_motion(self, sign: float) -> float:
        """Go away from neutral, count by count, until the first edges come; that pulse [us].

        Errors: NoEdges where every ESC has begun to pull, else as ``hold``.
        """
        seen = 0
        for counts in range(2, round(SEARCH / self.count)):
            pulse = self.neutral + sign * counts * self.count
            ran = self._run(STEP, pulse, False)
            seen += ran[-1][0].ticks - ran[0][0].ticks
            if seen >= FIRST:
                return pulse
        raise NoEdges(f"{seen} edges up to {SEARCH:.0f} us from neutral")

    def _run(self, seconds: float, pulse_us: float | None, turns: bool
             ) -> list[tuple[Sample, State]]:
        start: float | None = None
        first: State | None = None
        edge, edge_t, felt = -1, 0.0, 0.0
        self._log.pairs()
        for state in self._frames:
            first = first or state
            start = state.t if start is None else start
            if state.ticks != edge:
                edge, edge_t = state.ticks, state.t
            if turns and state.t - edge_t > SILENCE:
                raise NoEdges(f"no edge for {SILENCE} s at {pulse_us or 0.0:.0f} us")
            felt += 0.01 * ((state.accel_x or 0.0) - self._offset)
            change = abs(state.speed - first.speed)
            if change > SPEEDS_UP and abs(felt) > FELT * change:
                raise _on_the_floor(f"the car sped up by {abs(felt):.1f} m/s with its wheels")
            self._send(pulse_us, state)
            if state.t - start >= seconds:
                break
        return self._log.pairs()

    def _send(self, pulse_us: float | None, state: State) -> None:
        try:
            self._car.pulses(steering_us=self._center, throttle_us=pulse_us)
        except BadCommand as error:
            if "CAR_MOVES" not in self._car.causes:
                raise
            if state.accel_x is None:
                raise CalibrationFailed(
                    "no data of the IMU", found="its samples are not valid",
                    expected="100 samples per second: they show that the car stays on its stand",
                    likely="IMU unplugged, or reset by a voltage drop", remedy="dart-hal doctor"
                ) from error
            raise _on_the_floor("the IMU moves") from error

    def _spin(self, pulse_us: float, pairs: Sequence[tuple[Sample, State]]) -> Spin:
        carried = (k for k, (_, s) in enumerate(pairs)
                   if abs(s.applied.throttle_us - pulse_us) < 0.5 * self.count)
        pairs = pairs[max(next(carried, 0) - 1, 0):]
        t, x = places([sample for sample, _ in pairs], self._metres)
        began = pairs[0][0].t_dev
        return Spin(pulse_us, t, x, began, pairs[-1][0].t_dev - began)


def places(samples: Sequence[Sample], metres_per_edge: float) -> tuple[FloatArray, FloatArray]:
    """(t [s] of the Nano's clock since the first sample, way [m]) of every second edge seen.

    Of two edges one is the rise of a mark and one its fall: counted in pairs, the width of the
    marks drops out.
    """
    first = samples[0]
    t, x, last = [], [], first.ticks
    for sample in samples:
        ticks, at = sample.ticks, sample.edge_t
        if ticks % 2:
            ticks, at = ticks - 1, at - sample.edge_dt if sample.edge_dt else -np.inf
        if ticks > last and at > first.t_dev:
            t.append(at - first.t_dev)
            x.append((ticks - first.ticks) * metres_per_edge)
            last = ticks
    return np.array(t), np.array(x)


@contextmanager
def spinning(car: Car, workshop: Workshop, log: SensorLog) -> Iterator[Spinner]:
    """Raw pulses for a while; the car is left stopped, also on Ctrl-C.

    Errors: CalibrationFailed that says why no edge came, and what the Car raises.
    """
    try:
        with car.raw(lifted=True):
            yield Spinner(car, log)
    except NoEdges as error:
        raise name_silence(car, workshop, str(error)) from error
    finally:
        car.stop()


def _on_the_floor(found: str) -> CalibrationFailed:
    return CalibrationFailed("the wheels are not off the ground", found=found,
                             expected="a car on a stand, that does not move",
                             likely="it was not lifted, or it has slipped off its stand",
                             remedy="put it on something that carries the chassis; nothing near "
                                    "the wheels")
