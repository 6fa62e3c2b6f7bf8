"""Estimation of a State from frames: clock fit, wheel speed, odometry with covariance.

Pure: time comes in as arguments, nothing reads a port or a clock.
"""

from dart_hal.core.clock_fit import ClockFit
from dart_hal.estimation.frames import FrameReader, Mounting, Sample, flag_names
from dart_hal.estimation.gyro import GyroBias
from dart_hal.estimation.odometry import MotionStep, Odometry, OdometryNoise
from dart_hal.estimation.pose_filter import FilterEstimate, PoseFilter, PoseVerdict
from dart_hal.estimation.ring import LearntRing, Ring, RingLearner
from dart_hal.estimation.room import ExternalPoseEstimator
from dart_hal.estimation.speed import WheelSpeed

__all__ = [
           "ClockFit",
           "ExternalPoseEstimator",
           "FilterEstimate",
           "FrameReader",
           "GyroBias",
           "LearntRing",
           "MotionStep",
           "Mounting",
           "Odometry",
           "OdometryNoise",
           "PoseFilter",
           "PoseVerdict",
           "Ring",
           "RingLearner",
           "Sample",
           "WheelSpeed",
           "flag_names",
]
