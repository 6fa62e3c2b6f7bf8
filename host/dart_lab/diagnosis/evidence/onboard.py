"""Residuals of recordings without motion capture: a model against the car's own sensors.

From a state that the sensors give, the model drives on with the logged commands
and says what encoder, gyro and accelerometer should read at each message that
follows. The state is known only as well as the sensors are; that error is alike
in all read-outs of a window, where the whitening finds it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import Vehicle

from ..policy import MIN_READINGS, USUAL, EvidencePolicy
from .onboard_drive import (
    ACCEL_READ_OUTS,
    ENCODER_SPAN,
    MESSAGES_AHEAD,
    START_SPACING,
    Session,
    counted,
)
from .onboard_windows import Actuated, predicted, pulled, reaches, steered
from .readings import SENSORS, at_rest, resting
from .residuals import Evidence, Residuals, pulled_by, steered_by
from .space import EXACT, Timing
from .standing import spread

MOTION = ("encoder", "gyro")
UNKNOWN = (
    "position, heading in the room and speed sideways: no sensor on the car measures them",
    "what motion capture does to a pose, for there is none",
    "the direction of a slope in the room: only that to the heading at the start of a recording",
    "the scale of speed by itself: only through what motor, steering and accelerometer say of it")
"""What no recording without motion capture can tell."""


class OnboardEvidence(Evidence):
    """Sessions and how the residuals of any model on them are computed.

    As ``residuals.Evidence``, but motion is (n, MESSAGES_AHEAD * 2): encoder and gyro at
    each message of a window, and sensors (m, 4) are: accelerometer while driving
    and, in units of its noise then, at rest; gyro at rest; encoder never.
    """

    exact = False  # a window starts from what sensors guess of its state
    drives: tuple[Session, ...]

    def __init__(self, drives: Sequence[Session], l_r: float) -> None:
        super().__init__(drives, l_r, MESSAGES_AHEAD * ENCODER_SPAN / START_SPACING)

    @property
    def late(self) -> float:
        """Everything is on the clock of the messages."""
        return 0.0

    @property
    def mounting(self) -> tuple[str, ...]:
        """How the IMU sits: no car is built truer than 3 degrees and a centimetre, and with nothing
        but this IMU to go by the search asks more of a name than to be visible."""
        return ("imu_yaw", "imu_pitch", "imu_roll", "imu_lever_arm", "imu_offset_y", "gyro_bias",
                "gyro_scale")

    @property
    def columns(self) -> dict[str, int]:
        """As ``residuals.Evidence.columns``."""
        end = (MESSAGES_AHEAD - 1) * len(MOTION)
        return {**{name: end + i for i, name in enumerate(MOTION)}, "accel_x": -2, "accel_y": -1}

    def columns_at(self, horizon: float) -> dict[str, int]:
        """As ``residuals.Evidence.columns_at``: the speed is the wheel's, turning the gyro's."""
        read = round(horizon / ENCODER_SPAN) - 1
        names = ("vx", "yaw_rate")
        return {} if read >= MESSAGES_AHEAD else {
            n: read * len(MOTION) + i for i, n in enumerate(names)}

    def channel(self, column: int) -> str:
        """Name of a column of the motion, or of -1 - column of the sensors."""
        return MOTION[column % len(MOTION)] if column >= 0 else SENSORS[-1 - column]

    @property
    def read_out(self) -> tuple[tuple[str, ...], slice, slice]:
        """(names, columns of the motion) half a window ahead; columns of the sensors beside them.

        Encoder and gyro are in the motion here, so of the sensors the accelerometer is left.
        """
        half = (MESSAGES_AHEAD // 2 - 1) * len(MOTION)
        return MOTION, slice(half, half + len(MOTION)), slice(2, 4)

    def _begins(self) -> Sequence[FloatArray]:
        return [d.begin for d in self.drives]

    def residuals(self, p: Vehicle, timing: Timing = EXACT) -> Residuals:
        """Of the model p with its effects, as ``Evidence.residuals``."""
        self.tell()
        p = timing.advanced(p)
        # no reading has an age of its own here: encoder and gyro set the state that is predicted on
        return self._again((p, timing.late, timing.spread), lambda: self._residuals(p, timing))

    def _residuals(self, p: Vehicle, timing: Timing) -> Residuals:
        """Of p with its delays counted from the messages of its commands."""
        q = settled(p)
        throttle = self._once(("throttle", *pulled_by(p, q), timing.late, timing.spread),
                              lambda: [pulled(d, q, timing) for d in self.drives])
        angle = self._once(("steering", *steered_by(p, q), timing.late, timing.spread),
                           lambda: self._steered(q, timing))
        still = self._once("resting", lambda: [resting(d) for d in self.drives])
        rest = [at_rest(d, p, rest=r) for d, r in zip(self.drives, still, strict=True)]
        parts = [(np.empty((0, MESSAGES_AHEAD * len(MOTION))), np.empty((0, 4))),
                 *(_of(drive, p, q, *inputs)
                   for drive, *inputs in zip(self.drives, rest, throttle, angle, strict=True))]
        motion, sensors = (np.concatenate(part) for part in zip(*parts, strict=True))
        for k in range(4):  # what says nothing of any model still needs a size
            if not np.isfinite(sensors[:, k]).any():
                sensors[:, k] = spread(len(sensors))
        return Residuals(motion, sensors)

    def _steered(self, q: Vehicle, timing: Timing) -> list[Actuated]:
        """No trim, play or map changes where the servo is, which takes longest."""
        servo = self._once(("servo", q.delay.steering_s, q.delay.steering_lag_s, timing.spread,
                            *(a for a in q.effects if "steering" in a.effect.signals)),
                           lambda: [reaches(d, q, "steering", timing) for d in self.drives])
        return [steered(d, q, timing, one) for d, one in zip(self.drives, servo, strict=True)]


def unseen() -> tuple[str, ...]:
    """Effects of the catalogue that change nothing an on-board sensor reads."""
    return tuple(name for name, e in catalogue().items()
                 if set(e.signals) == {"pose"} and e.force is None and e.vehicle is None)


def limits(evidence: OnboardEvidence, policy: EvidencePolicy = USUAL.evidence
           ) -> tuple[str, ...]:
    """What these recordings cannot tell, in words: UNKNOWN, and what they in particular lack."""
    windows, driving, rest = counted(evidence.drives)
    accel = np.concatenate([d.read[:, 2] for d in evidence.drives] or [np.empty(0)])
    own = []
    if not windows:
        own.append("how the car moves: there is no second of driving with encoder and gyro")
    if rest < MIN_READINGS:
        own.append("biases and tilts of gyro and accelerometer but weakly: the car is never seen "
                   "standing still for 2 s")
    if driving + rest and not np.isfinite(accel).any():
        own.append("accelerations: there is no accelerometer")
    return (*UNKNOWN, *own)


def _of(drive: Session, p: Vehicle, q: Vehicle, rest: FloatArray, throttle: Actuated,
        angle: Actuated) -> tuple[FloatArray, FloatArray]:
    if not len(drive.begin):
        return np.empty((0, MESSAGES_AHEAD * len(MOTION))), rest
    said = predicted(drive, p, q, throttle, angle)
    motion = (said[:2] - drive.said).transpose(2, 1, 0).reshape(len(drive.begin), -1)
    accel = said[2:, ACCEL_READ_OUTS[0]:ACCEL_READ_OUTS[1]].transpose(2, 1, 0).reshape(-1, 2)
    driven = np.full((len(accel), 4), np.nan)
    driven[:, 2:] = accel - drive.read[:len(accel), 2:]
    return motion, np.concatenate([driven, rest])
