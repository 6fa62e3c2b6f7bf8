"""A rospy node that drives car 1 by upstream's topics and writes what it saw.

    python driver_node.py own|upstream SEEN.json

own: it sends steering and throttle itself. upstream: DART's own nodes do, of the speed and the
angle that it requests from them. It needs nothing of this project.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Float32, Float32MultiArray
from tf2_msgs.msg import TFMessage

DRIVE_SPEED = 1.0
DRIVE_ANGLE = 0.2
DRIVE_S = 7.0
SETTLE_S = 4.0
SILENCE_S = 1.5
"""s of a drive, of it until its speed is looked at, and of silence."""


class Driver:
    def __init__(self, own):
        self.t_go = 0.0
        self.own = own
        self.samples = []
        self.counts = {}
        self.newest = {}
        for topic, kind in (("odom_1", Odometry), ("/tf", TFMessage), ("vx_1", Float32),
                            ("arduino_data_1", Float32MultiArray),
                            ("vicon/jetracer1", PoseWithCovarianceStamped)):
            rospy.Subscriber(topic, kind, self.count, topic)
        rospy.Subscriber("sensors_and_input_1", Float32MultiArray, self.sensors)
        names = ["safety_value", *(["steering_1", "throttle_1"] if own
                                   else ["steering_angle_1", "v_ref_1"])]
        self.out = {name: rospy.Publisher(name, Float32, queue_size=1) for name in names}

    def count(self, message, topic):
        self.counts.setdefault(topic, []).append(time.time())
        self.newest[topic] = message

    def sensors(self, message):
        self.samples.append((time.time(), *message.data))

    def until(self, seconds, each):
        """``each()`` at 10 Hz."""
        end = time.time() + seconds
        while time.time() < end and not rospy.is_shutdown():
            each()
            time.sleep(0.1)

    def control(self, reference=DRIVE_SPEED):
        if self.own:
            speed = self.samples[-1][7]
            self.out["steering_1"].publish(0.4)
            self.out["throttle_1"].publish(0.22 + 0.1 * (reference - speed))
        else:
            self.out["steering_angle_1"].publish(DRIVE_ANGLE)
            self.out["v_ref_1"].publish(reference)

    def go(self, reference=DRIVE_SPEED):
        self.out["safety_value"].publish(1.0)
        self.t_go = time.time()
        self.control(reference)

    def send_neutral(self):
        self.out["safety_value"].publish(0.0)

    def run(self):
        print("ready", flush=True)
        while not self.samples and not rospy.is_shutdown():
            time.sleep(0.1)
        while self.samples[-1][8] != 1.0:  # it arms; a go of before does not count
            self.until(0.4, self.send_neutral)
            self.until(0.6, lambda: self.out["safety_value"].publish(1.0)
                       if not self.own else self.go(0.0))
        began = time.time()
        self.go()
        self.until(0.3, self.go)
        # upstream's controller takes its feed-forward from the reference before
        self.until(DRIVE_S - 0.3, lambda: self.go(DRIVE_SPEED + 0.001))
        silent = self.t_go
        self.until(SILENCE_S, lambda: self.control(DRIVE_SPEED + 0.001))
        return self.measure_rate(began, silent)

    def measure_rate(self, began, silent):
        driven = [s for s in self.samples if began + SETTLE_S <= s[0] < silent]
        span = driven[-1][0] - driven[0][0]
        odom = self.newest["odom_1"]
        return {"silent": silent, "rate": (len(driven) - 1) / span, "began": began + SETTLE_S,
                "speed": sum(s[7] for s in driven) / len(driven),
                "yaw_rate": sum(s[6] for s in driven) / len(driven),
                "gate": [s[8] for s in driven], "after": self.samples[-1][8],
                "counts": {k: sum(began + SETTLE_S <= t < silent for t in v) / span
                           for k, v in self.counts.items()},
                "stamp_age": time.time() - odom.header.stamp.to_sec(),
                "frames": [odom.header.frame_id, odom.child_frame_id,
                           self.newest["/tf"].transforms[0].child_frame_id]}


if __name__ == "__main__":
    rospy.init_node("driver", disable_signals=True)
    Path(sys.argv[2]).write_text(json.dumps(Driver(sys.argv[1] == "own").run()))
