"""``calibrate encoder``: travel per edge from a taped distance, spacing of the ring's edges.

The car rolls straight, from rest to rest, along a tape; whoever stands beside
it says how far. The tape (2 mm) and the two gaps in which the counting began
and ended are the error, so a longer roll is a better one. While it rolls the
Nano sends every interval between edges, of which ``ring_table`` makes the ring.

The pulse is frozen before the intervals count. A wheel whose speed swings once a turn looks like a
ring with uneven marks. A speed loop makes it swing, for it answers the marks; so do the counts of
the PCA9685, for at 0.4 m/s the ring turns once in five of its frames, and the pattern of rounded
pulses meets the same marks again and again. A whole number of counts does neither. What drive train
and floor do in step with the ring depends on the speed, so the rolls have different ones.
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

from .by_hand import naming
from .measured import Measured, map_outdated
from .procedure import Bench, Option, Procedure, ProcedurePlan
from .ring_table import ring_table
from .runner import driving
from .straight import Rolled, roll

DISTANCE, RUNS, SPEEDS = 3.0, 2, (0.35, 0.5)
"""m of each roll, rolls, m/s in turn: 0.05 % of the travel, 75 turns of the ring or more."""
IMPLAUSIBLE = 0.15
"""Share by which no tyre differs from the drawing; a distance in feet does."""
DISAGREE = 4.0
"""Standard errors; two rolls of one car on one floor lie closer."""
AHEAD, SILENT = 20, 20
"""EDGES frames asked for at once, eight turns of the ring; frames of STATE without any after
which more are asked for. At these speeds one comes with every third to sixth STATE."""
SHORTEST = 1.0
"""m of a roll: 2 mm of tape are 0.2 % then."""
ROLL_OUT = 1.0
"""m beyond the taped distance: the car's length, and what it takes to stop."""
AVERAGED = 40
"""Frames, four turns of the ring, over which speed and pulse are averaged."""
REACHED = 0.9
"""Of the speed, from which the pulse is frozen."""
RETURNS, ANOTHER = 0.7, 0.75
"""s in which a speed shall come back to what it should be, and counts that are missing for that
from which on they are given: with half a count the car would go up and down in steps."""
ANSWERED = 0.15
"""s after another pulse in which intervals do not count: two PWM frames, the ESC, and the eight
intervals of a frame."""


@dataclass(frozen=True, slots=True)
class Taped:
    """One roll and what the tape said [m]."""

    rolled: Rolled
    distance: float


def plan(files: CarFiles, distance: float = DISTANCE, runs: int = RUNS) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    speeds = [_speed(k) for k in range(runs)]
    seconds = sum(distance / speed + 8.0 for speed in speeds)
    return ProcedurePlan(
        f"rolls straight {runs} times over {distance:.1f} m at {min(speeds)} to {max(speeds)} "
        f"m/s to measure the travel per edge of the encoder and its ring: about {seconds:.0f} "
        f"s, a straight floor of {distance + ROLL_OUT:.1f} m x 1 m, a tape and chalk",
        seconds, (distance + ROLL_OUT, 1.0))


def measure(bench: Bench, distance: float = DISTANCE, runs: int = RUNS) -> Measured:
    """Measure travel per edge and ring table; the workshop answers how far the car rolled.

    Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    files = bench.files
    taped: list[Taped] = []
    rings: list[RingLearner] = []
    for k in range(runs):
        bench.progress(k / runs, f"roll {k + 1} of {runs}")
        bench.workshop.mark()
        with naming(bench.car, bench.workshop):
            rolled, ring = _roll(bench.car, distance, _speed(k))
        rings.append(ring)
        taped.append(Taped(rolled, bench.workshop.distance()))
        _plausible(taped[-1], files)
    metres, residual = travel_per_edge(taped)
    table, notes = ring_table(rings, files.config.encoder.edges_per_rev)
    old = files.metres_per_edge.value
    changed = abs(metres.value - old) > 2.0 * INTERVAL_90 * metres.std
    quantities: dict[str, Quantity | Quantities] = {"encoder.metres_per_edge": metres}
    if table is not None:
        quantities["encoder.ring"] = table
    return Measured(files.config.name, bench.source, "encoder", quantities,
                    residual, sum(t.rolled.duration for t in taped),
                    (*notes, *map_outdated(files, changed, f"{1e3 * old:.4f} mm per edge")))


def _speed(run: int) -> float:
    """m/s of a roll."""
    return SPEEDS[run % len(SPEEDS)]


def _roll(car: Car, distance: float, speed: float) -> tuple[Rolled, RingLearner]:
    frozen, learner = Frozen(car.files, speed), RingLearner()
    silent_for = SILENT

    def listen(state: State) -> float | None:
        nonlocal silent_for
        came, pulse = car.answers("EDGES"), frozen.see(state)
        if pulse is None:
            return None
        for edges in came if frozen.steady(state.t) else ():
            learner.add(edges["first_count"], edges["interval"])
        silent_for = 0 if came else silent_for + 1
        if silent_for >= SILENT:
            car.request("EDGES_REQ", frames=AHEAD)
            silent_for = 0
        return pulse

    with driving(car) as runner:
        return roll(runner, car.files, distance, speed, listen), learner


class Frozen:
    """The throttle's pulse of one roll: whole counts, seldom another, so that a speed is kept.

    One count changes the acceleration by 0.17 m/s2, so a speed between two of them goes up and
    down with both in turn, over seconds.
    """

    def __init__(self, files: CarFiles, speed: float) -> None:
        self.pulse_us: float | None = None
        self._since = math.inf
        self._count, self._speed = counter_of(files)[1], speed
        self._per_count = (PAPER.motor.d - PAPER.motor.e * speed) / PAPER.body.mass * (
            self._count / files.config.throttle.span_us)
        self._recent: deque[State] = deque(maxlen=AVERAGED)

    def see(self, state: State) -> float | None:
        """The pulse [us] to hold after this State, None until the car has its speed."""
        recent = self._recent
        recent.append(state)
        if len(recent) < AVERAGED:
            return self.pulse_us
        speeds = np.array([s.speed for s in recent]).reshape(2, -1).mean(axis=1)
        gained = (speeds[1] - speeds[0]) / (0.5 * (recent[-1].t - recent[0].t))
        wanted = (self._speed - speeds.mean()) / RETURNS
        counts = (wanted - gained) / self._per_count
        if self.pulse_us is None and speeds.mean() > REACHED * self._speed:
            self._hold(float(np.mean([s.applied.throttle_us for s in recent])), counts, state.t)
        elif self.pulse_us is not None and abs(counts) > ANOTHER:
            self._hold(self.pulse_us, counts, state.t)
        return self.pulse_us

    def steady(self, t: float) -> bool:
        """Whether the intervals that came by t [s] are of one pulse."""
        return t - self._since > ANSWERED

    def _hold(self, pulse_us: float, counts: float, t: float) -> None:
        self._since = t
        self.pulse_us = round(pulse_us / self._count + counts) * self._count
        self._recent.clear()


def travel_per_edge(taped: Sequence[Taped]) -> tuple[Quantity, str]:
    """(metres per edge, how well the rolls agree). Errors: CalibrationFailed if they do not.

    Counting begins and ends anywhere between two edges: a uniform error of one
    gap at either end.
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
    if worst > DISAGREE:
        raise CalibrationFailed(
            "the rolls do not agree with each other", found=residual,
            expected=f"at most {1e3 * DISAGREE * math.sqrt(float(variance.max())):.0f} mm",
            likely="the tape was misread, a wheel slipped, or edges were lost or doubled",
            remedy="run it again; dart-hal doctor shows the encoder")
    std = float(math.sqrt(variance.sum()) / edges.sum())
    return Quantity(value, std, f"tape, {len(taped)} rolls, {metres.sum():.2f} m"), residual


def _plausible(taped: Taped, files: CarFiles) -> None:
    rolled, known = taped.rolled, files.metres_per_edge.value
    if abs(taped.distance / (rolled.edges * known) - 1.0) <= IMPLAUSIBLE:
        return
    raise CalibrationFailed(
        "the distance does not fit the edges that were counted",
        found=f"{taped.distance:.3f} m for {rolled.edges} edges",
        expected=f"{rolled.edges * known:.2f} m within {IMPLAUSIBLE:.0%}",
        likely="the wheels were off the ground or spun, the distance is not in metres, or marks "
               "of the ring are missing or counted twice",
        remedy="measure from chalk mark to chalk mark in metres and run it again; another wheel "
               "or ring: [encoder] metres_per_edge in car.toml first")


def _adapt(floor: tuple[float, float]) -> dict[str, float]:
    """Roll as far as the floor is long."""
    return {"distance": max(min(DISTANCE, max(floor) - ROLL_OUT), SHORTEST)}


calibrate_encoder = Procedure(
    name="encoder",
    help="""Travel per edge of the encoder, and how its ring is spaced.

    The car rolls straight; you chalk where it starts and type how far it came,
    by a tape. Missing and double marks of the ring are named. On sim:// the
    simulated world holds the tape.
    """,
    plan=plan, measure=measure, adapt=_adapt,
    options=(
        Option("distance", "m of each roll; twice as long is twice as exact", DISTANCE, "m",
               SHORTEST, 20.0),
        Option("runs", "rolls; with one alone a misread tape is not noticed", RUNS, "", 1, 10)),
    keys=("encoder.metres_per_edge",), after=("clock",))
