"""Before a motor runs: do the wheels turn by hand, and does the encoder count it?

A wheel that is blocked, an encoder that is unplugged and a battery that is empty all look alike
to the throttle. Turned by hand they do not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop

from .runner import NotSeen, driving

ROLLS_OUT = 1.5
"""s: a push of the hand, and the wheels at rest again."""
PULL, PULLED = 0.3, 0.6
"""Throttle that moves every car, and s for which it is tried."""
FEW = 5
"""Edges; a hand turns the wheel by a turn of the ring or more, 20 of them."""


def turn_by_hand(car: Car, workshop: Workshop) -> None:
    """Have the wheels turned. Errors: CalibrationFailed, a blocked wheel or the encoder by name."""
    before = next(iter(car.states())).ticks
    free = workshop.push()
    edges = [state.ticks for state in car.states(duration=ROLLS_OUT)][-1] - before
    if not free:
        raise CalibrationFailed("a wheel is blocked", found="the wheels do not turn by hand",
                                expected="wheels that turn freely",
                                likely="a cable or a stone in a wheel, a gear without play",
                                remedy="free it; then run it again")
    if edges < FEW:
        raise CalibrationFailed(
            "the encoder does not count", found=f"{edges} edges while the wheels were turned by "
            "hand", expected=f"{car.files.config.encoder.edges_per_rev} and more",
            likely="unplugged, or its sensor too far from the ring",
            remedy="turn a wheel by hand and watch dart-hal doctor")


@contextmanager
def naming(car: Car, workshop: Workshop) -> Iterator[None]:
    """Motion that is not seen within is named after the wheels were turned by hand."""
    try:
        yield
    except NotSeen as seen:
        raise name_standstill(car, workshop, seen) from seen


def name_standstill(car: Car, workshop: Workshop, seen: NotSeen) -> CalibrationFailed:
    """The same on the floor, where the throttle of ``seen`` was a speed law's.

    A motor that answers after all leaves ``seen`` as it was said. Errors: as ``name_silence``.
    """
    car.stop()
    turn_by_hand(car, workshop)
    return seen if _answers(car) else name_silence(car, workshop, seen.found or "no edges")


def _answers(car: Car) -> bool:
    """Whether a pull of the motor makes edges; it ends with the first few."""
    files = car.files
    pull = files.neutral_us + PULL * files.config.throttle.span_us
    with driving(car):
        before: int | None = None
        for state in car.states(duration=PULLED):
            before = state.ticks if before is None else before
            if state.ticks - before >= FEW:
                return True
            car.pulses(steering_us=files.config.steering.center_us, throttle_us=pull)
    return False


def name_silence(car: Car, workshop: Workshop, found: str) -> CalibrationFailed:
    """Why no edge came of a throttle: wheel, encoder or, what is left, the motor.

    Stops the car first. Errors: CalibrationFailed for the first two.
    """
    car.stop()
    turn_by_hand(car, workshop)
    return CalibrationFailed(
        "the motor does not answer", found=found, expected="wheels that turn",
        likely="no battery or an empty one, the ESC switched off or not armed (it needs 2 s of "
               "neutral after power-on), or a lead of the motor loose",
        remedy="charge the battery, switch the ESC on; run it again")
