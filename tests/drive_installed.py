"""Drive the simulated car of an installed package: for environments without pytest."""

from dart_hal import Car

with Car.open("sim://?nano=mock") as car:
    car.arm()
    for state in car.states(duration=1.0):
        car.drive(steering=0.1, throttle=0.3)
assert state.speed > 0.0
