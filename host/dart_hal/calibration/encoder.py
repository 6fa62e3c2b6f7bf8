"""``calibrate encoder``: travel per edge from a taped distance, spacing of the ring's edges.

The car rolls straight, from rest to rest, along a tape; whoever stands beside
it says how far. The tape (2 mm) and the two gaps in which the counting began
and ended are the error, so a longer roll is a better one. While it rolls the
Nano sends every interval between edges; divided by the mean of the turn around
it and averaged over the turns, each tells the spacing of one pair of edges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.config import CarFiles, Quantity
from dart_hal.config.quantity import Quantities
from dart_hal.errors import CalibrationFailed
from dart_hal.estimation.ring import LearntRing, RingLearner
from dart_hal.ports import Workshop
from dart_hal.ports.workshop import TAPE
from dart_hal.types import NINETY, State

from .asking import Ask, Progress, agree, begin, silent
from .by_hand import naming
from .measured import Measured, map_outdated
from .runner import AskingCar, Runner
from .straight import Rolled, roll

DISTANCE, RUNS, SPEED = 3.0, 2, 0.4
"""m of each roll, rolls, m/s: 0.05 % of the travel, over a hundred turns of the ring."""
IMPLAUSIBLE = 0.15
"""Share by which no tyre differs from the drawing; a distance in feet does."""
DISAGREE = 4.0
"""Standard errors; two rolls of one car on one floor lie closer."""
AHEAD, SILENT = 20, 20
"""EDGES frames asked for at once, eight turns of the ring; frames of STATE without any after
which more are asked for. At this speed one comes with every fifth STATE."""
SHORTEST = 1.0
"""m of a roll: 2 mm of tape are 0.2 % then."""
FASTEST_SHARE = 0.8
"""Of the speed, from which intervals count: the car no longer speeds up."""
NEIGHBOURS = 4
"""Edges more or less than car.toml says that are tried: two marks missing or double."""
MISSING, DOUBLE = 1.6, 0.65
"""Intervals in units of the mean interval; printed teeth stay within 0.8 to 1.2."""


@dataclass(frozen=True, slots=True)
class Taped:
    """One roll and what the tape said [m]."""

    rolled: Rolled
    distance: float


def plan(files: CarFiles, distance: float = DISTANCE, runs: int = RUNS) -> str:
    """What is coming, in one sentence: purpose, time, space, tools."""
    seconds = runs * (distance / SPEED + 8.0)
    return (f"rolls straight {runs} times over {distance:.1f} m at {SPEED} m/s to measure the "
            f"travel per edge of the encoder and its ring: about {seconds:.0f} s, a straight "
            f"floor of {distance + 1.0:.1f} m x 1 m, a tape and chalk")


def calibrate_encoder(car: AskingCar, workshop: Workshop, *, progress: Progress = silent,
                      ask: Ask = agree, source: str = "", distance: float = DISTANCE,
                      runs: int = RUNS) -> Measured:
    """Measure travel per edge and ring table; nothing is written (``measured.write``).

    ``workshop`` answers how far the car rolled. The car is left stopped, also on
    Ctrl-C. Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    files = car.files
    begin(ask, plan(files, distance, runs))
    learner = RingLearner()
    taped: list[Taped] = []
    for k in range(runs):
        progress(k / runs, f"roll {k + 1} of {runs}")
        workshop.mark()
        with naming(car, workshop):
            rolled = _roll(car, distance, learner)
        taped.append(Taped(rolled, workshop.distance()))
        _plausible(taped[-1], files)
    metres, residual = travel_per_edge(taped)
    ring, notes = ring_table(learner, files.config.encoder.edges_per_rev)
    old = files.metres_per_edge.value
    changed = abs(metres.value - old) > 2.0 * NINETY * metres.std
    quantities: dict[str, Quantity | Quantities] = {"encoder.metres_per_edge": metres}
    if ring is not None:
        quantities["encoder.ring"] = ring
    return Measured(files.config.name, source or files.config.name, "encoder", quantities,
                    residual, sum(t.rolled.duration for t in taped),
                    (*notes, *map_outdated(files, changed, f"{1e3 * old:.4f} mm per edge")))


def _roll(car: AskingCar, distance: float, learner: RingLearner) -> Rolled:
    silent_for = SILENT

    def listen(state: State) -> None:
        nonlocal silent_for
        came = car.answers("EDGES")
        if state.speed < FASTEST_SHARE * SPEED:
            return
        for edges in came:
            learner.add(edges["first_count"], edges["interval"])
        silent_for = 0 if came else silent_for + 1
        if silent_for >= SILENT:
            car.request("EDGES_REQ", frames=AHEAD)
            silent_for = 0

    try:
        with car.raw():
            return roll(Runner(car), car.files, distance, SPEED, listen)
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


def ring_table(learner: RingLearner, edges_per_rev: int
               ) -> tuple[Quantities | None, tuple[str, ...]]:
    """(table of the ring or None, notes). Errors: CalibrationFailed for another number of edges."""
    try:
        near = range(max(2, edges_per_rev - NEIGHBOURS), edges_per_rev + NEIGHBOURS + 1)
        found = learner.period(near)
        ring = learner.learn(found)
        even = _is_even(ring) and found != edges_per_rev
        if even:  # an even ring repeats with any period
            found, ring = edges_per_rev, learner.learn(edges_per_rev)
    except ValueError as error:
        return None, (f"ring not measured: {error}",)
    marks = odd_marks(ring)
    if found != edges_per_rev:
        raise CalibrationFailed(
            f"the ring has {found} edges per revolution", found=marks or f"{found} edges",
            expected=f"{edges_per_rev}, as [encoder] edges_per_rev in car.toml says",
            likely="a mark is missing or counted twice: a broken tooth, dirt, a sensor too far",
            remedy=f"mend the ring, or write edges_per_rev = {found} in car.toml: its table then "
                   "takes care of the gap; run it again")
    text = f"uneven by {100 * float(np.std(ring.fractions)):.1f} % rms"
    notes = [f"ring of {found} edges {text}, {ring.revolutions:.0f} turns, an interval repeats "
             f"within {100 * ring.residual:.2f} %", *([f"caution: {marks}"] if marks else [])]
    table = Quantities(tuple(round(float(f), 6) for f in ring.fractions),
                       tuple(round(float(s), 6) for s in ring.std),
                       f"{ring.revolutions:.0f} turns at {SPEED} m/s")
    return table, tuple(notes)


def odd_marks(ring: LearntRing) -> str:
    """Which intervals of the ring no whole mark makes; empty if there are none."""
    said = []
    for share in ring.fractions.tolist():
        if share > MISSING:
            gone = max(round(share) - 1, 1)
            said.append(f"an interval of {share:.2f} times the mean: {gone} edge(s) missing there")
        elif share < DOUBLE:
            said.append(f"an interval of {share:.2f} times the mean: an edge too many there")
    return "; ".join(said)


def _is_even(ring: LearntRing) -> bool:
    return bool(np.std(ring.fractions) < 2.0 * ring.residual)


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
