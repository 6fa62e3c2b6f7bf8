"""Hold pulses on a car whose wheels are off the ground, and record the edges of the ring.

As in ``runner``, each STATE frame is answered by one pulse. But the pulse is constant and no speed
is controlled, because the ESC is what is measured.
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

from .by_hand import diagnose_no_edges
from .runner import no_imu_error
from .sensor_log import SensorLog

# s without an edge after which turning wheels count as stopped.
MAX_EDGE_GAP = 0.3
# s of neutral for the offset of the accelerometer.
OFFSET_DURATION = 0.3
# us from neutral at which every ESC has begun to drive.
MAX_FIRST_MOTION = 200.0
# s of each count until there: three PWM frames.
COUNT_DURATION = 0.055
# Edges that show the first motion.
MIN_MOTION_EDGES = 6
# m/s by which the wheels change their speed before the accelerometer is compared with it.
MIN_SPEED_CHANGE_TO_CHECK = 0.3
# Share of that change which the accelerometer may measure: 0 with lifted wheels, 1 on the floor.
MAX_INERTIAL_SHARE = 0.5


class NoEdges(Exception):
    """The wheels should turn but no edge is counted; the text states since when."""


@dataclass(frozen=True, slots=True)
class PulseSpan:
    """Edges of the ring, every second one, during one constant pulse ``pulse_us`` (0.0: none).

    t [s] of the car's clock since the State before the first one with the pulse at the pins;
    ``ended`` [s] as t. x [m]: unsigned distance at the tread, see ``edge_distances``.
    """

    pulse_us: float
    t: FloatArray
    x: FloatArray
    ended: float

    def without_start(self, seconds: float) -> PulseSpan:
        """Return the span without its first ``seconds``."""
        use = self.t >= seconds
        return PulseSpan(self.pulse_us, self.t[use], self.x[use], self.ended)

    def speed(self, seconds: float) -> float:
        """Mean speed [m/s] of the last ``seconds``; 0 with fewer than two edges."""
        last = self.without_start(self.ended - seconds)
        if len(last.t) < 2:
            return 0.0
        return float((last.x[-1] - last.x[0]) / (last.t[-1] - last.t[0]))


class Spinner:
    """Hold pulses for given times of the car's clock; use inside ``car.raw(lifted=True)``."""

    def __init__(self, car: Car, log: SensorLog) -> None:
        files = car.files
        self._car = car
        self._log = log
        self.count = counter_of(files)[1]
        """us; pulses of whole counts are made without error."""
        self._metres = files.metres_per_edge.value
        self._center = files.config.steering.center_us
        self._frames = iter(car.states())
        self.neutral = self.round_to_count(files.neutral_us)
        self._offset = 0.0
        still = self._run(OFFSET_DURATION, self.neutral, False)
        accel = [s.accel_x for _, s in still if s.accel_x is not None]
        self._offset = float(np.mean(accel)) if accel else 0.0

    def round_to_count(self, pulse_us: float) -> float:
        """Return the nearest pulse of whole counts [us]."""
        return round(pulse_us / self.count) * self.count

    def hold(self, seconds: float, pulse_us: float | None, *, turns: bool = False) -> PulseSpan:
        """Hold a pulse (None: no pulse); ``turns``: the wheels have to turn.

        Raises NoEdges if they do not, CalibrationFailed if the car is on the floor, and errors of
        the Car.
        """
        return self._make_span(pulse_us or 0.0, self._run(seconds, pulse_us, turns))

    def first_motion(self, sign: float) -> float:
        """Move away from neutral, count by count; return the pulse [us] with the first edges.

        Raises NoEdges at a pulse with which every ESC drives, and as ``hold``.
        """
        edges = 0
        for counts in range(2, round(MAX_FIRST_MOTION / self.count)):
            pulse = self.neutral + sign * counts * self.count
            frames = self._run(COUNT_DURATION, pulse, False)
            edges += frames[-1][0].ticks - frames[0][0].ticks
            if edges >= MIN_MOTION_EDGES:
                return pulse
        raise NoEdges(f"{edges} edges up to {MAX_FIRST_MOTION:.0f} us from neutral")

    def _run(self, seconds: float, pulse_us: float | None, turns: bool
             ) -> list[tuple[Sample, State]]:
        """Send a pulse with every frame and check edges and acceleration."""
        start: float | None = None
        first: State | None = None
        edge = -1
        edge_t = 0.0
        inertial = 0.0
        self._log.pairs()
        for state in self._frames:
            first = first or state
            start = state.t if start is None else start
            if state.ticks != edge:
                edge = state.ticks
                edge_t = state.t
            if turns and state.t - edge_t > MAX_EDGE_GAP:
                raise NoEdges(f"no edge for {MAX_EDGE_GAP} s at {pulse_us or 0.0:.0f} us")
            # Change of speed by the accelerometer [m/s], at 100 frames per second.
            inertial += 0.01 * ((state.accel_x or 0.0) - self._offset)
            change = abs(state.speed - first.speed)
            if (change > MIN_SPEED_CHANGE_TO_CHECK
                    and abs(inertial) > MAX_INERTIAL_SHARE * change):
                raise _not_lifted(f"the car accelerated by {abs(inertial):.1f} m/s with its wheels")
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
                raise no_imu_error("its samples are not valid, so nothing shows that the car is at "
                                   "rest") from error
            raise _not_lifted("the IMU measures motion") from error

    def _make_span(self, pulse_us: float, pairs: Sequence[tuple[Sample, State]]) -> PulseSpan:
        # The pulse counts from the first State that had it at the pins.
        at_pins = (k for k, (_, s) in enumerate(pairs)
                   if abs(s.applied.throttle_us - pulse_us) < 0.5 * self.count)
        pairs = pairs[max(next(at_pins, 0) - 1, 0):]
        t, x = edge_distances(pairs, self._metres)
        return PulseSpan(pulse_us, t, x, pairs[-1][1].t - pairs[0][1].t)


def edge_distances(pairs: Sequence[tuple[Sample, State]], metres_per_edge: float
                   ) -> tuple[FloatArray, FloatArray]:
    """(t [s] of the car's clock since the first pair, distance [m]) of every second edge.

    Of two edges one is the rise of a mark and one its fall. Counted in pairs, the width of the
    marks cancels. The resonator of the Nano is off by up to 0.5 %, an acceleration by twice that:
    its times are stretched to those of the States.
    """
    if not pairs:
        return np.zeros(0), np.zeros(0)
    first, begin = pairs[0]
    newest, end = pairs[-1]
    ticked = newest.t_dev - first.t_dev
    rate = (end.t - begin.t) / ticked if ticked > 0.0 else 1.0
    t = []
    x = []
    last = first.ticks
    for sample, _ in pairs:
        ticks = sample.ticks
        edge_t = sample.edge_t
        if ticks % 2:
            ticks -= 1
            edge_t = edge_t - sample.edge_dt if sample.edge_dt else -np.inf
        if ticks > last and edge_t > first.t_dev:
            t.append(rate * (edge_t - first.t_dev))
            x.append((ticks - first.ticks) * metres_per_edge)
            last = ticks
    return np.array(t), np.array(x)


@contextmanager
def spinning(car: Car, workshop: Workshop, log: SensorLog) -> Iterator[Spinner]:
    """Run the block with raw pulses; stop the car at its end, also on Ctrl-C.

    Raises CalibrationFailed with the cause of missing edges, and errors of the Car.
    """
    try:
        with car.raw(lifted=True):
            yield Spinner(car, log)
    except NoEdges as error:
        raise diagnose_no_edges(car, workshop, str(error)) from error
    finally:
        car.stop()


def _not_lifted(found: str) -> CalibrationFailed:
    return CalibrationFailed("the wheels are not off the ground", found=found,
                             expected="a car at rest on a stand",
                             likely="it was not lifted, or it has slipped off its stand",
                             remedy="lift the chassis so that no wheel touches anything, then run "
                                    "it again")
