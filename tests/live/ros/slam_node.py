"""A rospy node with tf2 that subscribes after the car has started, and looks up each scan.

    python slam_node.py OUT.json

{"rows": [[x, y of the lidar in the map at the stamp, readings, s from the stamp to /clock], ...],
"map": [width, height], "latched": [...frames of /tf_static]}. It needs nothing of this project.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import rospy
import tf2_ros
from nav_msgs.msg import OccupancyGrid
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

SCANS = 10
LIMIT_S = 40.0


def main(out):
    first = rospy.wait_for_message("scan_1", LaserScan, LIMIT_S)
    newest = {}
    scans = []
    static = []
    buffer = tf2_ros.Buffer()
    tf2_ros.TransformListener(buffer)
    rospy.Subscriber("/map", OccupancyGrid, lambda m: newest.update(map=m))
    rospy.Subscriber("/clock", Clock, lambda m: newest.update(clock=m.clock))
    rospy.Subscriber("/tf_static", TFMessage,
                     lambda m: static.extend(one.child_frame_id for one in m.transforms))
    rospy.Subscriber("scan_1", LaserScan, scans.append)
    rows = []
    end = time.time() + LIMIT_S
    while len(rows) < SCANS and time.time() < end:
        while scans and "map" in newest:
            scan = scans.pop(0)
            try:
                found = buffer.lookup_transform("map", scan.header.frame_id, scan.header.stamp)
            except tf2_ros.TransformException as why:
                print(why, flush=True)
                continue
            at = found.transform.translation
            age = (newest["clock"] - scan.header.stamp).to_sec()
            rows.append([at.x, at.y, len(scan.ranges), age])
        time.sleep(0.02)
    info = newest["map"].info
    Path(out).write_text(json.dumps({"rows": rows, "map": [info.width, info.height],
                                     "first": len(first.ranges), "latched": static}))


if __name__ == "__main__":
    rospy.init_node("slam", disable_signals=True)
    main(sys.argv[1])
