"""``calibrate encoder``: travel per edge from a taped distance, spacing of the ring's edges.

The car rolls straight, from rest to rest, along a tape; whoever stands beside
it says how far. The tape (2 mm) and the two gaps in which the counting began
and ended are the error, so a longer roll is a better one. While it rolls the
Nano sends every interval between edges, of which ``ring_table`` makes the ring.

The pulse is frozen before the intervals count (``frozen``). What drive train and floor do in step
with the ring depends on the speed, so the rolls have different ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.quantity import Quantities
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop
from dart_hal.core.ports.workshop import TAPE
from dart_hal.core.types import NINETY, State
from dart_hal.estimation.ring import RingLearner

from .asking import Ask, Progress, agree, begin, silent
from .by_hand import naming
from .frozen import Frozen
from .measured import Measured, map_outdated
from .ring_table import ring_table
from .runner import AskingCar, Runner
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


@dataclass(frozen=True, slots=True)
class Taped:
    """One roll and what the tape said [m]."""

    rolled: Rolled
    distance: float


def plan(files: CarFiles, distance: float = DISTANCE, runs: int = RUNS) -> str:
    """What is coming, in one sentence: purpose, time, space, tools."""
    speeds = [_speed(k) for k in range(runs)]
    seconds = sum(distance / speed + 8.0 for speed in speeds)
    return (f"rolls straight {runs} times over {distance:.1f} m at {min(speeds)} to {max(speeds)} "
            f"m/s to measure the travel per edge of the encoder and its ring: about {seconds:.0f} "
            f"s, a straight floor of {distance + 1.0:.1f} m x 1 m, a tape and chalk")


def calibrate_encoder(car: AskingCar, workshop: Workshop, *, progress: Progress = silent,
                      ask: Ask = agree, source: str = "", distance: float = DISTANCE,
                      runs: int = RUNS) -> Measured:
    """Measure travel per edge and ring table; nothing is written (``measured.write``).

    ``workshop`` answers how far the car rolled. The car is left stopped, also on
    Ctrl-C. Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    files = car.files
    begin(ask, plan(files, distance, runs))
    taped: list[Taped] = []
    rings: list[RingLearner] = []
    for k in range(runs):
        progress(k / runs, f"roll {k + 1} of {runs}")
        workshop.mark()
        with naming(car, workshop):
            rolled, ring = _roll(car, distance, _speed(k))
        rings.append(ring)
        taped.append(Taped(rolled, workshop.distance()))
        _plausible(taped[-1], files)
    metres, residual = travel_per_edge(taped)
    table, notes = ring_table(rings, files.config.encoder.edges_per_rev)
    old = files.metres_per_edge.value
    changed = abs(metres.value - old) > 2.0 * NINETY * metres.std
    quantities: dict[str, Quantity | Quantities] = {"encoder.metres_per_edge": metres}
    if table is not None:
        quantities["encoder.ring"] = table
    return Measured(files.config.name, source or files.config.name, "encoder", quantities,
                    residual, sum(t.rolled.duration for t in taped),
                    (*notes, *map_outdated(files, changed, f"{1e3 * old:.4f} mm per edge")))


def _speed(run: int) -> float:
    """m/s of a roll."""
    return SPEEDS[run % len(SPEEDS)]


def _roll(car: AskingCar, distance: float, speed: float) -> tuple[Rolled, RingLearner]:
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

    try:
        with car.raw():
            return roll(Runner(car), car.files, distance, speed, listen), learner
    finally:
        car.stop()


def travel_per_edge(taped: Sequence[Taped]) -> tuple[Quantity, str]:
    """(metres per edge, how well the rolls agree). Errors: CalibrationFailed if they do not.

    Counting begins and ends anywhere between two edges: a uniform error of one
    gap at either end.
    """
    edges = np.array([t.rolled.edges for t in taped], dtype=float)
    metres = np.array([t.distance for t in taped])
    bend = np.array([t.rolled.bend for t in taped])
    value = float(metres.sum() / edges.sum())
    variance = TAPE**2 + value**2 / 6.0 + bend**2
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
