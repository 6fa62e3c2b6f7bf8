"""Plausibility of an IMU sample: all zeros, range, step, agreement with the wheels.

A part that answers does not necessarily measure: a brown-out leaves a BNO055 with
zeros, a bad solder joint turns words into noise. A sample that fails is not given
out as valid and never reaches the odometry. Afterwards several good samples in a
row are required, because either side of a step may have been the wrong one.

The turn rate by the wheels is v tan(delta) / L. Below a lateral acceleration that
every ground allows, the gyro must agree with it in both directions. Above, a
smaller turn rate is understeer and correct. A larger one, or a turn to the other
side, is a sliding car if the lateral acceleration, about v omega, agrees with the
gyro: CAR_SLIDES is reported. If it agrees with the wheels, the gyro is wrong.
"""

from __future__ import annotations

from collections import deque
from math import inf, tan

from dart_hal.core.types import Doubt

Vector = tuple[float, float, float]

# rad/s about any axis. The car's fastest recorded turn is 4.5 rad/s (drifting); turning it over by
# hand reaches 10. The part itself ends at 34.9 (2000 deg/s).
MAX_TURN_RATE = 12.0
# m/s2 on any axis: the 4 g of the fusion modes, and 1 g that the fusion subtracts.
MAX_SPECIFIC_FORCE = 49.1
# rad/s2. Both axles at their grip limit in opposite directions: (7.0 N 0.080 m + 6.1 N 0.093 m) /
# 0.0048 kg m2 = 235 (set upstream-2024, the livelier of the two).
MAX_ANGULAR_ACCELERATION = 250.0
# rad/s: quantum, noise and the skew of two reads.
MIN_GYRO_STEP = 0.2
# s between two samples beyond which their step is not checked.
MAX_SAMPLE_GAP = 0.1
# Good samples in a row, 50 ms, until the IMU is trusted again. Random words pass range and step
# once in (0.07 0.15)^3 = 1e-6; five in a row never occur.
MIN_GOOD_SAMPLES = 5
# s: 0.15 delay and 0.13 lag of the steering, 0.17 for a full turn of a slow servo.
MAX_STEERING_DELAY = 0.45
# rad by which the road wheels may differ from the commanded angle: trim of 0.06 of the command
# (0.036 rad), backlash, and the paper's map on another car.
ANGLE_ERROR = 0.06
# Additional difference as a share of the angle.
ANGLE_ERROR_SHARE = 0.2
# rad/s: bias before the first standstill, rocking.
TURN_RATE_ERROR = 0.25
# m/s2 of lateral acceleration that every ground allows: half of what the weaker front tyre gives
# (2.6 N on 8.9 N of load: 2.9 m/s2).
MIN_LATERAL_GRIP = 1.5
# m/s: below, the encoder's sign and the wheel angle are not informative.
MIN_COMPARED_SPEED = 0.25
# s over which lateral accelerations are averaged: a slide that just begins is not steady.
LATERAL_FILTER_TIME = 0.2
# m/s2 by which gyro times speed must differ from the lateral acceleration: 3 deg of roll (0.5),
# mount (0.3), and the remaining change of v_y.
LATERAL_ERROR = 1.0
# s that a disagreement must last: a kerb or a push ends sooner.
MIN_DISAGREEMENT_TIME = 0.25


class ImuCheck:
    """Checks samples in the order of their arrival; call ``judge`` once per frame.

    After a call: ``trusted`` the sample may be used; ``doubts`` gives the reason if not,
    or CAR_SLIDES, with which the sample stays valid. wheelbase [m].
    """

    def __init__(self, wheelbase: float) -> None:
        self._wheelbase = wheelbase
        self.trusted = False
        self.doubts: frozenset[str] = frozenset()
        self._last_fault = Doubt.IMU_STEP
        self._good_samples = MIN_GOOD_SAMPLES
        self._last_gyro: Vector | None = None
        self._last_t = -inf
        self._turns: deque[tuple[float, float, float]] = deque()
        self._disagrees_since: float | None = None
        self._lateral = self._gyro_lateral = 0.0
        self._now = -inf

    def restart(self) -> None:
        """Forget the last sample: the device clock restarted."""
        self._last_gyro = None
        self._last_t = -inf
        self._disagrees_since = None
        self._turns.clear()

    def judge(self, now: float, t_imu: float, gyro: Vector | None, acc: Vector | None,
              turn: float, speed: float, steering: float) -> bool:
        """Return whether the sample of this frame may be used.

        now, t_imu [s]: device times of frame and sample; gyro [rad/s] and acc
        [m/s2] in body axes, None = not valid by the Nano; turn [rad/s]: gyro
        about z without its bias; speed [m/s] signed, 0.0 where nothing is to be
        compared; steering [rad] of the road wheels, as commanded.
        """
        low, high = self._wheel_turn_rates(now, speed, steering)
        if gyro is None or acc is None:
            self._disagrees_since = None
            return self._conclude(False, frozenset())
        if t_imu != self._last_t:
            self._check_sample(t_imu, gyro, acc)
        share = min((now - self._now) / LATERAL_FILTER_TIME, 1.0)
        self._lateral += (acc[1] - self._lateral) * share
        self._gyro_lateral += (speed * turn - self._gyro_lateral) * share
        self._now = now
        good = self._good_samples >= MIN_GOOD_SAMPLES
        doubt = self._compare_with_wheels(now, turn, low, high, speed) if good else None
        if not good or doubt == Doubt.IMU_DISAGREES:
            return self._conclude(False, frozenset({(doubt or self._last_fault).value}))
        return self._conclude(True, frozenset({doubt.value}) if doubt else frozenset())

    def _conclude(self, trusted: bool, doubts: frozenset[str]) -> bool:
        """Store and return the result of a frame."""
        self.trusted = trusted
        self.doubts = doubts
        return trusted

    def _check_sample(self, t_imu: float, gyro: Vector, acc: Vector) -> None:
        """Check one new sample for all zeros, range and step."""
        fault: Doubt | None = None
        if not any(gyro) and not any(acc):
            fault = Doubt.IMU_ZERO
        elif max(map(abs, gyro)) > MAX_TURN_RATE or max(map(abs, acc)) > MAX_SPECIFIC_FORCE:
            fault = Doubt.IMU_RANGE
        elif self._last_gyro is not None and 0.0 < t_imu - self._last_t < MAX_SAMPLE_GAP:
            limit = MIN_GYRO_STEP + MAX_ANGULAR_ACCELERATION * (t_imu - self._last_t)
            if max(abs(a - b) for a, b in zip(gyro, self._last_gyro, strict=True)) > limit:
                fault = Doubt.IMU_STEP
        self._last_gyro = gyro
        self._last_t = t_imu
        if fault is None:
            self._good_samples += 1
        else:
            self._good_samples = 0
            self._last_fault = fault

    def _wheel_turn_rates(self, now: float, speed: float, steering: float) -> tuple[float, float]:
        """Turn rates [rad/s], lowest and highest, by the wheels within the steering delay."""
        error = ANGLE_ERROR + ANGLE_ERROR_SHARE * abs(steering)
        a = speed * tan(steering - error) / self._wheelbase
        b = speed * tan(steering + error) / self._wheelbase
        turns = self._turns
        turns.append((now, min(a, b), max(a, b)))
        while turns[0][0] < now - MAX_STEERING_DELAY:
            turns.popleft()
        return (min(t[1] for t in turns) - TURN_RATE_ERROR,
                max(t[2] for t in turns) + TURN_RATE_ERROR)

    def _compare_with_wheels(self, now: float, yaw_rate: float, low: float, high: float,
                             speed: float) -> Doubt | None:
        """Return the disagreement of gyro and wheels that has lasted, or None."""
        # 1. Is the bend gentle enough that every ground holds the car?
        lateral = abs(speed) * max(abs(yaw_rate), -low, high)
        has_grip = lateral < MIN_LATERAL_GRIP
        # 2. If not, understeer explains every turn rate from 0 to that of the wheels.
        if not has_grip:
            low = min(low, 0.0)
            high = max(high, 0.0)
        if abs(speed) < MIN_COMPARED_SPEED or low <= yaw_rate <= high:
            self._disagrees_since = None
            return None
        if self._disagrees_since is None:
            self._disagrees_since = now
        if now - self._disagrees_since < MIN_DISAGREEMENT_TIME:
            return None
        # 3. Beyond the grip limit the lateral acceleration decides between gyro and wheels.
        if not has_grip:
            wheels = min(max(self._lateral, min(speed * low, speed * high)),
                         max(speed * low, speed * high))
            has_grip = abs(self._lateral - self._gyro_lateral) > (
                LATERAL_ERROR + abs(self._lateral - wheels))
        return Doubt.IMU_DISAGREES if has_grip else Doubt.CAR_SLIDES
