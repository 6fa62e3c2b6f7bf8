"""Follow a figure of eight by pure pursuit on the car's own odometry.

    python examples/follow_figure_of_eight.py
"""

from dart_hal import Car, Pursuit, figure_of_eight, plant_of

RADIUS = 0.9  # m; the car turns no tighter than 0.55
SPEED = 0.6  # m/s

with Car.open() as car:
    path = figure_of_eight(RADIUS)
    pursuit = Pursuit(path, plant_of(car.files))
    car.arm()
    worst = 0.0
    for s in car.states(duration=path.length / SPEED):
        steering = pursuit.steer(s.estimate.predict(car.now))
        car.drive_speed(steering=steering, speed=SPEED)
        worst = max(worst, abs(pursuit.offset))
    print(f"{pursuit.s:.1f} m along the path, never more than {100 * worst:.1f} cm off it")
