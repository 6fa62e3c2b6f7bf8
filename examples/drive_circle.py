"""Drive a left circle for ten seconds, then print the position of the car.

The emulated car:  python examples/drive_circle.py
A real car:        DART_HAL_URL="serial:///dev/ttyUSB0?i2c=1" python examples/drive_circle.py
"""

from dart_hal import Car

STEERING = 0.2  # rad, positive to the left
SPEED = 0.5  # m/s

with Car.open() as car:
    car.arm()
    for s in car.states(duration=10.0):
        car.drive_speed(steering=STEERING, speed=SPEED)
    print(f"{s.speed:.2f} m/s, x {s.pose.x:.2f} m, y {s.pose.y:.2f} m, turned {s.pose.yaw:.1f} rad")
