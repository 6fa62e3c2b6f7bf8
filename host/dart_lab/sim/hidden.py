"""Hidden cars: the true parameters of a simulated car, drawn from a seed.

Seed 0, also no seed, is the nominal car of the paper. Its only imperfection is the noise of its
accelerometer, because equal samples would mean a stuck sensor. Every other seed draws a car around
it within the bounds stated here. Only ``dart-hal sim --reveal``, ``demo`` and tests may read it:
calibration and control have to measure.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field, replace

import numpy as np

from dart_hal.core.errors import NotMonotone
from dart_hal.vehicle import PAPER, PaperTyres, Steering, Vehicle, check_monotone
from dart_lab.sim.esc import EscParams
from dart_lab.sim.imu import ImuParams
from dart_lab.sim.ring import (
    GEAR_REVOLUTION,
    RING_A,
    RING_B,
    EncoderRing,
    even_ring,
    rotate_ring,
    uneven_ring,
)
from dart_lab.sim.servo import ServoParams

NOMINAL_HZ = 25e6
# Ring B is rotated by a quarter of an interval of ring A: two rings then give the direction.
EVEN_B = rotate_ring(even_ring(RING_B), 0.25 / RING_A)

# Noise densities [rad/s/sqrt(Hz), m/s2/sqrt(Hz)], BNO055 data sheet BST-BNO055-DS000.
GYRO_NOISE = math.radians(0.014)
ACCEL_NOISE = 150e-6 * 9.81


def _with_rear_limit(tyres: PaperTyres, body_load: float) -> PaperTyres:
    """Limit the force of the rear tyre to 0.8 of its static load, so that the car can spin."""
    return replace(tyres, rear_max=0.8 * body_load)


assert isinstance(PAPER.tyres, PaperTyres)
NOMINAL_VEHICLE = replace(PAPER, name="sim-0",
                          tyres=_with_rear_limit(PAPER.tyres, PAPER.body.rear_load))


@dataclass(frozen=True, slots=True)
class HiddenCar:
    """True parameters of one simulated car, in SI units, pulses in us.

    ``wheel_mass`` [kg]: rotating parts as an equivalent mass at the tyres. Four wheels of 35 g are
    0.07, the motor's rotor of 1.5 g cm2 x 1000 behind a ratio of 9 is 0.22. ``drivetrain``: share
    of the friction that remains with the wheels off the ground. The rolling resistance of a rubber
    tyre, 0.025 of its load, is a quarter of the paper's 1.72 N. ``label``: name of a car whose seed
    must stay hidden.
    """

    seed: int
    vehicle: Vehicle = NOMINAL_VEHICLE
    servo: ServoParams = field(default_factory=ServoParams)
    esc: EscParams = field(default_factory=EscParams)
    ring_a: EncoderRing = field(default_factory=lambda: even_ring(RING_A))
    ring_b: EncoderRing = field(default_factory=lambda: EVEN_B)
    gear_revolution: float = GEAR_REVOLUTION
    imu: ImuParams = field(default_factory=lambda: ImuParams(accel_noise=ACCEL_NOISE))
    oscillator_hz: float = NOMINAL_HZ
    clock_error: float = 0.0
    brake_force: float = 8.0
    wheel_mass: float = 0.3
    drivetrain: float = 0.75
    label: str = ""

    @property
    def name(self) -> str:
        return self.label or f"sim-{self.seed}"

    @property
    def board_id(self) -> int:
        """Return the id in the EEPROM of the Nano."""
        number = zlib.crc32(self.label.encode()) if self.label else self.seed
        return 0xDA270000 | (number & 0xFFFF)


def hidden_car(seed: int | None, ring: str | None = None) -> HiddenCar:
    """Return the car of a seed; ``ring`` "even" or "hidden" overrides the encoder ring."""
    number = seed or 0
    car = HiddenCar(number) if number == 0 else _draw_car(number)
    if ring == "even":
        return replace(car, ring_a=even_ring(RING_A), ring_b=EVEN_B)
    if ring == "hidden" and number == 0:
        rng = np.random.default_rng([0, 4])
        return replace(car, ring_a=uneven_ring(RING_A, rng), ring_b=uneven_ring(RING_B, rng))
    return car


def _draw_car(seed: int) -> HiddenCar:
    # One generator per group, so that a parameter added to one group does not change the others.
    body, steer, esc, ring, imu, clock, wheels, glue = (
        np.random.default_rng([seed, k]) for k in range(1, 9))
    duty = float(ring.uniform(-0.12, 0.12))
    curve = _draw_steering(steer)
    return HiddenCar(
        seed=seed,
        vehicle=_draw_vehicle(body, curve, f"sim-{seed}"),
        servo=ServoParams(curve=curve,
                          delay=float(steer.uniform(0.005, 0.03)),
                          backlash=math.radians(float(steer.uniform(0.3, 2.0))),
                          repeatability=float(steer.uniform(0.5, 1.5))),
        esc=EscParams(neutral_us=1500.0 + float(esc.uniform(-10.0, 10.0)),
                      deadband_forward_us=25.0 * float(esc.uniform(0.8, 1.2)),
                      deadband_reverse_us=25.0 * float(esc.uniform(0.8, 1.2)),
                      saturation_us=450.0 * float(esc.uniform(0.97, 1.03)),
                      reverse_gap=0.1 * float(esc.uniform(0.5, 1.0)),
                      signal_loss=0.5 * float(esc.uniform(0.6, 1.0))),
        ring_a=uneven_ring(RING_A, ring, 0.02, duty),
        ring_b=rotate_ring(uneven_ring(RING_B, ring, 0.02, duty),
                           float(glue.uniform(0.0, 1.0 / RING_A))),
        gear_revolution=GEAR_REVOLUTION * float(ring.uniform(0.995, 1.005)),
        imu=_draw_imu(imu),
        oscillator_hz=NOMINAL_HZ * float(clock.uniform(0.97, 1.05)),
        clock_error=float(clock.uniform(-0.003, 0.003)),
        brake_force=8.0 * float(body.uniform(0.9, 1.1)),
        wheel_mass=0.3 * float(wheels.uniform(0.8, 1.2)),
        drivetrain=0.75 * float(wheels.uniform(0.8, 1.2)),
    )


def _draw_steering(rng: np.random.Generator) -> Steering:
    """Draw a steering map: gains and amplitudes within 8 %, trim within 0.06 of the commands."""
    base = PAPER.steering
    factor = rng.uniform(0.92, 1.08, 4)
    curve = Steering(k_left=base.k_left * float(factor[0]),
                     a_left_rad=base.a_left_rad * float(factor[1]),
                     s0=base.s0 + float(rng.uniform(-0.06, 0.06)),
                     a_right_rad=base.a_right_rad * float(factor[2]),
                     k_right=base.k_right * float(factor[3]))
    try:
        check_monotone(curve)
    except NotMonotone:
        return _draw_steering(rng)
    return curve


def _draw_vehicle(rng: np.random.Generator, steering: Steering, name: str) -> Vehicle:
    base = PAPER
    motor = base.duty_motor
    assert isinstance(base.tyres, PaperTyres)

    def draw(value: float, part: float) -> float:
        return value * float(rng.uniform(1.0 - part, 1.0 + part))

    body = replace(base.body, mass=draw(base.body.mass, 0.03),
                   yaw_inertia=draw(base.body.yaw_inertia, 0.1))
    return Vehicle(
        name=name, body=body, steering=steering,
        friction=replace(base.friction, a=draw(base.friction.a, 0.08),
                         c=draw(base.friction.c, 0.1)),
        motor=replace(motor, d=draw(motor.d, 0.05), e=draw(motor.e, 0.05),
                      g=draw(motor.g, 0.05)),
        tyres=replace(_with_rear_limit(base.tyres, body.rear_load),
                      front_D=draw(base.tyres.front_D, 0.1),
                      front_B=draw(base.tyres.front_B, 0.1),
                      rear_cornering_stiffness=draw(base.tyres.rear_cornering_stiffness, 0.1)))


def _draw_imu(rng: np.random.Generator) -> ImuParams:
    """Draw an IMU: mounting within 3 deg, bias 1 deg/s, scale 1 %, noise of the data sheet."""
    degree = math.radians(1.0)
    bias = rng.uniform(-degree, degree, 3)
    mount = rng.uniform(-3.0 * degree, 3.0 * degree, 3)
    return ImuParams(
        x=0.0945 + float(rng.uniform(-0.01, 0.01)), y=float(rng.uniform(-0.01, 0.01)),
        mount_yaw=float(mount[0]), mount_pitch=float(mount[1]), mount_roll=float(mount[2]),
        gyro_bias=(float(bias[0]), float(bias[1]), float(bias[2])),
        gyro_scale=1.0 + float(rng.uniform(-0.01, 0.01)),
        gyro_noise=GYRO_NOISE, accel_noise=ACCEL_NOISE)
