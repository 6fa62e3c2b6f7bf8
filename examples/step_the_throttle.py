"""A script for `dart-hal drive`: one throttle step, straight ahead.

    dart-hal drive examples/step_the_throttle.py --record runs/step.mcap
"""

THROTTLE = 0.25  # -1..1; the paper's car reaches about 1.3 m/s
STEP_AT = 1.0  # s


class _Clock:
    start: float | None = None


def control(state):
    """(steering [rad], throttle) for this State; None ends the drive."""
    if _Clock.start is None:
        _Clock.start = state.t
    t = state.t - _Clock.start
    if t > STEP_AT + 3.0:
        return None
    return 0.0, THROTTLE if t > STEP_AT else 0.0
