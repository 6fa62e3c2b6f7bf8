"""ROS 2's messages as DDS knows them: https://design.ros2.org/articles/mapping_dds_types.html."""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32


def dds_type(name):
    """What ROS 2 calls a type on the wire."""
    package, kind = name.split("/")
    return f"{package}::msg::dds_::{kind}_"


@dataclass
class Time(IdlStruct, typename=dds_type("builtin_interfaces/Time")):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename=dds_type("std_msgs/Header")):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename=dds_type("geometry_msgs/Vector3")):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename=dds_type("geometry_msgs/Quaternion")):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename=dds_type("geometry_msgs/Pose")):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename=dds_type("geometry_msgs/PoseWithCovariance")):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename=dds_type("geometry_msgs/Twist")):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename=dds_type("geometry_msgs/TwistWithCovariance")):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename=dds_type("nav_msgs/Odometry")):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class Imu(IdlStruct, typename=dds_type("sensor_msgs/Imu")):
    header: Header
    orientation: Quaternion
    orientation_covariance: array[float64, 9]
    angular_velocity: Vector3
    angular_velocity_covariance: array[float64, 9]
    linear_acceleration: Vector3
    linear_acceleration_covariance: array[float64, 9]


@dataclass
class AckermannDrive(IdlStruct, typename=dds_type("ackermann_msgs/AckermannDrive")):
    steering_angle: float32
    steering_angle_velocity: float32
    speed: float32
    acceleration: float32
    jerk: float32


@dataclass
class AckermannDriveStamped(IdlStruct, typename=dds_type("ackermann_msgs/AckermannDriveStamped")):
    header: Header
    drive: AckermannDrive


@dataclass
class Float32(IdlStruct, typename=dds_type("std_msgs/Float32")):
    data: float32


@dataclass
class Dimension(IdlStruct, typename=dds_type("std_msgs/MultiArrayDimension")):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename=dds_type("std_msgs/MultiArrayLayout")):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Float32MultiArray(IdlStruct, typename=dds_type("std_msgs/Float32MultiArray")):
    layout: Layout
    data: sequence[float32]


TOPICS = {"rt/odom": Odometry, "rt/imu": Imu, "rt/drive": AckermannDriveStamped,
          "rt/sensors_and_input_1": Float32MultiArray, "rt/odom_1": Odometry,
          "rt/arduino_data_1": Float32MultiArray}
"""Type and topic of a message; ROS 2 puts rt/ before a topic."""
HEARD = "rt/throttle_1"
