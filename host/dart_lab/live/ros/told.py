"""Messages of a State: the topics of car number N, as in DART's own software."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import nan

from dart_hal.car.export.standard import Planar, count_readings
from dart_hal.core.types import ExternalPose, Mount, Scan, State, Tracking
from dart_hal.estimation.localisation.field import Map, draw_grid
from dart_lab.live.ros.messages import (
    MAP_FRAME,
    RosMessage,
    battery_state,
    clock,
    external_pose,
    laser_scan,
    number,
    numbers,
    occupancy_grid,
    odometry,
    transforms,
)

# By topic (std_msgs/Float32), the method of ``Commands`` that receives its number.
INPUT_TOPICS = {"safety_value": "safety", "throttle_{n}": "throttle", "steering_{n}": "steering"}
# Topics of every car and their types. The last one is advertised, as in DART's software, and
# never sent.
REAL_TOPICS = {"sensors_and_input_{n}": "std_msgs/Float32MultiArray",
               "arduino_data_{n}": "std_msgs/Float32MultiArray",
               "odom_{n}": "nav_msgs/Odometry", "/tf": "tf2_msgs/TFMessage",
               "commands_timestamped_car_{n}": "std_msgs/Float64MultiArray"}
# More topics of a simulated car. For a real car the motion capture publishes them.
SIMULATED_TOPICS = {"vicon/jetracer{n}": "geometry_msgs/PoseWithCovarianceStamped",
                    "vx_{n}": "std_msgs/Float32", "vy_{n}": "std_msgs/Float32",
                    "omega_{n}": "std_msgs/Float32", "/clock": "rosgraph_msgs/Clock"}
# Topics of a car with a lidar, and with a map in which it is localised.
LIDAR_TOPICS = {"scan_{n}": "sensor_msgs/LaserScan", "/tf_static": "tf2_msgs/TFMessage"}
MAP_TOPICS = {"/map": "nav_msgs/OccupancyGrid"}
BATTERY_TOPICS = {"battery_{n}": "sensor_msgs/BatteryState"}
# Topics whose last message every later subscriber receives too.
LATCHED_TOPICS = frozenset({"/tf_static", "/map"})
# Scans whose number of beams is counted before the first is published.
COUNTED_SCANS = 5


def list_output_topics(number: int, simulated: bool, has_lidar: bool = False,
                       has_map: bool = False, has_battery: bool = False) -> dict[str, str]:
    """Return by topic the type of each published message."""
    kinds = {**REAL_TOPICS, **(SIMULATED_TOPICS if simulated else {}),
             **(LIDAR_TOPICS if has_lidar else {}), **(MAP_TOPICS if has_map else {}),
             **(BATTERY_TOPICS if has_battery else {})}
    return {topic.format(n=number): kind for topic, kind in kinds.items()}


def list_input_topics(number: int) -> dict[str, str]:
    """Return by topic the method of ``Commands`` that receives its number."""
    return {topic.format(n=number): method for topic, method in INPUT_TOPICS.items()}


@dataclass(slots=True)
class TopicWriter:
    """Builds the messages of a State.

    l_r [m]: centre of mass to rear axle; mount: of the lidar, None without one; chart: the map in
    which the car is localised, if it is.
    """

    number: int
    l_r: float
    simulated: bool
    mount: Mount | None = None
    chart: Map | None = None
    _start_t: float | None = None
    _newest: ExternalPose | None = None
    _scan: Scan | None = None
    _lengths: list[int] = field(default_factory=list)
    _voltage: float | None = None

    def messages(self, state: State, logged: tuple[float, float, float], epoch: float
                 ) -> Iterator[tuple[str, RosMessage]]:
        """Yield (topic, message) of one State.

        logged: safety, throttle, steering as sent. epoch [s]: zero of the car's clock, since 1970.
        Missing values of the IMU are NaN; a controller that then sends NaN gets neutral. The
        current is not measured: 0, as in DART's recordings; so is a voltage without a sensor.
        ``vy`` is the lateral speed of the centre of mass if the rear axle does not slip:
        v_y = l_r * yaw rate.
        """
        n = self.number
        stamp = epoch + state.t
        if self.simulated:
            yield "/clock", clock(stamp)
        if self._start_t is None:
            self._start_t = state.t
            yield from self._constant_messages(stamp)
        moves = (_or_nan(state.accel_x), _or_nan(state.accel_y), _or_nan(state.yaw_rate),
                 abs(state.speed))
        yield f"sensors_and_input_{n}", numbers((state.t - self._start_t, 0.0,
                                                 state.battery or 0.0, *moves, *logged))
        yield f"arduino_data_{n}", numbers(moves)
        frames = f"odom_{n}", f"base_link_{n}"
        yield f"odom_{n}", odometry(state, stamp, *frames)
        yield "/tf", transforms([(*frames, _planar(state)), *self._room_links(state)], stamp)
        # A reading each 0.2 s; a lost one is not repeated.
        if state.battery is not None and state.battery != self._voltage:
            yield f"battery_{n}", battery_state(state.battery, stamp)
        self._voltage = state.battery
        if self.simulated:
            yield from self._as_simulator(state, epoch)
        # After /tf: a reader finds the transform of each reading.
        if self.mount is not None and state.scan is not None and state.scan is not self._scan:
            self._scan = state.scan
            yield from self._scan_message(state.scan, epoch)

    def _constant_messages(self, stamp: float) -> Iterator[tuple[str, RosMessage]]:
        """Yield the messages that do not change: mounting of the lidar, and the map."""
        if self.mount is not None:
            pose = Planar(self.mount.x, self.mount.y, self.mount.yaw)
            yield "/tf_static", transforms(
                [(f"base_link_{self.number}", f"laser_{self.number}", pose)], stamp)
        if self.chart is not None:
            yield "/map", occupancy_grid(draw_grid(self.chart), stamp, MAP_FRAME)

    def _room_links(self, state: State) -> list[tuple[str, str, Planar]]:
        """Return the odometry's frame in the room; nothing while the car is not localised.

        Together with the odometry it is the localised pose of this State.
        """
        external = state.external
        if (external is None or external.estimate is None
                or external.tracking is Tracking.LOST):
            return []
        pose = external.estimate.pose
        room = Planar(pose.x, pose.y, pose.yaw) @ _planar(state).inverse()
        return [(MAP_FRAME, f"odom_{self.number}", room)]

    def _scan_message(self, scan: Scan, epoch: float) -> Iterator[tuple[str, RosMessage]]:
        """Yield the scan, once its number of readings is known: readers take it as constant."""
        if len(self._lengths) < COUNTED_SCANS:
            self._lengths.append(len(scan))
        else:
            yield (f"scan_{self.number}",
                   laser_scan(scan, count_readings(self._lengths), epoch, f"laser_{self.number}"))

    def _as_simulator(self, state: State, epoch: float
                      ) -> Iterator[tuple[str, RosMessage]]:
        n = self.number
        rate = _or_nan(state.yaw_rate)
        yield f"vx_{n}", number(state.speed)
        yield f"vy_{n}", number(self.l_r * rate)
        yield f"omega_{n}", number(rate)
        newest = state.external.newest if state.external else None
        if newest is not None and newest is not self._newest:
            self._newest = newest
            yield f"vicon/jetracer{n}", external_pose(newest, epoch + newest.arrival)


def _planar(state: State) -> Planar:
    """Return the frame ``base_link`` of a State in that of its odometry."""
    return Planar(state.pose.x, state.pose.y, state.pose.yaw)


def _or_nan(value: float | None) -> float:
    return nan if value is None else value
