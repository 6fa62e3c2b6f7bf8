"""The car.toml of a simulated car: what its builder would know.

It has the nominal values of the drawings, never the hidden ones. The PWM clock is the exception: it
is given as measured with a logic analyser, so that the car can be armed without a waiver.
"""

from __future__ import annotations

import numpy as np

from dart_hal.vehicle import PAPER, Body
from dart_lab.sim.battery import CELLS, DIVIDER_RATIO, BatteryParams
from dart_lab.sim.hidden import HiddenCar, hidden_car
from dart_lab.sim.ring import GEAR_REVOLUTION, RING_A, RING_B

# Relative error of the travel per edge: callipers on a tyre, 0.14 of 46.6 mm.
TYRE_STD = 0.003
# Relative error of the clock measurement: a logic analyser's crystal.
CLOCK_STD = 1e-4

# us of pulse from neutral to a throttle of 1, as in car.toml.
THROTTLE_SPAN_US = 450.0
_CAR_TOML = """\
schema = "dart-hal/car/1"
name = "{name}"

[geometry]
wheelbase = {wheelbase}
l_f = {l_f:.6f}
l_r = {l_r:.6f}
mass = {mass}
yaw_inertia = {inertia:.6f}

[steering]
channel = 0
center_us = {center}
span_us = {span}

[throttle]
channel = 1
neutral_us = 1500.0
span_us = {throttle_span}
arm_neutral = 2.0
reverse = true
deadband_us = 25.0
saturation_us = 450.0
signal_loss = 0.5

[pwm]
address = 0x40
frequency = 50.0
oscillator_hz = {{ value = {hertz:.1f}, std = {hertz_std:.1f} }}
clock_channel = 15

[encoder]
rings = {rings}
edges_per_rev = {ring_a}
edges_per_rev_b = {ring_b}
metres_per_edge = {{ value = {per_edge:.8f}, std = {per_edge_std:.8f} }}

[imu]
required = true
x = 0.0945
y = 0.0
"""


def battery_table(pack: BatteryParams | None) -> str:
    """Return the table of a car whose battery is measured, else nothing."""
    if pack is None:
        return ""
    nano = f'source = "nano"\nratio = {DIVIDER_RATIO}\n' if pack.at_nano else ""
    return f"\n[battery]\ncells = {CELLS}\n{nano}"


def car_toml(car: HiddenCar, body: Body = PAPER.body, rings: int = 1) -> str:
    """Return the text of the file; rings: how many the Nano counts.

    The error of the measured clock is drawn from the seed; seed 0 has none.
    """
    hertz = car.oscillator_hz
    if car.seed:
        rng = np.random.default_rng([car.seed, 50])
        hertz *= 1.0 + CLOCK_STD * float(np.clip(rng.normal(), -2.5, 2.5))
    per_edge = GEAR_REVOLUTION / RING_A
    return _CAR_TOML.format(
        name=car.name, rings=rings, wheelbase=body.wheelbase, l_f=body.l_f, l_r=body.l_r,
        mass=body.mass, inertia=body.yaw_inertia, center=car.servo.center_us,
        span=car.servo.span_us, throttle_span=THROTTLE_SPAN_US,
        hertz=hertz, hertz_std=hertz * CLOCK_STD, ring_a=RING_A, ring_b=RING_B,
        per_edge=per_edge, per_edge_std=TYRE_STD * per_edge)


def typical_car_toml() -> str:
    """Return the file of the nominal car, for which drives are planned without a car."""
    return car_toml(hidden_car(0))
