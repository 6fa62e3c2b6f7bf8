"""From STATE frames to States: axes, clock, wheel speed and pose."""

from __future__ import annotations

from collections import deque
from math import inf, nan, tan
from typing import TYPE_CHECKING

from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.types import Applied, Doubt, Health, Limit, State
from dart_hal.estimation.consistency import EncoderCheck, combine_std
from dart_hal.estimation.direction import InertialDirection
from dart_hal.estimation.frames import FrameReader, Mounting, Sample, Vector, flag_names
from dart_hal.estimation.imu_checks import ImuCheck
from dart_hal.estimation.imu_clock import PERIOD, ImuClock, gyro_read_delay
from dart_hal.estimation.odometry import Odometry, OdometryNoise
from dart_hal.estimation.phase import RingPhase
from dart_hal.estimation.single_samples import (
    MIN_ACCELERATION_JUMP,
    MIN_RATE_JUMP,
    AcceptedSample,
    SingleSampleFilter,
)
from dart_hal.estimation.speed import WheelSpeed
from dart_hal.vehicle.load import vehicle_of
from dart_hal.wire.frame import WireFrame
from dart_hal.wire.messages import STATE, STATE_FLAGS

if TYPE_CHECKING:
    from dart_hal.estimation.room import ExternalPoseEstimator

# 8N1: start, eight data bits, stop.
BITS_PER_BYTE = 10
# Lateral share of the speed during CAR_SLIDES: a slip angle of 30 degrees at the rear axle, beyond
# which a car spins.
SLIDING_SPEED_SHARE = 0.5
DIRECTION_DOUBT = frozenset({Doubt.DIRECTION_UNSURE.value})
JUMP_DOUBT = frozenset({Doubt.SAMPLES_JUMPED.value})
# s for which a jump is reported that follows another one within this time: three times the interval
# of one wrong sample in a hundred. A single jump may be a bump of the road. It is counted
# (``Health.jumped``), replaced and covered by the covariance, but not reported.
JUMP_REPORT_TIME = 3.0
TRIPPED_FLAG = 1 << STATE_FLAGS.index("TRIPPED")

# Reports of the firmware's loop, one in 0.5 s, of which the median counts.
MAX_SLOT_REPORTS = 5


def odometry_noise(metres_per_edge: Quantity, gyro_scale: Quantity | None) -> OdometryNoise:
    """Return the error sources of the odometry by the car's files, else the defaults."""
    stated = {"travel_scale": metres_per_edge.std / metres_per_edge.value}
    if gyro_scale is not None:
        stated["gyro_scale"] = gyro_scale.std / gyro_scale.value
    return OdometryNoise(**stated)


def compose_mounting(files: CarFiles) -> Mounting:
    """Compose the mounting of the IMU from a car's files; without a calibration the scale is 1."""
    yaw, pitch, roll = files.imu_mount
    imu = files.calibration.imu if files.calibration else None
    return Mounting(roll, pitch, yaw, imu.gyro_scale.value if imu and imu.gyro_scale else 1.0)


class Telemetry:
    """Estimators of one open car; ``read`` is called once per STATE frame.

    byte_time: transmission time [s] of one byte.
    """

    def __init__(self, files: CarFiles, byte_time: float) -> None:
        imu = files.calibration.imu if files.calibration else None
        known = imu.gyro_scale if imu else None
        bias = imu.gyro_bias if imu and imu.gyro_bias else None
        encoder = files.config.encoder
        self._wheelbase = files.config.geometry.wheelbase
        self._wire_time = STATE.wire_size * byte_time
        self._frames = FrameReader(compose_mounting(files))
        self.clock = ClockFit(byte_time=byte_time)
        self.speed = WheelSpeed(files.metres_per_edge.value, encoder.edges_per_rev, files.ring)
        self.odometry = Odometry(odometry_noise(files.metres_per_edge, known),
                                 gyro_bias=bias.value if bias else 0.0,
                                 gyro_bias_std=bias.std if bias else None)
        self.direction = InertialDirection()
        self.phase = RingPhase() if encoder.rings == 2 else None
        self.imu_clock = ImuClock()
        self._slots: deque[float] = deque(maxlen=MAX_SLOT_REPORTS)
        self._read_delay = gyro_read_delay(nan)[0]
        self.imu = ImuCheck(self._wheelbase)
        self._filters = tuple(SingleSampleFilter(jump) for jump in (
            MIN_RATE_JUMP, MIN_ACCELERATION_JUMP, MIN_ACCELERATION_JUMP))
        self._jumped = 0
        self._jumps = 0
        self._jumped_until = 0.0
        self._last_jump = -inf
        self.encoder = EncoderCheck(vehicle_of(files.model), files.model is not None,
                                    files.metres_per_edge.value, files.config.imu.x)
        # Fuses external poses, where there is a source of them.
        self.room: ExternalPoseEstimator | None = None
        self._ticks = 0
        self._along = 0.0
        self.last_dev = 0.0
        # The Nano's clock began anew with the newest frame.
        self.restarted = False

    def set_byte_time(self, byte_time: float) -> None:
        """Set the transmission time [s] of a byte after a change of the line rate."""
        self._wire_time = STATE.wire_size * byte_time
        self.clock.byte_time = byte_time

    def set_capabilities(self, caps: int) -> None:
        """Set the capabilities of the firmware: HELLO.caps."""
        self._frames.set_capabilities(caps)

    def set_slot(self, longest: float) -> None:
        """Take over the longest cycle [s] of the firmware's loop since the last DIAG.

        The median of the newest reports counts: some cycles contain other work, such as a write to
        the EEPROM.
        """
        if longest > 0.0:
            self._slots.append(longest)
            # The lower median: `statistics` would take 10 ms of the import of a car.
            self._read_delay = gyro_read_delay(sorted(self._slots)[(len(self._slots) - 1) // 2])[0]

    def restart(self) -> None:
        """Restart at the next frame after a boot of the Nano."""
        self._frames.restart()

    def read(self, frame: WireFrame, seq: int, t_arrival: float, bytes_behind: int,
             applied: Applied, lost: int, vcc: float | None) -> State:
        """Return the State of one STATE frame; its ``skipped`` is 0.

        seq: unwrapped number of the frame. t_arrival: host time [s] of its last byte.
        bytes_behind: bytes that arrived after it in the same chunk. applied: what the pins carry.
        lost: frames lost so far. vcc: supply of the Nano [V], None: unknown.
        """
        # 1. Raw integers to SI units in the body axes. A boot of the Nano restarts the estimators.
        sample = self._frames.read(frame.values(), t_arrival)
        self.restarted = sample.restarted
        if sample.restarted:
            self.clock.restart()
            self.odometry.restart()
            self.imu.restart()
            self._jumped_until = 0.0
            self._last_jump = -inf
            for channel in self._filters:
                channel.restart()
            self.imu_clock.restart()
            self.encoder.restart()
            if self.phase is not None:
                self.phase.forget()
        # 2. Time: map the Nano's clock to the host's clock.
        self.clock.add_frame(sample.t_dev, t_arrival, self._wire_time, bytes_behind)
        t, t_std = self.clock.to_host(sample.t_dev)
        rate = self.clock.rate
        # 3. Speed: from the edges; the throttle suggests the sign.
        throttle = applied.throttle
        hint = (throttle > 0.0) - (throttle < 0.0)
        speed, speed_std = self.speed.update(sample.ticks, sample.edge_t, sample.edge_dt,
                                             sample.t_dev, rate, hint)
        # 4. IMU: estimate when it was read, and check its values.
        t_gyro = self.imu_clock.mean_read(sample.imu_t + self._read_delay, sample.look)
        accepted, acc = self._check_imu(sample, t_gyro, speed, speed_std, applied, rate)
        gyro_z = accepted.value if accepted is not None else None
        # 5. Pose: integrate speed and yaw rate; without a yaw rate, the kinematic bicycle model.
        odometry = self.odometry
        counted = accepted.stamp if accepted is not None else t_gyro
        motion = odometry.update(sample.t_dev, self.speed.distance, speed, gyro_z, counted, rate,
                                 speed * tan(applied.steering) / self._wheelbase,
                                 self._undetected_speed(speed, speed_std), self.imu_clock.std,
                                 accepted)
        self.last_dev = sample.t_dev
        # 6. Health, and the pose in the room from external poses.
        imu_age = sample.t_dev - counted + 0.5 * PERIOD
        health = Health(flag_names(sample.flags), imu_age, sample.beat_age, lost, 0, vcc,
                        t_std, "linear", sample.calib, self._doubts(sample.t_dev),
                        self._jumped)
        pose = odometry.pose
        external = (self.room.update(t, pose, motion, acc[0] if acc else None)
                    if self.room is not None else None)
        return State(
            t, seq, speed, combine_std(self.speed.add_undetected_motion(speed_std, acc and acc[0]),
                                       self.encoder.std),
            None if gyro_z is None else gyro_z - odometry.bias.value,
            acc[0] if acc else None, acc[1] if acc else None, sample.ticks, pose,
            applied, health, external)

    def _doubts(self, now: float) -> frozenset[str]:
        found = self.imu.doubts | self.encoder.doubts
        if now < self._jumped_until:
            found |= JUMP_DOUBT
        return found | DIRECTION_DOUBT if self.speed.is_direction_uncertain else found

    def _undetected_speed(self, speed: float, std: float) -> float:
        """Return the speed [m/s] that the wheels may hide while there is a doubt against them."""
        found = self.encoder.std if self.encoder.doubts else 0.0
        if self.speed.rejected:
            found = max(found, std)
        if self.speed.may_have_reversed:
            found = max(found, abs(speed))
        if Doubt.CAR_SLIDES.value in self.imu.doubts:
            found = max(found, SLIDING_SPEED_SHARE * abs(speed))
        return found

    def _update_direction(self, sample: Sample, dt: float, acc: Vector | None) -> None:
        """Determine the direction of travel.

        1. The phase of a second encoder ring determines it with certainty, if there is one.
        2. Otherwise the acceleration determines it, unless the wheels slip: then the measured
           braking and the faster wheels look like reverse.
        """
        speed = self.speed
        phase = self.phase
        usable = acc is not None and not speed.rejected \
            and Doubt.ENCODER_SLIPS.value not in self.encoder.doubts
        inertial = self.direction.add(dt, speed.speed, acc[0] if acc and usable else None)
        by_phase = 0 if phase is None else phase.add(
            sample.t_dev, sample.edge_t, sample.edge_dt, sample.ticks_b, sample.edge_b_t,
            speed.confirmed_direction, inertial)
        speed.correct_direction(by_phase or inertial, certain=by_phase != 0)

    def _check_imu(self, sample: Sample, t_gyro: float, speed: float, std: float, applied: Applied,
                   rate: float) -> tuple[AcceptedSample | None, Vector | None]:
        """Return yaw rate and acceleration if they pass the checks; check the encoder with them."""
        armed = Limit.NOT_ARMED.value not in applied.limited
        gyro = sample.gyro
        acc = sample.acc
        # The IMU is not compared with a speed that is itself in doubt.
        yaw_rate = gyro[2] - self.odometry.bias.value if gyro else 0.0
        compared = 0.0 if self.speed.ambiguous or not armed or self.encoder.doubts else speed
        if not self.imu.judge(sample.t_dev, sample.imu_t, gyro, acc, yaw_rate, compared,
                              applied.steering):
            gyro = acc = None
        accepted, acc, integrated = self._filter_samples(sample, t_gyro, gyro, acc)
        yaw_rate = accepted.value - self.odometry.bias.value if accepted else 0.0
        dt = (sample.t_dev - self.last_dev) * rate if self.last_dev else 0.0
        throttle = 0.0 if sample.flags & TRIPPED_FLAG else applied.throttle
        self._update_direction(sample, dt, integrated)
        self.encoder.judge(dt, speed, std, sample.ticks - self._ticks, self.speed.rejected,
                           throttle, applied.steering, armed, integrated[0] if integrated else None,
                           yaw_rate if accepted else None)
        self._ticks = sample.ticks
        return accepted, acc

    def _filter_samples(self, sample: Sample, t_gyro: float, gyro: Vector | None,
                        acc: Vector | None,
                        ) -> tuple[AcceptedSample | None, Vector | None, Vector | None]:
        """Replace single wrong samples of the IMU.

        Returns yaw rate, acceleration, and acceleration to be integrated. A sample that was
        withheld and turned out to be motion is added to the next one: both frames last 10 ms, so
        the integral is that of the samples.
        """
        if gyro is None or acc is None:
            for channel in self._filters:
                channel.restart()
            return None, None, None
        rate_filter, x_filter, y_filter = self._filters
        accepted = rate_filter.add(sample.imu_t, gyro[2], t_gyro)
        x = x_filter.add(sample.imu_t, acc[0], sample.imu_t)
        y = y_filter.add(sample.imu_t, acc[1], sample.imu_t)
        # Count replaced samples; report those that repeat within JUMP_REPORT_TIME.
        # A pair of accelerations is no fault: a pulse of the ESC's brake lasts 20 ms. Nor is one
        # sample across the car: at a step of the steering the IMU is ahead of the centre of turn.
        jumps = rate_filter.rejected + rate_filter.pairs + x_filter.rejected
        if jumps > self._jumps:
            several = jumps > self._jumps + 1
            if several or sample.t_dev - self._last_jump < JUMP_REPORT_TIME:
                self._jumped_until = sample.t_dev + JUMP_REPORT_TIME
            self._jumps = jumps
            self._last_jump = sample.t_dev
        self._jumped = jumps + y_filter.rejected
        # Add the change of a sample that was withheld before.
        late = x.withheld_sample[1] - self._along if x.withheld_sample else 0.0
        self._along = x.value
        return accepted, (x.value, y.value, acc[2]), (x.value + late, y.value, acc[2])
