"""An emulated car in real time on ROS 1; at the end of its standard input it writes what the ESC
got.

    python car_node.py PINS.json [URL]

{"pulses": [[time.time(), us], ...], "speeds": [[time.time(), true m/s], ...] of each State that
the bridge took, "said": [...]}
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_lab.live.ros.bridge import Bridge
from dart_lab.live.ros.ros1 import Ros1
from dart_lab.sim.truth import world_of


def main(out, url="sim://?nano=mock&seed=1&mocap=1&pace=1"):
    node = Ros1("dart_hal_1")
    backend = open_backend(url)
    pulses = []
    warnings = []
    speeds = []
    world = world_of(backend)
    world.watchers.append(lambda channel, pulse: pulses.append(
        (time.time(), (pulse[1] - pulse[0]) * 1e6)) if channel == 1 else None)
    with Car.over(backend) as car:
        threading.Thread(target=lambda: (sys.stdin.read(), node.close()), daemon=True).start()

        def taken_states():
            for state in car.states():
                speeds.append((time.time(), world.truth().v_x))
                yield state

        Bridge(car, 1, node, warnings.append).run(car.arming(), taken_states())
    Path(out).write_text(json.dumps({"pulses": pulses, "said": warnings, "speeds": speeds}))


if __name__ == "__main__":
    main(*sys.argv[1:])
