"""Is a sample of the IMU possible? All zeros, range, step, agreement with the wheels.

A part that answers is not yet a part that measures: a brown-out leaves a
BNO055 with zeros, a bad solder joint turns words into noise. What fails here
is not given out as valid and never reaches the odometry; afterwards some good
samples in a row are needed, since nobody can say which side of a step was true.

The turn rate that the wheels explain is v tan(delta) / L. Below a lateral
acceleration that any floor holds, the gyro must agree with it, both ways.
Above, less is understeer and right; more, or a turn to the other side, is a
car that slides, and then the gyro is the better witness: the slide is said,
unless the lateral acceleration, about v omega, speaks for the wheels.
"""

from __future__ import annotations

from collections import deque
from math import inf, tan

from dart_hal.core.types import Doubt

Vector = tuple[float, float, float]

GYRO_RANGE = 12.0
"""rad/s about any axis. The car's fastest turn on record is 4.5 rad/s (drifting); a
hand that turns it over makes 10. The part itself ends at 34.9 (2000 deg/s)."""
ACCEL_RANGE = 49.1
"""m/s2 on any axis: the 4 g of the fusion modes, and 1 g that the fusion takes off."""
GYRO_STEP = 250.0
"""rad/s2. Both axles at the end of their grip against each other: (7.0 N 0.080 m +
6.1 N 0.093 m) / 0.0048 kg m2 = 235 (set upstream-2024, the livelier of the two)."""
STEP_FLOOR = 0.2
"""rad/s: quantum, noise and the skew of two reads."""
LONGEST_STEP = 0.1
"""s between two samples beyond which they say nothing about each other."""
REGAIN = 5
"""Good samples in a row, 50 ms, until the IMU is trusted again. Random words pass
range and step once in (0.07 0.15)^3 = 1e-6; five in a row never happen."""
LAG = 0.45
"""s: 0.15 delay and 0.13 lag of the steering, 0.17 for a full turn of a slow servo."""
ANGLE, ANGLE_SHARE = 0.06, 0.2
"""rad and share by which the road wheels may miss the angle asked for: trim of 0.06 of
the command (0.036 rad), backlash, and the paper's map on a car with its own."""
RATE = 0.25
"""rad/s: bias before the first standstill, rocking."""
HOLDS = 1.5
"""m/s2 of lateral acceleration that every floor holds: half of what the weaker front tyre
gives (2.6 N on 8.9 N of load: 2.9 m/s2)."""
FORWARD = 0.25
"""m/s: below it the encoder's sign and the wheels' angle say little."""
SMOOTH = 0.2
"""s over which lateral accelerations are compared: beginning slides are no steady turn."""
ASIDE = 1.0
"""m/s2 by which gyro times speed must miss the lateral acceleration: 3 deg of roll (0.5), mount
(0.3), and what is left of the change of v_y."""
PERSISTS = 0.25
"""s that a disagreement must last: a kerb or a push ends sooner."""


class ImuCheck:
    """Judges samples in the order of their arrival; call ``judge`` once per frame.

    After a call: ``trusted`` the sample may be used; ``doubts`` names why not,
    or CAR_SLIDES, which leaves the sample valid. wheelbase [m].
    """

    def __init__(self, wheelbase: float) -> None:
        self._wheelbase = wheelbase
        self.trusted = False
        self.doubts: frozenset[str] = frozenset()
        self._why = Doubt.IMU_STEP
        self._good = REGAIN
        self._last: Vector | None = None
        self._t = -inf
        self._turns: deque[tuple[float, float, float]] = deque()
        self._since: float | None = None
        self._aside = self._turned = 0.0
        self._now = -inf

    def restart(self) -> None:
        """The device clock began anew."""
        self._last, self._t, self._since = None, -inf, None
        self._turns.clear()

    def judge(self, now: float, t_imu: float, gyro: Vector | None, acc: Vector | None,
              turn: float, speed: float, steering: float) -> bool:
        """Whether this frame's sample may be used.

        now, t_imu [s]: device times of frame and sample; gyro [rad/s] and acc
        [m/s2] in body axes, None = the Nano vouches for nothing; turn [rad/s]: gyro
        about z without its bias; speed [m/s] signed, 0.0 where nothing is to be
        compared; steering [rad] of the road wheels, as commanded.
        """
        low, high = self._explained(now, speed, steering)
        if gyro is None or acc is None:
            self._since = None
            return self._done(False, frozenset())
        if t_imu != self._t:
            self._sample(t_imu, gyro, acc)
        share = min((now - self._now) / SMOOTH, 1.0)
        self._aside += (acc[1] - self._aside) * share
        self._turned += (speed * turn - self._turned) * share
        self._now = now
        doubt = self._compare(now, turn, low, high, speed) if self._good >= REGAIN else None
        if self._good < REGAIN or doubt == Doubt.IMU_DISAGREES:
            return self._done(False, frozenset({(doubt or self._why).value}))
        return self._done(True, frozenset({doubt.value}) if doubt else frozenset())

    def _done(self, trusted: bool, doubts: frozenset[str]) -> bool:
        self.trusted, self.doubts = trusted, doubts
        return trusted

    def _sample(self, t_imu: float, gyro: Vector, acc: Vector) -> None:
        """All zeros, range and step of one new sample."""
        why: Doubt | None = None
        if not any(gyro) and not any(acc):
            why = Doubt.IMU_ZERO
        elif max(map(abs, gyro)) > GYRO_RANGE or max(map(abs, acc)) > ACCEL_RANGE:
            why = Doubt.IMU_RANGE
        elif self._last is not None and 0.0 < t_imu - self._t < LONGEST_STEP:
            most = STEP_FLOOR + GYRO_STEP * (t_imu - self._t)
            if max(abs(a - b) for a, b in zip(gyro, self._last, strict=True)) > most:
                why = Doubt.IMU_STEP
        self._last, self._t = gyro, t_imu
        if why is None:
            self._good += 1
        else:
            self._good, self._why = 0, why

    def _explained(self, now: float, speed: float, steering: float) -> tuple[float, float]:
        """Lowest and highest turn rate [rad/s] that wheels of the last moments explain."""
        miss = ANGLE + ANGLE_SHARE * abs(steering)
        a = speed * tan(steering - miss) / self._wheelbase
        b = speed * tan(steering + miss) / self._wheelbase
        turns = self._turns
        turns.append((now, min(a, b), max(a, b)))
        while turns[0][0] < now - LAG:
            turns.popleft()
        return min(t[1] for t in turns) - RATE, max(t[2] for t in turns) + RATE

    def _compare(self, now: float, turn: float, low: float, high: float,
                 speed: float) -> Doubt | None:
        """A disagreement with the wheels that has lasted."""
        lateral = abs(speed) * max(abs(turn), -low, high)
        holds = lateral < HOLDS
        if not holds:
            low, high = min(low, 0.0), max(high, 0.0)
        if abs(speed) < FORWARD or low <= turn <= high:
            self._since = None
            return None
        if self._since is None:
            self._since = now
        if now - self._since < PERSISTS:
            return None
        if not holds:
            wheels = min(max(self._aside, min(speed * low, speed * high)),
                         max(speed * low, speed * high))
            holds = abs(self._aside - self._turned) > ASIDE + abs(self._aside - wheels)
        return Doubt.IMU_DISAGREES if holds else Doubt.CAR_SLIDES
