"""A follower among other cars: overtakes them, or waits for them.

``control.traffic`` decides, by their messages and by their tracks in the own scans; this car sends
its own plan.
"""

from __future__ import annotations

from math import inf
from typing import Any

from dart_hal.car.member import Member
from dart_hal.control.ending import Phase
from dart_hal.control.follow import Follower
from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.traffic import NearbyCar, PathTraffic, TrafficWait
from dart_hal.core.types import MotionEstimate
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.estimation.other_cars.memory import list_nearby


class Others:
    """The other cars, for a follower: ``update`` before each of its answers, ``publish`` after it.

    member: sends and receives messages; lidar: tracks cars in the scans; None: without. received:
    names of the cars of which a pose was received, or that were tracked.
    """

    def __init__(self, member: Member | None, follower: Follower,
                 lidar: LidarPoses | None = None) -> None:
        self.member = member
        self.lidar = lidar
        self.follower = follower
        self.received: set[str] = set()
        self._traffic: PathTraffic | None = None

    @property
    def traffic(self) -> PathTraffic:
        """Return the traffic rules along the path, which is fixed once the drive has begun."""
        follower = self.follower
        if self._traffic is None:
            self._traffic = PathTraffic(follower.path, follower.rules.lane,
                                        follower.plant.vehicle.body.l_r,
                                        isinstance(follower.tracker, Contouring))
        return self._traffic

    def update(self, motion: MotionEstimate) -> None:
        """Let the traffic rules limit the speed and place obstacles for the follower.

        A car with poses in another frame ends the drive.
        """
        follower = self.follower
        found = self.member.other_poses() if self.member else {}
        tracked = list_nearby(self.lidar.cars, motion.t) if self.lidar else []
        possible = self.lidar.possible if self.lidar else []
        self.received |= found.keys() | {car.name for car in tracked}
        if follower.phase in (Phase.WAITING, Phase.ENDED):
            return
        for name, other in found.items():
            if other.frame != motion.frame:
                follower.stop(f"{name} sends poses in the frame {other.frame!r}, this car in "
                              f"{motion.frame!r}", good=False)
                return
        traffic = self.traffic
        traffic.judge(motion.t, follower.tracker.s, motion.speed, [*tracked, *possible, *(
            NearbyCar(name, o.pose, o.speed, o.age, o.lost) for name, o in found.items())])
        follower.free = traffic.speed
        if isinstance(follower.tracker, Contouring):
            follower.tracker.set_moving_obstacles(traffic.obstacles)

    def publish(self) -> dict[str, float]:
        """Send the plan to the others, and return what is to be recorded.

        room: distance [m] to where the car has to stop, -1 without. wait: index in ``TrafficWait``.
        passing: number of cars that are overtaken.
        """
        tracker = self.follower.tracker
        traffic = self.traffic
        if (self.member and tracker.plan_log and isinstance(tracker, Contouring)
                and tracker.plan is not None):
            plan = tracker.plan
            self.member.tell_plan(plan.states[:, :4], step=STAGE_PERIOD, t=plan.t)
        return {"room": traffic.room if traffic.room < inf else -1.0,
                "wait": float(list(TrafficWait).index(traffic.wait)),
                "passing": float(len(traffic.obstacles))}

    @property
    def summary(self) -> dict[str, Any]:
        """Return the entries of the summary: other cars, waiting times [s]."""
        return {"others": sorted(self.received),
                "waited_s": {str(wait): t for wait, t in self.traffic.seconds.items()
                             if wait is not TrafficWait.FREE and t > 0.0}}
