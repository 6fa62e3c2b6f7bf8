"""Find the cause of missing motion: have the wheels turned by hand, then try the motor.

With the throttle alone, a blocked wheel, an unplugged encoder and an empty battery give the same
result: no edges. When the wheels are turned by hand, the three differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop

from .runner import NoMotion, driving

# s: a push by hand, and the wheels at rest again.
PUSH_DURATION = 1.5
# Throttle that moves every car, and s for which it is tried.
TEST_THROTTLE = 0.3
TEST_DURATION = 0.6
# Edges; by hand a wheel turns by a turn of the ring or more: 20 edges.
MIN_HAND_EDGES = 5


def check_wheels_by_hand(car: Car, workshop: Workshop) -> None:
    """Have the wheels turned by hand and count edges.

    Raises CalibrationFailed for a blocked wheel or an encoder that does not count.
    """
    before = next(iter(car.states())).ticks
    free = workshop.push()
    edges = [state.ticks for state in car.states(duration=PUSH_DURATION)][-1] - before
    if not free:
        raise CalibrationFailed("a wheel is blocked", found="the wheels do not turn by hand",
                                expected="wheels that turn freely",
                                likely="a cable or a stone in a wheel, a gear without play",
                                remedy="free it; then run it again")
    if edges < MIN_HAND_EDGES:
        raise CalibrationFailed(
            "the encoder does not count", found=f"{edges} edges while the wheels were turned by "
            "hand", expected=f"at least {car.files.config.encoder.edges_per_rev} edges per turn",
            likely="unplugged, or its sensor too far from the ring",
            remedy="turn a wheel by hand and watch dart-hal doctor")


@contextmanager
def explain_standstill(car: Car, workshop: Workshop) -> Iterator[None]:
    """Replace a NoMotion of the block by an error that names the cause."""
    try:
        yield
    except NoMotion as error:
        raise diagnose_no_motion(car, workshop, error) from error


def diagnose_no_motion(car: Car, workshop: Workshop, error: NoMotion) -> CalibrationFailed:
    """Stop the car and return the error with the cause of missing motion.

    If the motor responds to a test pulse, the original ``error`` is returned. Raises as
    ``check_wheels_by_hand``.
    """
    car.stop()
    check_wheels_by_hand(car, workshop)
    return error if _motor_responds(car) else diagnose_no_edges(car, workshop,
                                                                error.found or "no edges")


def _motor_responds(car: Car) -> bool:
    """Return whether a test pulse gives edges; it ends with the first few."""
    files = car.files
    pulse = files.neutral_us + TEST_THROTTLE * files.config.throttle.span_us
    with driving(car):
        before: int | None = None
        for state in car.states(duration=TEST_DURATION):
            before = state.ticks if before is None else before
            if state.ticks - before >= MIN_HAND_EDGES:
                return True
            car.pulses(steering_us=files.config.steering.center_us, throttle_us=pulse)
    return False


def diagnose_no_edges(car: Car, workshop: Workshop, found: str) -> CalibrationFailed:
    """Stop the car, check wheels and encoder, and return the error for the remaining cause.

    If both are in order, only the motor remains. Raises as ``check_wheels_by_hand``.
    """
    car.stop()
    check_wheels_by_hand(car, workshop)
    return CalibrationFailed(
        "the motor does not answer", found=found, expected="wheels that turn",
        likely="no battery or an empty one, the ESC switched off or not armed (it needs 2 s of "
               "neutral after power-on), or a lead of the motor loose",
        remedy="charge the battery, switch the ESC on; run it again")
