"""``calibrate encoder``: travel per edge from a taped distance, and spacing of the ring's edges.

The car rolls straight, from rest to rest, along a tape, and the operator enters the distance. Its
error comes from the tape (2 mm) and from the two gaps in which counting began and ended. A longer
roll is more accurate. Meanwhile the Nano sends every interval between edges, from which
``ring_table`` computes the ring.

The pulse is constant before the intervals count, because a speed that oscillates once a turn looks
like uneven marks. Two things would make it oscillate:

- a speed loop, because it responds to the uneven marks;
- dithering between counts of the PCA9685. At 0.4 m/s the ring turns once in five PWM frames, so the
  pattern of rounded pulses meets the same marks again and again.

A constant pulse of a whole number of counts avoids both. Oscillations of drive train and floor
depend on the speed, so the rolls have different speeds.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.quantity import Quantities
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports.workshop import TAPE_STD
from dart_hal.core.types import INTERVAL_90, State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.estimation.ring import RingLearner
from dart_hal.vehicle.sets import PAPER

from .by_hand import explain_standstill
from .measured import FitGraph, Measured, list_outdated
from .procedure import Bench, Option, Procedure, ProcedurePlan
from .ring_table import make_ring_table
from .runner import driving
from .straight import Rolled, roll

# m of each roll, number of rolls, m/s in turn: 0.05 % of the travel, 75 turns of the ring or more.
DEFAULT_DISTANCE = 3.0
DEFAULT_RUNS = 2
ROLL_SPEEDS = (0.35, 0.5)
# Share by which no tyre differs from the drawing, but a distance in feet does.
MAX_TRAVEL_CHANGE = 0.15
# Standard errors; two rolls of one car on one floor differ by less.
MAX_ROLL_DIFFERENCE = 4.0
# EDGES frames that are requested at once: eight turns of the ring.
REQUESTED_EDGES = 20
# STATE frames without an EDGES frame after which more are requested. At these speeds one arrives
# with every third to sixth STATE.
MAX_FRAMES_WITHOUT_EDGES = 20
# m of a roll: 2 mm of tape are 0.2 % of it.
MIN_ROLL_DISTANCE = 1.0
# m beyond the taped distance: length of the car, and distance to stop.
ROLL_OUT = 1.0
# Frames over which speed and pulse are averaged: four turns of the ring.
AVERAGED_FRAMES = 40
# Share of the target speed from which the pulse is constant.
MIN_SPEED_SHARE = 0.9
# s in which a speed shall return to its target.
RETURN_TIME = 0.7
# Counts of correction from which the pulse changes: with half a count it would alternate.
MIN_COUNT_CHANGE = 0.75
# s after a change of the pulse in which intervals are ignored: two PWM frames, the ESC, and the
# eight intervals of a frame.
CHANGE_SETTLING = 0.15


@dataclass(frozen=True, slots=True)
class Taped:
    """One roll, and its distance by the tape [m]."""

    rolled: Rolled
    distance: float


def plan(files: CarFiles, distance: float = DEFAULT_DISTANCE, runs: int = DEFAULT_RUNS
         ) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    speeds = [_speed(k) for k in range(runs)]
    seconds = sum(distance / speed + 8.0 for speed in speeds)
    return ProcedurePlan(
        f"rolls straight {runs} times over {distance:.1f} m at {min(speeds)} to {max(speeds)} "
        f"m/s to measure the travel per edge of the encoder and its ring: about {seconds:.0f} "
        f"s, a straight floor of {distance + ROLL_OUT:.1f} m x 1 m, a tape and chalk",
        seconds, (distance + ROLL_OUT, 1.0))


def measure(bench: Bench, distance: float = DEFAULT_DISTANCE, runs: int = DEFAULT_RUNS) -> Measured:
    """Measure travel per edge and ring table; the operator enters the distance of each roll.

    Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    files = bench.files
    taped: list[Taped] = []
    rings: list[RingLearner] = []
    for k in range(runs):
        bench.progress(k / runs, f"roll {k + 1} of {runs}")
        bench.workshop.mark()
        with explain_standstill(bench.car, bench.workshop):
            rolled, ring = _roll(bench.car, distance, _speed(k))
        rings.append(ring)
        taped.append(Taped(rolled, bench.workshop.distance()))
        _check_plausible(taped[-1], files)
    metres, residual = travel_per_edge(taped)
    table, notes = make_ring_table(rings, files.config.encoder.edges_per_rev)
    old = files.metres_per_edge.value
    changed = abs(metres.value - old) > 2.0 * INTERVAL_90 * metres.std
    quantities: dict[str, Quantity | Quantities] = {"encoder.metres_per_edge": metres}
    if table is not None:
        quantities["encoder.ring"] = table
    return Measured(files.config.name, bench.source, "encoder", quantities,
                    residual, sum(t.rolled.duration for t in taped),
                    (*notes, *list_outdated(files, changed, f"{1e3 * old:.4f} mm per edge",
                                             "throttle", "steering")),
                    graph=graph_rolls(taped, metres))


def graph_rolls(taped: Sequence[Taped], metres: Quantity) -> FitGraph:
    """Return the taped distance of each roll minus the distance by the edges."""
    edges = np.array([t.rolled.edges for t in taped], dtype=float)
    distance = np.array([t.distance for t in taped])
    ends = np.array([0.0, float(edges.max())])
    return FitGraph("Taped distance of each roll minus that by the encoder", "edges counted",
                 "difference [mm]", edges, 1e3 * (distance - metres.value * edges), ends,
                 0.0 * ends, 1e3 * INTERVAL_90 * metres.std * ends)


def _speed(run: int) -> float:
    """Target speed of a roll [m/s]."""
    return ROLL_SPEEDS[run % len(ROLL_SPEEDS)]


def _roll(car: Car, distance: float, speed: float) -> tuple[Rolled, RingLearner]:
    """Roll once and collect the intervals between edges."""
    constant = ConstantThrottle(car.files, speed)
    learner = RingLearner()
    without_edges = MAX_FRAMES_WITHOUT_EDGES

    def on_frame(state: State) -> float | None:
        nonlocal without_edges
        received = car.answers("EDGES")
        pulse = constant.update(state)
        if pulse is None:
            return None
        for edges in received if constant.is_steady(state.t) else ():
            learner.add(edges["first_count"], edges["interval"])
        without_edges = 0 if received else without_edges + 1
        if without_edges >= MAX_FRAMES_WITHOUT_EDGES:
            car.request("EDGES_REQ", frames=REQUESTED_EDGES)
            without_edges = 0
        return pulse

    with driving(car) as runner:
        return roll(runner, car.files, distance, speed, on_frame), learner


class ConstantThrottle:
    """Throttle pulse of one roll: whole counts, rarely changed, so that the speed is kept.

    One count changes the acceleration by 0.17 m/s2. A speed between two counts therefore rises and
    falls over seconds.
    """

    def __init__(self, files: CarFiles, speed: float) -> None:
        self.pulse_us: float | None = None
        self._since = math.inf
        self._count = counter_of(files)[1]
        self._speed = speed
        self._per_count = (PAPER.duty_motor.d - PAPER.duty_motor.e * speed) / PAPER.body.mass * (
            self._count / files.config.throttle.span_us)
        self._recent: deque[State] = deque(maxlen=AVERAGED_FRAMES)

    def update(self, state: State) -> float | None:
        """Return the pulse [us] after this State; None until the car has its speed."""
        recent = self._recent
        recent.append(state)
        if len(recent) < AVERAGED_FRAMES:
            return self.pulse_us
        speeds = np.array([s.speed for s in recent]).reshape(2, -1).mean(axis=1)
        # Counts from the present acceleration to the one that corrects the speed in RETURN_TIME.
        acceleration = (speeds[1] - speeds[0]) / (0.5 * (recent[-1].t - recent[0].t))
        target = (self._speed - speeds.mean()) / RETURN_TIME
        counts = (target - acceleration) / self._per_count
        if self.pulse_us is None and speeds.mean() > MIN_SPEED_SHARE * self._speed:
            self._hold(float(np.mean([s.applied.throttle_us for s in recent])), counts, state.t)
        elif self.pulse_us is not None and abs(counts) > MIN_COUNT_CHANGE:
            self._hold(self.pulse_us, counts, state.t)
        return self.pulse_us

    def is_steady(self, t: float) -> bool:
        """Return whether the intervals received at t [s] are of one pulse."""
        return t - self._since > CHANGE_SETTLING

    def _hold(self, pulse_us: float, counts: float, t: float) -> None:
        self._since = t
        self.pulse_us = round(pulse_us / self._count + counts) * self._count
        self._recent.clear()


def travel_per_edge(taped: Sequence[Taped]) -> tuple[Quantity, str]:
    """Return (metres per edge, a sentence on how well the rolls agree).

    Counting begins and ends anywhere between two edges: a uniform error of one gap at each end,
    with the variance gap^2 / 12. Raises CalibrationFailed if the rolls contradict each other.
    """
    edges = np.array([t.rolled.edges for t in taped], dtype=float)
    metres = np.array([t.distance for t in taped])
    bend = np.array([t.rolled.bend for t in taped])
    value = float(metres.sum() / edges.sum())
    variance = TAPE_STD**2 + value**2 / 6.0 + bend**2
    error = metres - value * edges
    worst = float(np.max(np.abs(error) / np.sqrt(variance)))
    most = 1e3 * float(np.max(np.abs(error)))
    residual = f"rolls differ from their mean by {most:.1f} mm at most"
    if worst > MAX_ROLL_DIFFERENCE:
        limit = MAX_ROLL_DIFFERENCE * math.sqrt(float(variance.max()))
        raise CalibrationFailed(
            "the rolls do not agree with each other", found=residual,
            expected=f"at most {1e3 * limit:.0f} mm",
            likely="the tape was misread, a wheel slipped, or edges were lost or doubled",
            remedy="run it again; dart-hal doctor shows the encoder")
    std = float(math.sqrt(variance.sum()) / edges.sum())
    return Quantity(value, std, f"tape, {len(taped)} rolls, {metres.sum():.2f} m"), residual


def _check_plausible(taped: Taped, files: CarFiles) -> None:
    rolled = taped.rolled
    known = files.metres_per_edge.value
    if abs(taped.distance / (rolled.edges * known) - 1.0) <= MAX_TRAVEL_CHANGE:
        return
    raise CalibrationFailed(
        "the distance does not fit the edges that were counted",
        found=f"{taped.distance:.3f} m for {rolled.edges} edges",
        expected=f"{rolled.edges * known:.2f} m within {MAX_TRAVEL_CHANGE:.0%}",
        likely="the wheels were off the ground or spun, the distance is not in metres, or marks "
               "of the ring are missing or counted twice",
        remedy="measure from chalk mark to chalk mark in metres and run it again; another wheel "
               "or ring: [encoder] metres_per_edge in car.toml first")


def _adapt(floor: tuple[float, float]) -> dict[str, float]:
    """Choose the distance for a floor of (length, width) [m]."""
    return {"distance": max(min(DEFAULT_DISTANCE, max(floor) - ROLL_OUT), MIN_ROLL_DISTANCE)}


calibrate_encoder = Procedure(
    name="encoder",
    help="""Travel per edge of the encoder, and spacing of its ring.

    The car rolls straight; you measure the distance with a tape. Missing and double marks are
    reported. On sim:// the simulated operator measures.
    """,
    plan=plan, measure=measure, adapt=_adapt,
    options=(
        Option("distance", "m of each roll; twice the length halves the error",
               DEFAULT_DISTANCE, "m", MIN_ROLL_DISTANCE, 20.0),
        Option("runs", "rolls; a single one cannot show a misread tape", DEFAULT_RUNS, "", 1, 10)),
    keys=("encoder.metres_per_edge",), after=("clock",))
