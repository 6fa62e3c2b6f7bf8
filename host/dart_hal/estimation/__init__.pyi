# One line for each public name. ``dart_hal.core.lazy`` reads them, and so do type checkers.
from dart_hal.core.clock_fit import ClockFit as ClockFit
from dart_hal.estimation.frames import FrameReader as FrameReader
from dart_hal.estimation.frames import Mounting as Mounting
from dart_hal.estimation.frames import Sample as Sample
from dart_hal.estimation.frames import flag_names as flag_names
from dart_hal.estimation.gyro import GyroBias as GyroBias
from dart_hal.estimation.odometry import MotionStep as MotionStep
from dart_hal.estimation.odometry import Odometry as Odometry
from dart_hal.estimation.odometry import OdometryNoise as OdometryNoise
from dart_hal.estimation.pose_filter import FilterEstimate as FilterEstimate
from dart_hal.estimation.pose_filter import PoseFilter as PoseFilter
from dart_hal.estimation.pose_filter import PoseVerdict as PoseVerdict
from dart_hal.estimation.ring import LearntRing as LearntRing
from dart_hal.estimation.ring import Ring as Ring
from dart_hal.estimation.ring import RingLearner as RingLearner
from dart_hal.estimation.room import ExternalPoseEstimator as ExternalPoseEstimator
from dart_hal.estimation.speed import WheelSpeed as WheelSpeed
