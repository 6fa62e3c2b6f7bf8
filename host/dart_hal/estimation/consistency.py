"""Consistency of the encoder with the accelerometer and the model of the car.

    reference   v' = a_x + omega^2 x_imu, pulled to the encoder within SLOW_LEAK:
                faster changes must also appear in the acceleration
    low         smallest speed that the throttle explains
    free        largest speed even of lifted wheels

A reference above the encoder means missing edges. One below it means that the
wheels spin. A speed beyond ``free`` means that edges are noise, for any
reference. Silence while the wheels must turn is a dead encoder.

Missing edges are dangerous: a speed controller would open the throttle. So
ENCODER_LOW remains until the car is disarmed and has been at rest for
``MIN_REST_TIME``. ENCODER_DEAD ends with the next edge, but not before
ENCODER_LOW. The other doubts end by themselves.
"""

from __future__ import annotations

from math import copysign, hypot, inf
from typing import TYPE_CHECKING

from dart_hal.core.types import Doubt

if TYPE_CHECKING:
    from dart_hal.vehicle.parameters import Vehicle

# s: time constant of the slow reference, which detects edges that are missing from the start.
SLOW_LEAK = 1.0
# s: time constant of the quick reference. An offset has little effect on it, so it detects a slow
# wheel that stops.
QUICK_LEAK = 0.2
# m/s2: error of the accelerometer right after its offset was learnt at rest (0.3 deg of tilt).
# Times the time constant of a reference it is a difference of speeds.
LEARNT_OFFSET_ERROR = 0.06
# m/s2 per second since then: the fusion's vertical tilts under acceleration.
OFFSET_ERROR_GROWTH = 0.04
# m/s2 (1.2 deg).
MAX_OFFSET_ERROR = 0.2
# Multiple of the standard deviation that the encoder reports.
ENCODER_SIGMAS = 2.0
# m/s of that deviation that are used: uneven intervals, age of a pair. A larger one may itself be
# caused by missing edges.
MAX_ENCODER_STD = 0.04
# Share of the speed that must be missing for the quick reference: lost edges, not a moment that
# two sensors place differently.
MIN_LOST_SHARE = 0.33
# Share of the change of speed: mounting within 3 deg, scale, filter, age of the pair.
ACCELERATION_GAIN_ERROR = 0.12
# Share of the lateral acceleration that appears along the car: omega v_y at the rear axle with 0.1
# rad of slip, and 3 deg of mounting with 0.05 rad of roll.
LATERAL_SHARE = 0.2
# m/s2: the range of the part ends at 39; the change of speed in a crash is unknown then.
MAX_MEASURED_ACCELERATION = 35.0
# s between the times of encoder and accelerometer: half a pair of edges and its age (7 to 12 ms),
# filter and skew of the IMU. Times the acceleration.
SENSOR_SKEW = 0.025
# s for which an acceleration is used in that.
SKEW_MEMORY = 0.1
# s of agreement that end ENCODER_HIGH and ENCODER_SLIPS.
MIN_AGREEMENT_TIME = 0.5
# s without an edge in which the model must predict MIN_EDGES of them.
MIN_SILENCE = 0.3
# Missing or additional edges, as travel: fewer are the resolution of the encoder, also at a start.
MIN_EDGES = 5
# Edges are missing if the speed is for MIN_DEFICIT_TIME s by SPEED_DEFICIT m/s below ``low``.
SPEED_DEFICIT = 0.1
MIN_DEFICIT_TIME = 0.3
# m/s of a car pushed by hand; faster edges at neutral are noise.
MAX_PUSHED_SPEED = 3.0
# s for which rejected edges are reported.
NOISE_REPORT_TIME = 0.3
# Factor and m/s by which wheels may exceed ``free``: the recorded car reaches 5.16 m/s at a
# throttle of 0.9, where the paper's model of it ends at 4.1.
FREE_SPEED_FACTOR = 1.3
FREE_SPEED_MARGIN = 0.3
# s after the last throttle in which the accelerometer is used: later the car may be carried.
MAX_IDLE_TIME = 1.0
# s at rest, disarmed, after which old doubts are cleared.
MIN_REST_TIME = 1.0
# s: time constant of the accelerometer's offset at rest.
OFFSET_TIME = 0.5
# m/s2: 6 deg of tilt.
MAX_OFFSET = 1.0
# s: time constant of a reference that contradicts the encoder.
DOUBT_LEAK = 5.0


class SpeedReference:
    """Speed [m/s] by the accelerometer, pulled to the encoder with time constant ``leak`` [s]."""

    def __init__(self, leak: float) -> None:
        self._leak = leak
        self.set(0.0)

    def set(self, speed: float) -> None:
        """Start at the speed of the encoder."""
        self.value = speed
        self.gap = 0.0
        self.tolerance = inf
        self._uncertainty = 0.0

    def update(self, speed: float, acceleration: float, uncertainty: float, drift: float,
               extra: float, doubtful: bool, dt: float) -> None:
        """Advance by one frame; set ``gap`` (reference minus encoder) and ``tolerance`` [m/s].

        acceleration, uncertainty, drift [m/s2]: measured, its error, and the error of its offset;
        extra [m/s]: error of the encoder's own speed.
        """
        target = 0.0 if doubtful else copysign(abs(speed), self.value)
        share = dt / (DOUBT_LEAK if doubtful else self._leak)
        self.value += acceleration * dt + (target - self.value) * share
        self._uncertainty += uncertainty * dt - self._uncertainty * dt / self._leak
        self.gap = abs(self.value) - abs(speed)
        self.tolerance = drift * self._leak + self._uncertainty + extra


class EncoderCheck:
    """Checks the wheel speed frame by frame.

    After a call: ``doubts`` against the encoder; ``std`` [m/s]: one sigma of the speed that it may
    miss, 0 while all agree. metres: per edge; x_imu [m]: of the IMU ahead of the rear axle;
    identified: the vehicle model was identified on this car.
    """

    def __init__(self, vehicle: Vehicle, identified: bool, metres: float, x_imu: float) -> None:
        # Imported here, as all of the vehicle model: a program that imports ``Car`` starts sooner.
        from dart_hal.estimation.bounds import SpeedBounds

        self.bounds = SpeedBounds(vehicle, identified)
        self._min_travel = MIN_EDGES * metres
        self._x = x_imu
        self._offset = 0.0
        self._slow = SpeedReference(SLOW_LEAK)
        self._quick = SpeedReference(QUICK_LEAK)
        self.restart()

    def restart(self) -> None:
        """Clear all doubts: the Nano restarted."""
        self.bounds.restart()
        self.doubts: frozenset[str] = frozenset()
        self._slow.set(0.0)
        self._quick.set(0.0)
        self.std = self._recent_acceleration = self._missing = self._excess = 0.0
        self._deficit_time = self._agreement_time = 0.0
        self._low = self._dead = False
        self._high: Doubt | None = None
        self._noise_report = self._rest_time = self._silence = 0.0
        self._idle_time = MAX_IDLE_TIME
        self._offset_error = MAX_OFFSET_ERROR
        self._expected_travel = 0.0
        self._expected_time = 0.0

    def judge(self, dt: float, speed: float, std: float, new: int, rejected: bool,
              throttle: float, steering: float, armed: bool, accel: float | None,
              turn: float | None) -> None:
        """Check one frame.

        dt [s] since the last; speed [m/s] signed with one sigma, and its number of new edges;
        rejected: it dropped edges as noise; throttle -1..1 and steering [rad] at the pins;
        armed: a command may move the car; accel [m/s2] along the car and turn
        [rad/s], None = not trusted.
        """
        if dt <= 0.0:
            return
        self.bounds.advance(throttle, steering, dt)
        self._silence = 0.0 if new else self._silence + dt
        self._noise_report = NOISE_REPORT_TIME if rejected else max(self._noise_report - dt, 0.0)
        self._idle_time = 0.0 if throttle != 0.0 else self._idle_time + dt
        at_rest = throttle == 0.0 and self._silence > MIN_SILENCE
        self._rest_time = self._rest_time + dt if at_rest else 0.0
        if at_rest and not armed:
            self._learn_offset(accel, dt)
        driven = armed and self._idle_time < MAX_IDLE_TIME and self._rest_time < MIN_REST_TIME
        self._update_references(speed, std, accel if driven else None, turn, dt)
        self._compare_acceleration(abs(speed), dt, armed)
        self._compare_model(abs(speed), new, dt, armed)
        self._report(abs(speed))

    # -- the reference -------------------------------------------------------

    def _learn_offset(self, accel: float | None, dt: float) -> None:
        """Learn the offset of the accelerometer at rest, and clear old doubts."""
        if accel is not None:
            share = min(dt / OFFSET_TIME, 1.0)
            offset = self._offset + (accel - self._offset) * share
            self._offset = min(max(offset, -MAX_OFFSET), MAX_OFFSET)
        if self._rest_time > MIN_REST_TIME:
            if accel is not None:
                self._offset_error = LEARNT_OFFSET_ERROR
            self._low = False

    def _update_references(self, speed: float, std: float, accel: float | None, turn: float | None,
                           dt: float) -> None:
        """Advance both references by one frame; without an acceleration restart them."""
        if accel is None or turn is None:
            self._recent_acceleration = 0.0
            self._slow.set(speed)
            self._quick.set(speed)
            return
        self._offset_error = min(self._offset_error + OFFSET_ERROR_GROWTH * dt, MAX_OFFSET_ERROR)
        acceleration = accel - self._offset + turn * turn * self._x
        uncertainty = (abs(acceleration) if abs(accel) > MAX_MEASURED_ACCELERATION
                       else ACCELERATION_GAIN_ERROR * abs(acceleration)
                       + LATERAL_SHARE * abs(turn * speed))
        faded = self._recent_acceleration * (1.0 - min(dt / SKEW_MEMORY, 1.0))
        self._recent_acceleration = max(abs(acceleration), faded)
        doubtful = bool(self._low or self._high is not None or self._missing or self._excess)
        extra = SENSOR_SKEW * self._recent_acceleration + ENCODER_SIGMAS * min(std, MAX_ENCODER_STD)
        for reference in (self._slow, self._quick):
            reference.update(speed, acceleration, uncertainty, self._offset_error, extra, doubtful,
                             dt)

    def _compare_acceleration(self, speed: float, dt: float, armed: bool) -> None:
        """Detect missing and additional edges by the accelerometer."""
        slow = self._slow
        quick = self._quick
        # 1. Travel that the encoder misses, or counts too much, beyond the tolerance.
        is_sudden = quick.gap > max(quick.tolerance, MIN_LOST_SHARE * abs(quick.value))
        gap = slow.gap if slow.gap > slow.tolerance else quick.gap if is_sudden else 0.0
        is_spinning = -quick.gap > max(quick.tolerance, MIN_LOST_SHARE * abs(quick.value))
        excess = -slow.gap if -slow.gap > slow.tolerance else -quick.gap if is_spinning else 0.0
        self._missing = self._missing + gap * dt if gap and self._high is None else 0.0
        self._excess = self._excess + excess * dt if excess else 0.0
        if self._missing >= self._min_travel:
            self._low = True
        # 2. Too much: noise if even free wheels cannot turn so fast, else spin.
        pushed = 0.0 if armed else MAX_PUSHED_SPEED
        impossible = speed > max(FREE_SPEED_FACTOR * self.bounds.free + FREE_SPEED_MARGIN, pushed)
        if impossible or self._excess >= self._min_travel:
            self._high = Doubt.ENCODER_HIGH if impossible else Doubt.ENCODER_SLIPS
            self._agreement_time = 0.0
        elif self._high is not None:
            agrees = -slow.gap < 0.5 * slow.tolerance
            self._agreement_time = self._agreement_time + dt if agrees else 0.0
            if self._agreement_time >= MIN_AGREEMENT_TIME:
                self._high = None

    # -- the model -----------------------------------------------------------

    def _compare_model(self, speed: float, new: int, dt: float, armed: bool) -> None:
        """Detect missing edges by the throttle."""
        low = self.bounds.low
        too_slow = armed and speed < low - SPEED_DEFICIT
        self._deficit_time = self._deficit_time + dt if too_slow else 0.0
        if new:
            self._expected_travel = self._expected_time = 0.0
            self._dead = self._dead and self._low
        elif armed and low > 0.0:
            self._expected_travel += low * dt
            self._expected_time += dt
        is_silent = self._expected_time >= MIN_SILENCE and self._expected_travel >= self._min_travel
        is_stopped = (self._low and self._missing >= self._min_travel
                      and self._idle_time < MIN_SILENCE and self._silence >= 0.5 * MIN_SILENCE)
        if is_silent or is_stopped:
            self._dead = True
        elif self._deficit_time >= MIN_DEFICIT_TIME and self._silence < MIN_SILENCE:
            self._low = True

    # -- the report ----------------------------------------------------------

    def _report(self, speed: float) -> None:
        """Set the doubts, and one sigma [m/s] of the speed that the encoder may miss."""
        doubts = ((Doubt.ENCODER_DEAD, self._dead), (Doubt.ENCODER_LOW, self._low),
                  (Doubt.ENCODER_NOISY, self._noise_report > 0.0))
        names = {name for name, active in doubts if active}
        if self._high is not None:
            names.add(self._high)
        self.doubts = frozenset(name.value for name in names)
        gap = abs(self._slow.gap)
        std = gap if gap > 0.5 * self._slow.tolerance or self._silence > 0.0 else 0.0
        if self._low or self._dead:
            std = max(std, speed, 0.5 * (self.bounds.high - speed))
        if self._high is not None:
            std = max(std, 0.5 * speed)
        self.std = std


def combine_std(reported: float, missing: float) -> float:
    """Combine the reported standard deviation of a speed with that of unmeasured speed [m/s]."""
    return hypot(reported, missing) if missing else reported
