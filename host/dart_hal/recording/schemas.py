"""Definitions of the messages in a recording, embedded in each file.

``dart_msgs`` are ours, the others ROS 2's own.
"""

from __future__ import annotations

_TIME_TYPE = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
_HEADER_TYPE = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n")
_VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
_QUATERNION = ("geometry_msgs/Quaternion",
               "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n")

_LAYOUT = (("std_msgs/MultiArrayLayout",
            "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"),
           ("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n"))
_POSE_TYPES = (
    ("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"),
    ("geometry_msgs/Pose",
     "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"), _QUATERNION)

_PARTS: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "std_msgs/msg/UInt8MultiArray": (
        "std_msgs/MultiArrayLayout layout\nuint8[] data\n", _LAYOUT),
    "std_msgs/msg/Float64MultiArray": (
        "std_msgs/MultiArrayLayout layout\nfloat64[] data\n", _LAYOUT),
    "std_msgs/msg/Float64": ("float64 data\n", ()),
    "dart_msgs/msg/Command": (
        "float64 steering  # rad, left positive\nfloat64 throttle  # -1..1\nstring source\n", ()),
    "dart_msgs/msg/Applied": (
        "float64 steering  # rad, left positive\nfloat64 throttle  # -1..1\n"
        "float64 steering_us\nfloat64 throttle_us\nstring[] limited  # why not what was asked\n",
        ()),
    "dart_msgs/msg/LidarScan": (
        "float64 start  # s, first beam, on the car's clock\nfloat64 std  # s, one sigma of it\n"
        "float64 rate  # revolutions per second\nfloat32[] after  # s behind start\n"
        "float32[] angle  # rad, as the unit counts: an upright one clockwise\n"
        "float32[] distance  # m, NaN where nothing came back\n", ()),
    "nav_msgs/msg/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
        (_HEADER_TYPE, _TIME_TYPE, *_POSE_TYPES,
         ("geometry_msgs/TwistWithCovariance",
          "geometry_msgs/Twist twist\nfloat64[36] covariance\n"),
         ("geometry_msgs/Twist",
          "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"), _VECTOR)),
    "sensor_msgs/msg/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance\n",
        (_HEADER_TYPE, _TIME_TYPE, _QUATERNION, _VECTOR)),
    "sensor_msgs/msg/CompressedImage": (
        "std_msgs/Header header\nstring format\nuint8[] data\n", (_HEADER_TYPE, _TIME_TYPE)),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
        (_HEADER_TYPE, _TIME_TYPE, *_POSE_TYPES)),
    "ackermann_msgs/msg/AckermannDriveStamped": (
        "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
        (_HEADER_TYPE, _TIME_TYPE,
         ("ackermann_msgs/AckermannDrive",
          "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
          "float32 acceleration\nfloat32 jerk\n"))),
}

_RULE = "=" * 80


def definition(name: str) -> bytes:
    """Return the text of a message and of its parts, in the ``ros2msg`` form of rosbag2."""
    text, parts = _PARTS[name]
    return (text + "".join(f"{_RULE}\nMSG: {n}\n{t}" for n, t in parts)).encode()
