"""Residuals of recordings without motion capture: a model against the car's own sensors.

The model starts from a state that the sensors measured, moves with the logged commands, and
predicts what encoder, gyro and accelerometer read at each following message. The error of the start
state is common to all read-outs of a window, so the whitening takes account of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Vehicle

from .onboard_drive import (
    ACCEL_READ_OUTS,
    ENCODER_MEAN_S,
    MESSAGES_AHEAD,
    START_SPACING,
    OnboardStretch,
    count_windows,
)
from .onboard_windows import (
    ActuatorOutput,
    WindowMotion,
    actuator_means,
    predict_motion,
    predict_sensors,
    steering_output,
    throttle_output,
    window_times,
)
from .policy import MIN_READINGS
from .readings import SENSORS, rest_motion, rest_residuals
from .residuals import (
    Evidence,
    Residuals,
    affects_readings_only,
    steering_key,
    throttle_key,
)
from .space import NO_DELAY, MessageTiming
from .standing import uniform_sequence

ONBOARD_MOTION = ("encoder", "gyro")
# What no recording without motion capture can determine.
NOT_OBSERVABLE = (
    "position, heading in the room and speed sideways: no sensor on the car measures them",
    "what motion capture does to a pose, for there is none",
    "the direction of a slope in the room: only that to the heading at the start of a recording",
    "the scale of speed by itself: only through motor, steering and accelerometer")


class OnboardEvidence(Evidence):
    """Stretches, and the residuals of any model on them.

    As ``residuals.Evidence``, but motion is (n, MESSAGES_AHEAD * 2): encoder and gyro at each
    message of a window. sensors (m, 4) are: accelerometer while driving; at rest gyro and, in
    units of its noise while driving, accelerometer; encoder never.
    """

    has_mocap = False
    drives: tuple[OnboardStretch, ...]

    def __init__(self, drives: Sequence[OnboardStretch], l_r: float) -> None:
        super().__init__(drives, l_r, MESSAGES_AHEAD * ENCODER_MEAN_S / START_SPACING)

    @property
    def message_age(self) -> float:
        """0: everything is on the clock of the messages."""
        return 0.0

    @property
    def mounting(self) -> tuple[str, ...]:
        """Effects of how the IMU is mounted.

        No car is built more exactly than 3 degrees and a centimetre, so they are visible in every
        recording. What they explain is therefore no structure that is left, and one is a cause only
        if it passes all gates.
        """
        return ("imu_yaw", "imu_pitch", "imu_roll", "imu_lever_arm", "imu_offset_y", "gyro_bias",
                "gyro_scale")

    @property
    def columns(self) -> dict[str, int]:
        """As ``residuals.Evidence.columns``."""
        end = (MESSAGES_AHEAD - 1) * len(ONBOARD_MOTION)
        return {**{name: end + i for i, name in enumerate(ONBOARD_MOTION)},
                "accel_x": -2, "accel_y": -1}

    def columns_at(self, horizon: float) -> dict[str, int]:
        """As ``residuals.Evidence.columns_at``: speed of the encoder, yaw rate of the gyro."""
        read = round(horizon / ENCODER_MEAN_S) - 1
        names = ("vx", "yaw_rate")
        return {} if read >= MESSAGES_AHEAD else {
            n: read * len(ONBOARD_MOTION) + i for i, n in enumerate(names)}

    def channel(self, column: int) -> str:
        """Name of a column of the motion, or of -1 - column of the sensors."""
        return ONBOARD_MOTION[column % len(ONBOARD_MOTION)] if column >= 0 else SENSORS[-1 - column]

    @property
    def read_out(self) -> tuple[tuple[str, ...], slice, slice]:
        """(names, columns of the motion half a window ahead, columns of the sensors).

        Encoder and gyro are in the motion here, so the sensors are the accelerometer alone.
        """
        half = (MESSAGES_AHEAD // 2 - 1) * len(ONBOARD_MOTION)
        return ONBOARD_MOTION, slice(half, half + len(ONBOARD_MOTION)), slice(2, 4)

    def _window_starts(self) -> Sequence[FloatArray]:
        return [d.window_starts for d in self.drives]

    def residuals(self, p: Vehicle, timing: MessageTiming = NO_DELAY) -> Residuals:
        """Compute the residuals of p with its effects, as ``Evidence.residuals``."""
        self.report_evaluation()
        p = timing.shift_delays(p)
        # gyro_age is not used: encoder and gyro determine the state from which is predicted
        return self._cached_residuals((p, timing.message_age, timing.age_spread),
                                      lambda: self._residuals(p, timing))

    def _residuals(self, p: Vehicle, timing: MessageTiming) -> Residuals:
        """Compute the residuals of p, whose delays count from the messages of its commands."""
        q = apply_parameter_effects(p)
        throttle = self._cached_part(
            ("throttle", *throttle_key(p, q), timing.message_age, timing.age_spread),
            lambda: [throttle_output(d, q, timing) for d in self.drives])
        angle = self._cached_part(
            ("steering", *steering_key(p, q), timing.message_age, timing.age_spread),
            lambda: self._steering_outputs(q, timing))
        still = self._cached_part("resting", lambda: [rest_motion(d) for d in self.drives])
        rest = [rest_residuals(d, p, rest=r) for d, r in zip(self.drives, still, strict=True)]
        times = self._cached_part("times", lambda: [window_times(d) for d in self.drives])
        moving = _drop_accelerometer_effects(p)
        motions = self._cached_part(
            ("motion", moving, timing.message_age, timing.age_spread),
            lambda: [predict_motion(d, moving, q, *inputs) if len(d.window_starts) else None
                     for d, *inputs in zip(self.drives, times, throttle, angle, strict=True)])
        parts = [(np.empty((0, MESSAGES_AHEAD * len(ONBOARD_MOTION))), np.empty((0, 4))),
                 *(_stretch_residuals(drive, p, *inputs) for drive, *inputs in zip(
                     self.drives, rest, times, motions, throttle, strict=True))]
        motion, sensors = (np.concatenate(part) for part in zip(*parts, strict=True))
        for k in range(4):  # a channel without readings still needs a scale
            if not np.isfinite(sensors[:, k]).any():
                sensors[:, k] = uniform_sequence(len(sensors))
        return Residuals(motion, sensors)

    def _steering_outputs(self, q: Vehicle, timing: MessageTiming) -> list[ActuatorOutput]:
        """Return the road-wheel angles of all stretches.

        The servo takes longest to compute, and no trim, play or map changes it.
        """
        servo = self._cached_part(
            ("servo", q.delay.steering_s, q.delay.steering_lag_s, timing.age_spread,
             *(a for a in q.effects if "steering" in a.effect.signals)),
            lambda: [actuator_means(d, q, "steering", timing) for d in self.drives])
        return [steering_output(d, q, timing, one)
                for d, one in zip(self.drives, servo, strict=True)]


def list_limits(evidence: OnboardEvidence) -> tuple[str, ...]:
    """List in words what these recordings cannot determine: NOT_OBSERVABLE, and what they lack."""
    windows, driving, rest = count_windows(evidence.drives)
    accel = np.concatenate([d.readings[:, 2] for d in evidence.drives] or [np.empty(0)])
    own = []
    if not windows:
        own.append("how the car moves: there is no second of driving with encoder and gyro")
    if rest < MIN_READINGS:
        own.append("biases and tilts of gyro and accelerometer only weakly: the car is never at "
                   "rest for 2 s")
    if driving + rest and not np.isfinite(accel).any():
        own.append("accelerations: there is no accelerometer")
    return (*NOT_OBSERVABLE, *own)


def _drop_accelerometer_effects(p: Vehicle) -> Vehicle:
    """Return the vehicle without effects that only the accelerometer shows."""
    return replace(p, effects=tuple(a for a in p.effects if not (
        affects_readings_only(a.effect) and set(a.effect.signals) == {"accel"})))


def _stretch_residuals(drive: OnboardStretch, p: Vehicle, rest: FloatArray, t: FloatArray,
                       motion: WindowMotion | None, throttle: ActuatorOutput
                       ) -> tuple[FloatArray, FloatArray]:
    """Compute motion and sensor residuals of one stretch; rest: those of messages at rest.

    motion: None for a stretch without windows.
    """
    if motion is None:
        return np.empty((0, MESSAGES_AHEAD * len(ONBOARD_MOTION))), rest
    predicted = predict_sensors(drive, p, t, motion, throttle)
    errors = (predicted[:2] - drive.window_readings).transpose(2, 1, 0)
    accel = predicted[2:, ACCEL_READ_OUTS[0]:ACCEL_READ_OUTS[1]].transpose(2, 1, 0).reshape(-1, 2)
    driving = np.full((len(accel), 4), np.nan)
    driving[:, 2:] = accel - drive.readings[:len(accel), 2:]
    return (errors.reshape(len(drive.window_starts), -1), np.concatenate([driving, rest]))
