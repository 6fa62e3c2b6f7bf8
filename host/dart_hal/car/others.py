"""A follower among the other cars of its room: passes them, or waits for them.

What they tell is judged by ``control.traffic``; the own plan is told to them.
"""

from __future__ import annotations

from math import inf
from typing import Any

from dart_hal.car.member import Member
from dart_hal.control.ending import Phase
from dart_hal.control.follow import Follower
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.traffic import Neighbour, Traffic, Wait
from dart_hal.core.types import MotionEstimate


class Others:
    """``look`` before each answer of the follower, ``tell`` behind it. heard: names of others."""

    def __init__(self, member: Member, follower: Follower) -> None:
        self.member, self.follower = member, follower
        self.heard: set[str] = set()
        self._traffic: Traffic | None = None

    @property
    def traffic(self) -> Traffic:
        """Made with the path as it lies once the drive has begun."""
        follower = self.follower
        if self._traffic is None:
            self._traffic = Traffic(follower.path, follower.rules.lane,
                                    follower.plant.vehicle.body.l_r,
                                    isinstance(follower.tracker, Contouring))
        return self._traffic

    def look(self, motion: MotionEstimate) -> None:
        """Before each answer. A car that tells its place in another frame ends the drive."""
        follower, found = self.follower, self.member.other_poses()
        self.heard |= found.keys()
        if follower.phase in (Phase.WAITING, Phase.ENDED):
            return
        for name, other in found.items():
            if other.frame != motion.frame:
                follower.stop(f"{name} tells its place in the frame {other.frame!r}, this car in "
                              f"{motion.frame!r}", good=False)
                return
        traffic = self.traffic
        traffic.judge(motion.t, follower.tracker.s, motion.speed, [
            Neighbour(name, o.pose, o.speed, o.age, o.lost) for name, o in found.items()])
        follower.free = traffic.speed
        if isinstance(follower.tracker, Contouring):
            follower.tracker.pass_by(traffic.obstacles)

    def tell(self) -> dict[str, float]:
        """The plan for the others, and what is to be recorded: room [m] to where it has to stand,
        -1: there is none; the wait by its place in ``Wait``; cars that are passed."""
        tracker, traffic = self.follower.tracker, self.traffic
        if tracker.told and isinstance(tracker, Contouring) and tracker.plan is not None:
            plan = tracker.plan
            self.member.tell_plan(plan.states[:, :4], step=STAGE, t=plan.t)
        return {"room": traffic.room if traffic.room < inf else -1.0,
                "wait": float(list(Wait).index(traffic.wait)),
                "passing": float(len(traffic.obstacles))}

    @property
    def told(self) -> dict[str, Any]:
        """For the summary."""
        return {"others": sorted(self.heard),
                "waited_s": {str(wait): t for wait, t in self.traffic.seconds.items()
                             if wait is not Wait.FREE and t > 0.0}}
