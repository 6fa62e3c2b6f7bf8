"""Two programs, two cars: one drives while the other reports that it drives, else it stops.

Both at once:      python examples/two_cars.py
In two terminals:  python examples/two_cars.py lead
                   python examples/two_cars.py follow
Over zenoh:        DART_HAL_ROOM=zenoh://lab python examples/two_cars.py

On real cars each program opens its own: DART_HAL_URL="serial:///dev/ttyUSB0?i2c=1". A third
terminal lists them (dart-hal fleet --room URL) and stops both (dart-hal fleet stop --room URL).
"""

import os
import subprocess
import sys
import time

from dart_hal import Car, join

ROOM = os.environ.get("DART_HAL_ROOM", "udp://239.255.42.99:7447")
SPEED, STEERING = 0.5, 0.1  # m/s, rad
LASTS = 6.0  # s


def drive(name: str) -> None:
    with Car.open(os.environ.get("DART_HAL_URL", "sim://?nano=mock")) as car, \
            join(car, ROOM, name=name) as member:
        car.arm()
        begin = time.monotonic() - car.now
        last = None
        for state in car.states(duration=LASTS):
            time.sleep(max(begin + car.now - time.monotonic(), 0.0))  # no emulated car runs ahead
            lead = member.other_poses().get("lead")
            heard = lead is not None and not lead.lost
            speed = SPEED if name == "lead" else lead.speed if heard else 0.0
            car.drive_speed(steering=STEERING, speed=speed)
            last = lead if heard else last
    said = f", it heard the leader {1e3 * last.age:.0f} ms old" if last else ""
    print(f"{name} ended at x {state.pose.x:.2f} m, y {state.pose.y:.2f} m{said}", flush=True)


if len(sys.argv) > 1:
    drive(sys.argv[1])
else:
    programs = [subprocess.Popen([sys.executable, __file__, name]) for name in ("lead", "follow")]
    sys.exit(max(program.wait() for program in programs))
