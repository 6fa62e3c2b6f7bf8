"""A recording with motion capture, prepared for the diagnosis.

The error of a model shows within tens of milliseconds of a command, so two things differ from an
open-loop evaluation:

1. Velocities come from seven mocap samples instead of fifteen. Predicted motion is averaged in
   the same way.
2. Commands change when the message that carried them was sent, not at the next mocap row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import (
    RUN,
    Grid,
    Messages,
    Recording,
    Reference,
    grid,
    savgol_derivative,
)
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.commands import message_time, zero_order_hold
from dart_lab.identification.prediction.rollout import states
from dart_lab.identification.prediction.sensors import marker_pose
from dart_lab.identification.prediction.windows import find_windows, is_forward

from .policy import USUAL_EVIDENCE, EvidencePolicy
from .standing import add_dither, driving_noise_scale, find_rest_messages

DERIVATIVE_POINTS = 7  # samples of a derivative; 30 ms to each side
HALF_POINTS = DERIVATIVE_POINTS // 2
EVALUATION_POINTS = 15  # samples of a derivative in an evaluation
READ_OUTS = (10, 25, 50, 75, 100)  # samples after the start at which a prediction is compared
START_SPACING = 50  # samples from start to start: each sample is predicted twice
WINDOW_SPACING = 100  # samples from start to start without overlap
CLEAN_SAMPLES = READ_OUTS[-1] + 8  # samples from a start without a bad one
YAW_RATE_REACH = 5  # samples to each side over which the yaw rate must be straight
SPEED_REACH = 7  # samples to each side over which the speed must be straight
MESSAGE_OFFSETS = (-6, -3, 0, 3)  # samples; a message may be older than its stamp
ENCODER_MEAN_S = 0.1  # s over which a reading is the mean; messages of runs are more frequent
BAD_SPEED = 1e9  # m/s; makes a sample without mocap count as motion
# A message needs good mocap over the 0.1 s of its encoder reading and its age.
MOCAP_BEFORE = 25  # samples
MOCAP_AFTER = 10  # samples
MOCAP_MARGIN = 30  # samples at the ends of a recording without messages


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """One recording with motion capture, prepared for a base model.

    grid: motion of the centre of mass from DERIVATIVE_POINTS samples, commands at message time.
    starts (n,): first sample of each window. message_samples (m,): time of each usable message
    [samples]. readings (m, 4): encoder [m/s], gyro [rad/s], acceleration a_x, a_y [m/s2], NaN
    without the sensor. at_rest (m,): whether the car is at rest. noise_scale (2,): noise of the
    accelerometer while driving over that at rest.
    """

    recording: Recording
    grid: Grid
    starts: IntArray
    message_samples: FloatArray
    readings: FloatArray
    at_rest: BoolArray
    noise_scale: FloatArray

    @property
    def message_times(self) -> FloatArray | None:
        """Time of each message (m,) [s]; None for a schema without times of commands."""
        return None if self.recording.schema == "C" else message_time(self.recording.messages)

    def command_at(self, channel: str, times: FloatArray) -> FloatArray:
        """Return the series of a command whose values start at times (m,) [s].

        Shifting the series of samples instead would blur a step over two samples by an amount that
        depends on the delay, and make the loss rough along it.
        """
        return zero_order_hold(times, getattr(self.recording.messages, channel), len(self.grid))

    def without_mocap_effects(self, p: Vehicle, l_r: float) -> Grid:
        """Return the measured motion without the pose effects of p.

        The effects are small, so their change of the measured pose is subtracted once.
        """
        g = self.grid
        if not signals(p, "pose"):
            return g
        marker = _marker_pose(g, l_r)
        with_effects = marker_pose(p, g.t, states(g), marker)
        x, y, yaw = (2.0 * a - b for a, b in zip(marker, with_effects, strict=True))
        return _differentiate_poses(g, x, y, yaw, l_r)


def prepare_drive(recording: Recording, l_r: float, reference: Reference | None = None,
                  spacing: int = START_SPACING, policy: EvidencePolicy = USUAL_EVIDENCE
                  ) -> RecordedDrive:
    """Prepare a recording; spacing: samples from start to start.

    1. Differentiate the poses, and hold each command from its message on.
    2. Select messages with good mocap in which the wheels turn fast enough for the encoder.
    3. Judge gyro and accelerometer only where yaw rate and speed are straight around a message:
       elsewhere the derivative of motion capture is less accurate than the sensor.
    4. Add the messages at rest, with dither.

    Errors: RecordingError as for ``grid``.
    """
    coarse = grid(recording, reference, l_r)
    g = _differentiate_poses(coarse, *_marker_pose(coarse, l_r), l_r)
    messages = recording.messages
    starts = _find_starts(g, spacing, policy.max_yaw_rate_bend)
    if recording.schema == "C":
        return RecordedDrive(recording, g, starts, np.empty(0), np.empty((0, 4)),
                             np.empty(0, dtype=np.bool_), np.ones(2))
    sent = message_time(messages)
    g = replace(g, throttle=zero_order_hold(sent, messages.throttle, len(g)),
                steering=zero_order_hold(sent, messages.steering, len(g)))
    samples = sent / SAMPLE
    good = _has_good_mocap(g, samples) & ~(messages.speed < policy.min_encoder_speed)
    if recording.schema == RUN:
        good &= _has_new_mean(messages.t)
    gyro_good = _is_straight(g.omega, samples, YAW_RATE_REACH, policy.max_yaw_rate_bend)
    accel_good = _is_straight(g.omega, samples, YAW_RATE_REACH, policy.max_accel_bend)
    speed_straight = _is_straight(g.v_x, samples, SPEED_REACH, policy.max_speed_bend)
    readings = stack_readings(messages)
    readings[~gyro_good, 1] = np.nan
    readings[~(accel_good & speed_straight), 2] = np.nan
    readings[~accel_good, 3] = np.nan
    rest = _find_rest(g, messages, samples, policy)
    good[rest] = False
    driving = np.flatnonzero(good & accel_good & speed_straight)
    return RecordedDrive(recording, g, starts,
                         np.concatenate([samples[good], samples[rest]]),
                         np.concatenate([readings[good],
                                         add_dither(stack_readings(messages), rest)]),
                         np.repeat([False, True], [good.sum(), len(rest)]),
                         driving_noise_scale(messages, driving, rest, policy))


def stack_readings(m: Messages) -> FloatArray:
    """Return the sensor readings of each message (m, 4), as in ``RecordedDrive``."""
    return np.stack([m.speed, m.yaw_rate, m.accel_x, m.accel_y], axis=1)


def _find_rest(g: Grid, m: Messages, samples: FloatArray, policy: EvidencePolicy) -> IntArray:
    """Find messages of a car at rest by motion capture."""
    index = np.arange(len(g))
    speed = np.hypot(g.v_x, g.v_y) + BAD_SPEED * g.bad
    at_rest = np.interp(samples, index, speed) < policy.max_rest_speed
    return find_rest_messages(at_rest, m, np.arange(len(samples)), policy.max_rest_yaw_rate)


def _marker_pose(g: Grid, l_r: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and yaw of the marker."""
    return (*g.reference.marker(l_r, g.x, g.y, g.yaw), g.yaw)


def remove_mocap_effects(g: Grid, p: Vehicle, l_r: float) -> Grid:
    """Remove the pose effects of p from a grid of any smoothing, to first order.

    The change of the motion, smoothed as in an evaluation, is added to the grid.
    """
    marker = _marker_pose(g, l_r)
    with_effects = marker_pose(p, g.t, states(g), marker)
    freed = [2.0 * a - b for a, b in zip(marker, with_effects, strict=True)]
    original = _differentiate_poses(g, *marker, l_r, EVALUATION_POINTS)
    corrected = _differentiate_poses(g, freed[0], freed[1], freed[2], l_r, EVALUATION_POINTS)
    changed = {name: getattr(g, name) + getattr(corrected, name) - getattr(original, name)
               for name in ("x", "y", "yaw", "v_x", "v_y", "omega")}
    return replace(g, **changed)


def _differentiate_poses(g: Grid, x: FloatArray, y: FloatArray, yaw: FloatArray, l_r: float,
                         points: int = DERIVATIVE_POINTS) -> Grid:
    """Return the grid with the motion of the centre of mass from poses of the marker."""
    dx, dy, omega = (savgol_derivative(v, points) for v in (x, y, yaw))
    x, y, v_x, v_y = g.reference.centre(l_r, (x, y, yaw), (dx, dy, omega))
    return replace(g, x=x, y=y, yaw=yaw, v_x=v_x, v_y=v_y, omega=omega)


def _find_starts(g: Grid, spacing: int, bend: float) -> IntArray:
    """Find first samples of windows where the yaw rate is straight and the ESC does not brake."""
    starts = find_windows(g, spacing, CLEAN_SAMPLES, CLEAN_SAMPLES).start
    starts = starts[is_forward(g, starts, CLEAN_SAMPLES)]
    return starts[_second_difference(g.omega, starts, YAW_RATE_REACH) < bend]


def _is_straight(x: FloatArray, samples: FloatArray, reach: int, bend: float) -> BoolArray:
    """Return for messages (m,) whether the series is straight at all of MESSAGE_OFFSETS."""
    index = np.rint(samples).astype(np.int64)[:, None] + np.array(MESSAGE_OFFSETS)
    index = np.clip(index, reach, len(x) - 1 - reach)
    return np.asarray((_second_difference(x, index, reach) < bend).all(axis=1))


def _second_difference(x: FloatArray, index: IntArray, reach: int) -> FloatArray:
    """Return |x(i + reach) - 2 x(i) + x(i - reach)|, 0 for a straight line."""
    return np.asarray(np.abs(x[index + reach] - 2.0 * x[index] + x[index - reach]))


def _has_new_mean(t: FloatArray) -> BoolArray:
    """Return which messages (m,) are the first in 0.1 s, the time of an encoder's mean."""
    return np.concatenate([[True], np.diff(np.floor(t / ENCODER_MEAN_S)) > 0])


def _has_good_mocap(g: Grid, samples: FloatArray) -> BoolArray:
    """Return which messages have good mocap over the encoder's mean and the age of a message."""
    n_bad = np.concatenate([[0], np.cumsum(g.bad)])
    index = np.rint(samples).astype(np.int64)
    inside = (index > MOCAP_MARGIN) & (index < len(g) - MOCAP_MARGIN)
    index = np.clip(index, MOCAP_MARGIN, max(len(g) - MOCAP_MARGIN, MOCAP_MARGIN))
    return np.asarray(inside & (n_bad[index + MOCAP_AFTER] == n_bad[index - MOCAP_BEFORE]))
