"""From frames to State: clock fit, wheel speed, odometry with covariance.

Pure: time comes in as arguments, nothing reads a port or a clock.
"""

from dart_hal.core.clock_fit import ClockFit
from dart_hal.estimation.frames import FrameReader, Mounting, Sample, flag_names
from dart_hal.estimation.gyro import GyroBias
from dart_hal.estimation.odometry import Motion, Odometry, OdometryNoise
from dart_hal.estimation.pose_filter import Estimate, PoseFilter, Verdict
from dart_hal.estimation.ring import LearntRing, Ring, RingLearner
from dart_hal.estimation.room import RoomEstimator
from dart_hal.estimation.speed import WheelSpeed

__all__ = ["ClockFit", "Estimate", "FrameReader", "GyroBias", "LearntRing", "Motion", "Mounting",
           "Odometry", "OdometryNoise", "PoseFilter", "Ring", "RingLearner", "RoomEstimator",
           "Sample", "Verdict", "WheelSpeed", "flag_names"]
