"""Laws of the effects: what each equation gives at states worked out by hand.

The numbers follow from the equations in the docstrings of the effects and from nothing else. Each
term of an equation is different from 0 in at least one law, and every signed quantity has both
signs: left and right, forwards and in reverse, driving and braking.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from dart_hal.vehicle import PAPER, UPSTREAM_2024
from dart_hal.vehicle.parameters import (
    AxleTyres,
    Body,
    Delay,
    Friction,
    Motor,
    PaperTyres,
    SpeedLoop,
    Steering,
    Vehicle,
)

LAW_SAMPLE_TIME = 0.01
"""s between the samples of a series."""
G = 9.81
TURN = 2.0 * math.pi * 11.0 / 39.0 * 0.0233
"""m travelled per turn of the encoder's gear: final drive 11:39, wheel radius 23.3 mm."""

ROUND_CAR = Vehicle(
    "round numbers",
    Body(wheelbase=0.18, l_f=0.08, l_r=0.1, mass=2.0, yaw_inertia=0.01),
    Friction(a=1.5, b=10.0, c=0.3, q=0.1),
    Motor(d=30.0, e=6.0, g=-0.15, reverse=0.6),
    Steering(k_left=1.6, a_left_rad=0.3, s0=0.02, a_right_rad=0.4, k_right=1.7),
    PaperTyres(front_D=3.0, front_C=0.7, front_B=16.0, front_E=-3.0,
               rear_cornering_stiffness=20.0, rear_max=5.0),
    Delay(steering_s=0.15, throttle_s=0.05, steering_lag_s=0.04, throttle_lag_s=0.03))
AXLE_CAR = replace(ROUND_CAR, tyres=AxleTyres(front_D=0.8, front_C=0.8, front_B=8.0,
                                       rear_D=0.9, rear_C=1.0, rear_B=11.0))
LINEAR_CAR = replace(ROUND_CAR, tyres=PaperTyres(100.0, 0.8, 0.5, 0.0, 20.0))
"""F_yf = 100 sin(0.8 atan(alpha / 2)), which is 40 N/rad alpha to 5e-5 of it at 0.02 rad."""
SHARP_CAR = replace(ROUND_CAR, tyres=PaperTyres(20.0, 2.0, 10.0, 0.0, 20.0))
"""Its front tyres have their largest force, 20 N, at 0.1 rad and less beyond."""
LOOP_CAR = replace(ROUND_CAR, motor=SpeedLoop(gain=8.0, max_force=12.0))
LAW_CARS = {"round": ROUND_CAR, "loop": LOOP_CAR, "sharp": SHARP_CAR, "axle": AXLE_CAR,
            "linear": LINEAR_CAR, "paper": PAPER, "upstream": UPSTREAM_2024,
            "eight volts": replace(ROUND_CAR, motor_voltage=8.0)}

DELTA = math.atan2(0.6, 0.8)
LEFT = {"cos_d": 0.8, "sin_d": 0.6}
RIGHT_TURN = {"cos_d": 0.8, "sin_d": -0.6}
FORCE_INPUTS = {"eta": 0.5, "v_x": 1.5, "v_y": 0.2, "omega": 2.0, **LEFT, "alpha_f": 0.05,
                "alpha_r": -0.04, "f_xf": 1.0, "f_xr": 0.7, "f_yf": 2.0, "f_yr": -1.5, "f_x": 0.3,
                "f_y": -0.2, "m_z": 0.01}
"""State of a law of forces, where the law does not change it: a left turn; SI units."""


@dataclass(frozen=True, slots=True)
class Law:
    """An effect with its values, a state, and what the equation gives there.

    ``state`` and ``expected`` are by name. Forces: fields of ``effect.Forces``; what is not in
    ``expected`` must not change. Signals: series by channel, with fields of ``effect.Now``.
    Parameters: state {}, expected "group.key"; all others must not change. Quantities of the base
    model: see ``law_engines.QUANTITIES``. tolerance: relative above 1, else
    absolute.
    """

    effect: str
    values: Mapping[str, float]
    state: Mapping[str, Any]
    expected: Mapping[str, Any]
    car: str = "round"
    tolerance: float = field(default=1e-12, kw_only=True)


def smooth_dead_band(u: float) -> float:
    """Compute max(0, u) with the blend of the motor model, 0.01 wide."""
    return 0.5 * u * (math.tanh(100.0 * u) + 1.0)


def left_angle(s: float) -> float:
    """Compute the steering map of CAR for commands further left than 0.6, where no blend is."""
    return 0.3 * math.tanh(1.6 * (s + 0.02))


def right_angle(s: float) -> float:
    """Compute the same for commands further right than -0.6."""
    return 0.4 * math.tanh(1.7 * (s + 0.02))


COMMAND_LAWS = (
    # F_m times 1 + k t / 100 s; 0.4 is 0.25 beyond the dead band of 0.15, 0.16 is within its blend
    Law("battery_fade", {"k": -0.3}, {"throttle": [0.4, 0.4, -0.4], "t": [0.0, 50.0, 50.0]},
        {"throttle": [0.4, 0.4 - 0.15 * 0.25, -0.4 + 0.15 * 0.25]}),
    Law("battery_fade", {"k": 0.2}, {"throttle": [0.4, -0.4, 0.16, 0.0], "t": [100.0] * 4},
        {"throttle": [0.45, -0.45, 0.16 + 0.2 * smooth_dead_band(0.01), 0.0]}),
    # of a motor of 8 V: k per 0.8 V below that, at any time; nothing where no voltage is measured
    Law("battery_fade", {"k": -0.1}, {"throttle": [0.4, 0.4, -0.4], "t": [0.0, 70.0, 80.0],
                                      "voltage": [8.0, 6.4, 8.4]},
        {"throttle": [0.4, 0.4 - 0.2 * 0.25, -0.4 - 0.05 * 0.25]}, "eight volts"),
    Law("battery_fade", {"k": -0.1}, {"throttle": [0.4, -0.4], "t": [0.0, 70.0]},
        {"throttle": [0.4, -0.4]}, "eight volts"),
    # a model that does not state it follows the time, as in version 0.1, also with a voltage
    Law("battery_fade", {"k": -0.1}, {"throttle": [0.4, 0.4], "t": [0.0, 50.0],
                                      "voltage": [8.0, 6.4]},
        {"throttle": [0.4, 0.4 - 0.05 * 0.25]}),
    # |tau| <= 1/k
    Law("motor_saturation", {"k": 2.5}, {"throttle": [0.8, -0.8, 0.3, -0.3, 0.0]},
        {"throttle": [0.4, -0.4, 0.3, -0.3, 0.0]}),
    Law("motor_saturation", {"k": 4.0}, {"throttle": [0.8, -0.3, -0.2]},
        {"throttle": [0.25, -0.25, -0.2]}),
    # u = command + k (command + 1500 us / span); the spans are 375 us and 450 us
    Law("pwm_clock", {"k": 0.01}, {"steering": [0.5, 0.0, -0.5], "throttle": [0.6, 0.0, -0.6]},
        {"steering": [0.545, 0.04, -0.465],
         "throttle": [0.6 + 0.006 + 0.1 / 3, 0.1 / 3, -0.6 - 0.006 + 0.1 / 3]}),
    Law("pwm_clock", {"k": -0.02}, {"steering": [0.5], "throttle": [0.6]},
        {"steering": [0.41], "throttle": [0.6 - 0.012 - 0.2 / 3]}),
    # u = k floor(command / k + phase); the throttle has 375/450 of the step
    Law("pwm_quantisation", {"k": 0.12}, {"steering": [0.27, -0.27, 0.0],
                                          "throttle": [0.27, -0.27, 0.0]},
        {"steering": [0.24, -0.36, 0.0], "throttle": [0.2, -0.3, 0.0]}),
    Law("pwm_quantisation", {"k": 0.12, "phase": 0.5},
        {"steering": [0.35, 0.29, -0.29, -0.35], "throttle": [0.27, 0.23, -0.23, -0.27]},
        {"steering": [0.36, 0.24, -0.24, -0.36], "throttle": [0.3, 0.2, -0.2, -0.3]}),
    Law("pwm_quantisation", {"k": 0.12, "phase": 0.25},
        {"steering": [0.27, 0.34, -0.26, -0.34], "throttle": [0.27, 0.28, -0.27, -0.28]},
        {"steering": [0.24, 0.36, -0.24, -0.36], "throttle": [0.2, 0.3, -0.3, -0.3]}),
    Law("pwm_quantisation", {"k": 0.0}, {"steering": [0.271, -0.333], "throttle": [0.271, -0.333]},
        {"steering": [0.271, -0.333], "throttle": [0.271, -0.333]}),
    # the angle stays within k/2 of the linkage and moves only when it is pushed
    Law("steering_backlash", {"k": 0.2},
        {"angle": [0.0, 0.05, 0.3, 0.25, 0.15, 0.0, -0.3, -0.2, -0.1]},
        {"angle": [0.0, 0.0, 0.2, 0.2, 0.2, 0.1, -0.2, -0.2, -0.2]}),
    # delta - clip(delta, -k/2, k/2)
    Law("steering_dead_zone", {"k": 0.2}, {"angle": [0.25, 0.06, 0.0, -0.06, -0.25]},
        {"angle": [0.15, 0.0, 0.0, 0.0, -0.15]}),
    # |ds/dt| <= 1/k: 0.02 in each sample
    Law("steering_rate_limit", {"k": 0.5},
        {"steering": [0.0, 0.05, 0.05, 0.05, 0.05, 0.03, 0.0, 0.0, -0.5, -0.5]},
        {"steering": [0.0, 0.02, 0.04, 0.05, 0.05, 0.03, 0.01, 0.0, -0.02, -0.04]}),
    Law("steering_rate_limit", {"k": 0.0}, {"steering": [0.0, 1.0, -1.0]},
        {"steering": [0.0, 1.0, -1.0]}),
    Law("steering_rate_limit", {"k": 2.0}, {"steering": [0.0, 0.0, 0.008, 0.008, 0.012]},
        {"steering": [0.0, 0.0, 0.005, 0.008, 0.012]}),
    Law("steering_rate_limit", {"k": 0.25}, {"steering": [0.0, 0.1, 0.1, 0.1]},
        {"steering": [0.0, 0.04, 0.08, 0.1]}),
    Law("steering_trim", {"k": 0.1}, {"angle": [0.3, 0.0, -0.3]}, {"angle": [0.4, 0.1, -0.2]}),
    Law("steering_trim", {"k": -0.1}, {"angle": [0.3, 0.0, -0.3]}, {"angle": [0.2, -0.1, -0.4]}),
)

def ring_law(turns: float, density: float, part: float = 0.25, **values: float) -> Law:
    """Make a law of encoder_ring: the mean density of the marks over the last ``part`` of a turn.

    The window of 0.1 s ends at ``turns``. In reverse the same marks go by the other way round, and
    the window ends where it began.
    """
    speed = part * TURN / 0.1
    return Law("encoder_ring", values, {"wheel": [speed, -speed], "turns": [turns, turns - part]},
               {"wheel": [density * speed, -density * speed]}, tolerance=1e-11)


SENSORS = (
    Law("clock_offset", {"k": 0.02},
        {"wheel": [1.0, 2.0, 4.0, 8.0], "gyro": [1.0, -2.0, 4.0, 8.0],
         "accel": ([1.0, 2.0, 4.0, 8.0], [-1.0, 2.0, 4.0, 8.0])},
        {"wheel": [1.0, 1.0, 1.0, 2.0], "gyro": [1.0, 1.0, 1.0, -2.0],
         "accel": ([1.0, 1.0, 1.0, 2.0], [-1.0, -1.0, -1.0, 2.0])}),
    Law("clock_offset", {"k": -0.005}, {"wheel": [1.0, 2.0, 4.0], "gyro": [1.0, -2.0, 4.0],
                                        "accel": ([1.0, 2.0, 4.0], [0.0, 2.0, -4.0])},
        {"wheel": [1.5, 3.0, 4.0], "gyro": [-0.5, 1.0, 4.0],
         "accel": ([1.5, 3.0, 4.0], [1.0, -1.0, -4.0])}),
    Law("encoder_latency", {"k": 0.01}, {"wheel": [1.0, 2.0, -4.0]}, {"wheel": [1.0, 1.0, 2.0]}),
    Law("gyro_latency", {"k": 0.01}, {"gyro": [1.0, 2.0, -4.0]}, {"gyro": [1.0, 1.0, 2.0]}),
    Law("mocap_latency", {"k": 0.015},
        {"pose": ([1.0, 2.0, 4.0], [0.0, -1.0, -3.0], [0.0, 0.2, 0.6])},
        {"pose": ([1.0, 1.0, 1.5], [0.0, 0.0, -0.5], [0.0, 0.0, 0.1])}),
    # v + k (hypot(v_x, v_y + l_f omega) - v_x): hypot(1.5, 2.0) = 2.5 with l_f = 0.08 m
    Law("encoder_axle", {"k": 0.25},
        {"wheel": [1.6] * 4, "v_x": [1.5] * 4, "v_y": [0.0, 0.4, 0.0, -0.4],
         "omega": [25.0, 20.0, -25.0, -20.0]}, {"wheel": [1.85] * 4}),
    Law("encoder_axle", {"k": -0.5},
        {"wheel": [1.6, 1.6, 0.0], "v_x": [1.5, 1.5, 0.0], "v_y": [2.4, 0.0, 0.0],
         "omega": [-5.0, 0.0, 5.0]}, {"wheel": [1.1, 1.6, -0.2]}),
    # at rest the root is 1e-6 m/s, so that it has a slope
    Law("encoder_axle", {"k": -0.5}, {"wheel": [0.0]}, {"wheel": [-0.5e-6]}),
    # 1 + uneven cos(2 pi u): the integral of the cosine over a quarter of a turn is 1/(2 pi)
    ring_law(0.25, 1.0 + 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2),
    ring_law(1.0, 1.0 + 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2),
    ring_law(0.5, 1.0 - 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2),
    ring_law(0.0, 1.0 + 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2, phase=0.25),
    ring_law(0.25, 1.0 - 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2, phase=0.25),
    ring_law(1.0, 1.0 - 0.2 * 4.0 / (2.0 * math.pi), uneven=0.2, part=0.5, phase=-0.25),
    # the gap is 0 to 0.1 of each turn
    ring_law(0.25, 1.0 - 0.1 / 0.25, missing=0.1),
    ring_law(3.25, 1.0 - 0.1 / 0.25, missing=0.1),
    ring_law(1.05, 1.0 - 0.05 / 0.25, missing=0.1),
    ring_law(0.3, 1.0 - 0.05 / 0.25, missing=0.1),
    ring_law(0.75, 1.0, missing=0.1),
    ring_law(0.7, 1.0 - 0.05 / 0.25, missing=0.1, phase=0.35),
    ring_law(2.6, 1.0 - 0.2 / 2.5, missing=0.1, part=2.5),
    ring_law(0.25, 1.0 + 0.1 / 0.25, missing=-0.1),
    ring_law(1.05, 1.0 + 0.05 / 0.25, missing=-0.1),
    ring_law(0.25, 1.0 - 0.1 / 0.25 + 0.2 * 4.0 / (2.0 * math.pi), missing=0.1, uneven=0.2),
    # hardly moving: a window within the gap, and one beyond it
    Law("encoder_ring", {"missing": 0.1},
        {"wheel": [0.0, 1e-5, -1e-5, 1e-5, -1e-5], "turns": [0.05, 0.05, 0.05, 0.5, 0.5]},
        {"wheel": [0.0, 0.0, 0.0, 1e-5, -1e-5]}, tolerance=1e-15),
    Law("encoder_scale", {"k": 0.25}, {"wheel": [2.0, -2.0]}, {"wheel": [2.5, -2.5]}),
    Law("encoder_scale", {"k": -0.25}, {"wheel": [2.0]}, {"wheel": [1.5]}),
    # v (1 + k F / m), m = 2 kg
    Law("encoder_slip", {"k": 0.1},
        {"wheel": [2.0, 2.0, -2.0, 2.0], "drive": [3.0, -3.0, -3.0, 0.0]},
        {"wheel": [2.3, 1.7, -1.7, 2.0]}),
    Law("gyro_bias", {"k": 0.1}, {"gyro": [2.0, -2.0, 0.0]}, {"gyro": [2.1, -1.9, 0.1]}),
    Law("gyro_scale", {"k": 0.25}, {"gyro": [2.0, -2.0]}, {"gyro": [2.5, -2.5]}),
    Law("gyro_scale", {"k": -0.25}, {"gyro": [2.0]}, {"gyro": [1.5]}),
    # a_x - k omega^2, a_y + k d(omega)/dt
    Law("imu_lever_arm", {"k": 0.1},
        {"accel": ([1.0, 1.0], [2.0, 2.0]), "omega": [3.0, -3.0], "omega_dot": [5.0, -5.0]},
        {"accel": ([0.1, 0.1], [2.5, 1.5])}),
    # a_x - k d(omega)/dt, a_y - k omega^2
    Law("imu_offset_y", {"k": 0.1},
        {"accel": ([1.0, 1.0], [2.0, 2.0]), "omega": [3.0, -3.0], "omega_dot": [5.0, -5.0]},
        {"accel": ([0.5, 1.5], [1.1, 1.1])}),
    # nose down: forwards reads less by gravity
    Law("imu_pitch", {"k": 0.3}, {"accel": ([2.0, -2.0], [1.0, -1.0]), "gyro": [3.0, -3.0]},
        {"accel": ([2.0 * math.cos(0.3) - G * math.sin(0.3),
                    -2.0 * math.cos(0.3) - G * math.sin(0.3)], [1.0, -1.0]),
         "gyro": [3.0 * math.cos(0.3), -3.0 * math.cos(0.3)]}),
    # left side up: left reads more by gravity
    Law("imu_roll", {"k": 0.3}, {"accel": ([2.0, -2.0], [1.0, -1.0]), "gyro": [3.0, -3.0]},
        {"accel": ([2.0, -2.0], [math.cos(0.3) + G * math.sin(0.3),
                                 -math.cos(0.3) + G * math.sin(0.3)]),
         "gyro": [3.0 * math.cos(0.3), -3.0 * math.cos(0.3)]}),
    Law("imu_yaw", {"k": 0.3}, {"accel": ([2.0, 0.0], [0.0, 1.0])},
        {"accel": ([2.0 * math.cos(0.3), math.sin(0.3)], [-2.0 * math.sin(0.3), math.cos(0.3)])}),
    # k (cos(yaw), sin(yaw)) ahead, k (-sin(yaw), cos(yaw)) to the left
    Law("mocap_offset_x", {"k": 0.1}, {"pose": ([1.0, 1.0], [2.0, 2.0], [0.5, -0.5])},
        {"pose": ([1.0 + 0.1 * math.cos(0.5)] * 2,
                  [2.0 + 0.1 * math.sin(0.5), 2.0 - 0.1 * math.sin(0.5)], [0.5, -0.5])}),
    Law("mocap_offset_y", {"k": 0.1}, {"pose": ([1.0, 1.0], [2.0, 2.0], [0.5, -0.5])},
        {"pose": ([1.0 - 0.1 * math.sin(0.5), 1.0 + 0.1 * math.sin(0.5)],
                  [2.0 + 0.1 * math.cos(0.5)] * 2, [0.5, -0.5])}),
    Law("mocap_yaw", {"k": 0.1}, {"pose": ([1.0, 2.0], [2.0, -3.0], [0.5, -0.5])},
        {"pose": ([1.0, 2.0], [2.0, -3.0], [0.6, -0.4])}),
    # an accelerometer reads k less along the downhill direction of the room
    Law("road_slope_x", {"k": 0.4}, {"accel": ([1.0, 1.0], [2.0, 2.0]), "yaw": [0.5, -2.5]},
        {"accel": ([1.0 - 0.4 * math.cos(0.5), 1.0 - 0.4 * math.cos(2.5)],
                   [2.0 + 0.4 * math.sin(0.5), 2.0 - 0.4 * math.sin(2.5)])}),
    Law("road_slope_y", {"k": 0.4}, {"accel": ([1.0, 1.0], [2.0, 2.0]), "yaw": [0.5, -2.5]},
        {"accel": ([1.0 - 0.4 * math.sin(0.5), 1.0 + 0.4 * math.sin(2.5)],
                   [2.0 - 0.4 * math.cos(0.5), 2.0 - 0.4 * math.cos(2.5)])}),
)


def slope_law(effect: str, k: float, eta: float, towards: float) -> Law:
    """Make a law of a slope that pulls with m k = 2 kg k in a direction of the room [rad]."""
    angle = towards - eta
    return Law(effect, {"k": k}, {"eta": eta}, {"f_x": 0.3 + 2.0 * k * math.cos(angle),
                                                "f_y": -0.2 + 2.0 * k * math.sin(angle)})


def transfer_law(k: float, a_x: float, **state: float) -> Law:
    """Make a law of load_transfer: F_yf = 2 N and F_yr = -1.5 N at the acceleration a_x."""
    return Law("load_transfer", {"k": k}, state,
               {"f_yf": 2.0 * max(0.0, 1.0 - k * a_x / G),
                "f_yr": -1.5 * max(0.0, 1.0 + k * a_x / G)})


def roll_law(k: float, a_y: float, **state: float) -> Law:
    """Make a law of roll_compliance: the forces of ``state``, or of ``FORCES``, at a_y."""
    share = max(0.0, 1.0 - k * (a_y / G) ** 2)
    forces = FORCE_INPUTS | state
    return Law("roll_compliance", {"k": k}, state,
               {"f_yf": forces["f_yf"] * share, "f_yr": forces["f_yr"] * share})


def front_force(car: str, alpha: float) -> float:
    """Compute the force [N] of the front tyres of one of CARS at a slip angle [rad]."""
    t = LAW_CARS[car].tyres
    x = t.front_B * alpha
    return t.front_D * math.sin(t.front_C * math.atan(x - t.front_E * (x - math.atan(x))))


def linear_compliance_law(k: float, slip: float, way: float, tolerance: float = 6e-5,
                          **state: float) -> Law:
    """Make a law of steering_compliance on linear tyres of 40 N/rad, where it has a closed form.

    slip: alpha_f of the rigid steering [rad]; way: 1 forwards, -1 in reverse. F_yf = 0 in the
    state, so that the expected F_yf is the change of the force of the tyres.

        alpha + way k F = slip,  F = 40 alpha,  so  alpha = slip / (1 + 40 way k)
    """
    alpha = slip / max(0.5, 1.0 + 40.0 * way * k)       # in reverse at most twice the slip
    force = front_force("linear", alpha)
    change = force - front_force("linear", slip)
    forces = FORCE_INPUTS | state
    delta = math.atan2(forces["sin_d"], forces["cos_d"]) - k * force
    return Law("steering_compliance", {"k": k}, {"alpha_f": slip, "f_yf": 0.0, **state},
               {"alpha_f": alpha, "f_yf": change, "cos_d": math.cos(delta),
                "sin_d": math.sin(delta)}, "linear", tolerance=tolerance)


def solve_compliance(k: float, slip: float) -> float:
    """Solve alpha + k F(alpha) = slip for the tyres of PAPER by bisection, forwards."""
    low = 0.0
    high = abs(slip)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle + k * front_force("paper", middle) < abs(slip):
            low = middle
        else:
            high = middle
    return math.copysign(low, slip)


def iterate_compliance(car: str, k: float, slip: float, way: float) -> float:
    """Approximate the slip angle as in the docstring of steering_compliance.

    1. Three times alpha = slip / (1 + k F(alpha) / alpha), in reverse at most twice the slip.
    2. The changes that would follow, as a geometric series whose ratio is that of the last two
       changes, at most a half.
    """
    alphas = [slip]
    for _ in range(3):
        stiffness = front_force(car, alphas[-1]) / alphas[-1]
        alphas.append(slip / max(0.5, 1.0 + way * k * stiffness))
    last = alphas[3] - alphas[2]
    ratio = min(0.5, max(-0.5, last / (alphas[2] - alphas[1])))
    return alphas[3] + last * ratio / (1.0 - ratio)


def compliance_law(car: str, k: float, slip: float, alpha: float, tolerance: float,
                   v_x: float = 1.5) -> Law:
    """Make a law of steering_compliance: at the slip of the rigid steering it is alpha."""
    force = front_force(car, alpha)
    delta = DELTA - k * force
    return Law("steering_compliance", {"k": k},
               {"alpha_f": slip, "f_yf": front_force(car, slip), "v_x": v_x},
               {"alpha_f": alpha, "f_yf": force, "cos_d": math.cos(delta),
                "sin_d": math.sin(delta)}, car, tolerance=tolerance)


# (1.5 N tanh(10 v) + 0.3 N s/m v + 0.1 N s2/m2 v^2) at 1.5 m/s
FRICTION_AT_1_5 = 1.5 * math.tanh(15.0) + 0.45 + 0.225
PULL = 1.0 + 0.7 + FRICTION_AT_1_5

FORCE_LAWS = (
    # F_m - k v, at least 0, half of the change at each axle; F_m = F_x + friction
    Law("back_emf", {"k": 1.0}, {}, {"f_xf": 1.0 - 0.75, "f_xr": 0.7 - 0.75}),
    Law("back_emf", {"k": 4.0}, {}, {"f_xf": 1.0 - 0.5 * PULL, "f_xr": 0.7 - 0.5 * PULL}),
    Law("back_emf", {"k": 1.0}, {"v_x": 0.1}, {"f_xf": 1.0 - 0.05, "f_xr": 0.7 - 0.05}),
    Law("back_emf", {"k": 1.0}, {"v_x": -1.5}, {}),
    Law("back_emf", {"k": 1.0}, {"f_xf": -2.0, "f_xr": -2.0}, {}),
    # F_y sqrt(1 - k (F_x / 3 N)^2) at each axle, at least a tenth
    Law("combined_slip", {"k": 2.0}, {"f_xf": 1.5, "f_xr": -0.9},
        {"f_yf": 2.0 * math.sqrt(0.5), "f_yr": -1.5 * math.sqrt(0.82)}),
    Law("combined_slip", {"k": 4.0}, {"f_xf": 3.0, "f_xr": 1.2}, {"f_yf": 0.2, "f_yr": -0.9}),
    Law("combined_slip", {"k": 4.0}, {"f_xf": -1.2, "f_xr": -6.0}, {"f_yf": 1.2, "f_yr": -0.15}),
    # D = -k |delta| tanh(v_x / 0.3 m/s); 1 - s of it at the centre of mass, s at the front wheels
    Law("cornering_drag", {"k": 2.0, "s": 0.25}, {},
        {"f_x": 0.3 - 1.5 * DELTA * math.tanh(5.0), "f_xf": 1.0 - 0.5 * DELTA * math.tanh(5.0)}),
    Law("cornering_drag", {"k": 2.0, "s": 0.25}, {**RIGHT_TURN, "v_x": -0.3},
        {"f_x": 0.3 + 1.5 * DELTA * math.tanh(1.0), "f_xf": 1.0 + 0.5 * DELTA * math.tanh(1.0)}),
    # M_z = -k omega / max(|v_x|, 0.3 m/s)
    Law("differential_drag", {"k": 0.2}, {}, {"m_z": 0.01 - 0.4 / 1.5}),
    Law("differential_drag", {"k": 0.2}, {"omega": -2.0, "v_x": -1.5}, {"m_z": 0.01 + 0.4 / 1.5}),
    Law("differential_drag", {"k": 0.2}, {"v_x": 0.1}, {"m_z": 0.01 - 0.4 / 0.3}),
    # M_z = k tanh(v_x / 0.3 m/s)
    Law("lateral_pull", {"k": 0.1}, {"v_x": 0.3}, {"m_z": 0.01 + 0.1 * math.tanh(1.0)}),
    Law("lateral_pull", {"k": 0.1}, {"v_x": -0.6}, {"m_z": 0.01 - 0.1 * math.tanh(2.0)}),
    Law("lateral_pull", {"k": -0.1}, {"v_x": 0.6}, {"m_z": 0.01 - 0.1 * math.tanh(2.0)}),
    # a_x = (F_xr + F_xf cos d - F_yf sin d + F_x) / 2 kg
    transfer_law(1.0, (0.7 + 0.8 - 1.2 + 0.3) / 2.0),
    transfer_law(2.0, (0.7 + 0.8 + 1.2 + 0.3) / 2.0, **RIGHT_TURN),
    transfer_law(1.5, (-0.7 - 0.8 - 1.2 + 0.3) / 2.0, f_xf=-1.0, f_xr=-0.7),
    transfer_law(3.0, (8.0 + 0.8 - 1.2 + 0.3) / 2.0, f_xr=8.0),
    transfer_law(3.0, (-8.0 + 0.8 - 1.2 + 0.3) / 2.0, f_xr=-8.0),
    # F_yr / sqrt(1 + (k F_yr)^2): k F_yr = 0.75 makes a root of 1.25
    Law("rear_saturation", {"k": 0.5}, {}, {"f_yr": -1.2}),
    Law("rear_saturation", {"k": 0.25}, {"f_yr": 3.0}, {"f_yr": 2.4}),
    Law("rear_saturation", {"k": 0.5}, {"f_yr": -2e7}, {"f_yr": -2.0}),
    slope_law("road_slope_x", 0.5, 0.5, 0.0),
    slope_law("road_slope_x", -0.2, -2.5, 0.0),
    slope_law("road_slope_y", 0.5, 0.5, math.pi / 2.0),
    slope_law("road_slope_y", -0.2, -2.5, math.pi / 2.0),
    # a_y = (F_yr + F_yf cos d + F_xf sin d + F_y) / 2 kg
    roll_law(2.0, (1.5 + 1.6 + 0.9 - 0.2) / 2.0, f_xf=1.5, f_yr=1.5),
    roll_law(1.0, (-1.5 - 1.6 - 0.6 - 0.2) / 2.0, f_yf=-2.0, **RIGHT_TURN),
    roll_law(3.0, (12.0 + 1.6 + 0.6 - 0.2) / 2.0, f_yr=12.0),
    # M_z = -k omega
    Law("yaw_damping", {"k": 0.1}, {}, {"m_z": -0.19}),
    Law("yaw_damping", {"k": 0.2}, {"omega": -2.0}, {"m_z": 0.41}),
    # delta - k F_yf; the speed along the front wheels is v_x cos d + (v_y + 0.08 m omega) sin d
    linear_compliance_law(0.01, 0.02, 1.0),
    linear_compliance_law(0.03, -0.02, 1.0, **RIGHT_TURN),
    linear_compliance_law(0.005, 0.02, -1.0, v_x=-1.5),
    linear_compliance_law(0.03, 0.02, -1.0, v_x=-1.5),
    linear_compliance_law(0.01, 0.02, math.tanh(1.0), v_x=0.125, v_y=0.16, omega=-2.0),
    linear_compliance_law(0.01, 0.02, math.tanh(1.0), v_x=0.0, v_y=0.1 / 0.6 - 0.16),
    linear_compliance_law(0.01, 0.02, math.tanh(-1.0), v_x=0.0, v_y=0.16 - 0.1 / 0.6, omega=-2.0),
    linear_compliance_law(0.01, 0.0, 1.0),
    # near no slip the wheels give way less, but not the other way round: -0.6 mN, not +0.3 mN
    linear_compliance_law(0.01, 5e-5, 1.0, tolerance=6e-4),
    *(compliance_law("paper", k, slip, solve_compliance(k, slip), 2e-3)
      for k, slip in ((0.01, 0.05), (0.03, 0.2), (0.03, -0.1), (0.03, 0.003))),
    *(compliance_law(car, 0.03, slip, iterate_compliance(car, 0.03, slip, way), 2e-5, 1.5 * way)
      for car, slip, way in (("paper", 0.18, 1.0), ("paper", -0.18, 1.0), ("sharp", 0.5, 1.0),
                             ("paper", 0.08, -1.0), ("paper", 0.2, -1.0))),
)

PARAMETER_LAWS = (
    Law("centre_of_mass", {"k": 0.02}, {}, {"body.l_f": 0.06, "body.l_r": 0.12}),
    Law("centre_of_mass", {"k": -0.02}, {}, {"body.l_f": 0.1, "body.l_r": 0.08}),
    Law("front_grip", {"k": 0.25}, {}, {"tyres.front_D": 3.75}),
    Law("front_grip", {"k": -0.25}, {}, {"tyres.front_D": 0.6}, "axle"),
    Law("grip", {"k": 0.25}, {}, {"tyres.front_D": 3.75, "tyres.rear_cornering_stiffness": 25.0,
                                  "tyres.rear_max": 6.25}),
    Law("grip", {"k": -0.5}, {}, {"tyres.front_D": 0.4, "tyres.rear_D": 0.45}, "axle"),
    Law("mass", {"k": 0.25}, {}, {"body.mass": 2.5}),
    Law("mass", {"k": -0.25}, {}, {"body.mass": 1.5}),
    Law("motor_deadband", {"k": 0.05}, {}, {"motor.g": -0.2}),
    Law("motor_deadband", {"k": -0.05}, {}, {"motor.g": -0.1}),
    Law("motor_gain", {"k": 0.25}, {}, {"motor.d": 37.5, "motor.e": 7.5}),
    Law("motor_gain", {"k": -0.25}, {}, {"motor.d": 22.5, "motor.e": 4.5}),
    Law("motor_gain", {"k": 0.25}, {}, {"motor.gain": 10.0, "motor.max_force": 15.0}, "loop"),
    Law("motor_gain", {"k": -0.25}, {}, {"motor.gain": 6.0, "motor.max_force": 9.0}, "loop"),
    Law("quadratic_drag", {"k": 0.5}, {}, {"friction.q": 0.6}),
    Law("rolling_resistance", {"k": 0.5}, {}, {"friction.a": 2.0}),
    Law("rolling_resistance", {"k": -0.5}, {}, {"friction.a": 1.0}),
    Law("steering_delay", {"k": 0.1}, {}, {"delay.steering_s": 0.25}),
    Law("steering_gain", {"k": 0.25}, {}, {"steering.a_left_rad": 0.375,
                                           "steering.a_right_rad": 0.5}),
    Law("steering_gain", {"k": -0.25}, {}, {"steering.a_left_rad": 0.225,
                                            "steering.a_right_rad": 0.3}),
    Law("steering_lag", {"k": 0.1}, {}, {"delay.steering_lag_s": 0.14}),
    Law("throttle_delay", {"k": 0.1}, {}, {"delay.throttle_s": 0.15}),
    Law("throttle_lag", {"k": 0.1}, {}, {"delay.throttle_lag_s": 0.13}),
    Law("yaw_inertia", {"k": 0.5}, {}, {"body.yaw_inertia": 0.015}),
    Law("yaw_inertia", {"k": -0.5}, {}, {"body.yaw_inertia": 0.005}),
)

QUANTITY_LAWS = (
    # angle = (1 + k) map(s)
    Law("steering_gain", {"k": 0.1}, {"s": 0.7}, {"angle": 1.1 * left_angle(0.7)}),
    Law("steering_gain", {"k": 0.1}, {"s": -0.7}, {"angle": 1.1 * right_angle(-0.7)}),
    # F_m = (1 + k) (d - e v) T(tau), reversed (d + e v) T(-tau) with 0.6 of the force
    Law("motor_gain", {"k": 0.2}, {"tau": 0.4, "v": 1.5}, {"f_m": 1.2 * (30.0 - 9.0) * 0.25}),
    Law("motor_gain", {"k": 0.2}, {"tau": -0.4, "v": 1.5},
        {"f_m": -1.2 * 0.6 * (30.0 + 9.0) * 0.25}),
    # T(tau) = max(0, tau + g - k)
    Law("motor_deadband", {"k": 0.05}, {"tau": 0.4, "v": 1.5}, {"f_m": (30.0 - 9.0) * 0.2}),
    Law("motor_deadband", {"k": -0.05}, {"tau": -0.4, "v": 1.5},
        {"f_m": -0.6 * (30.0 + 9.0) * 0.3}),
    # F_f - k tanh(b v) and F_f - k v |v|, b = 10 s/m
    Law("rolling_resistance", {"k": 0.5}, {"v": 0.1}, {"f_f": -2.0 * math.tanh(1.0) - 0.031}),
    Law("rolling_resistance", {"k": 0.5}, {"v": -0.1}, {"f_f": 2.0 * math.tanh(1.0) + 0.031}),
    Law("quadratic_drag", {"k": 0.5}, {"v": 2.0}, {"f_f": -1.5 - 0.6 - 0.4 - 2.0}),
    Law("quadratic_drag", {"k": 0.5}, {"v": -2.0}, {"f_f": 1.5 + 0.6 + 0.4 + 2.0}),
    # F_y times 1 + k: sin(0.7 atan(x - E (x - atan x))) of 3 N in front, 20 N/rad up to 5 N behind
    Law("front_grip", {"k": 0.2}, {"alpha": 0.0625},
        {"f_yf": 3.6 * math.sin(0.7 * math.atan(4.0 - 0.75 * math.pi)), "f_yr": 1.25}),
    Law("grip", {"k": 0.2}, {"alpha": -0.0625},
        {"f_yf": -3.6 * math.sin(0.7 * math.atan(4.0 - 0.75 * math.pi)), "f_yr": -1.5}),
    Law("grip", {"k": 0.2}, {"alpha": 0.625},
        {"f_yf": 3.6 * math.sin(0.7 * math.atan(40.0 - 3.0 * math.atan(10.0))), "f_yr": 6.0}),
    # 0.8 and 0.9 of the axle loads 2 kg g l_r / l and 2 kg g l_f / l
    Law("grip", {"k": 0.2}, {"alpha": 0.125},
        {"f_yf": 0.96 * 2.0 * G * 0.1 / 0.18 * math.sin(0.2 * math.pi),
         "f_yr": 1.08 * 2.0 * G * 0.08 / 0.18 * math.sin(math.atan(1.375))}, "axle"),
    Law("front_grip", {"k": 0.2}, {"alpha": 0.125},
        {"f_yf": 0.96 * 2.0 * G * 0.1 / 0.18 * math.sin(0.2 * math.pi),
         "f_yr": 0.9 * 2.0 * G * 0.08 / 0.18 * math.sin(math.atan(1.375))}, "axle"),
    # m (1 + k) and the centre of mass move the axle loads where the tyres know them, no others
    Law("mass", {"k": 0.25}, {"alpha": 0.125},
        {"f_yf": 0.8 * 2.5 * G * 0.1 / 0.18 * math.sin(0.2 * math.pi),
         "f_yr": 0.9 * 2.5 * G * 0.08 / 0.18 * math.sin(math.atan(1.375))}, "axle"),
    Law("mass", {"k": 0.25}, {"alpha": -0.0625},
        {"f_yf": -3.0 * math.sin(0.7 * math.atan(4.0 - 0.75 * math.pi)), "f_yr": -1.25}),
    Law("centre_of_mass", {"k": 0.02}, {"alpha": 0.125},
        {"f_yf": 0.8 * 2.0 * G * 0.12 / 0.18 * math.sin(0.2 * math.pi),
         "f_yr": 0.9 * 2.0 * G * 0.06 / 0.18 * math.sin(math.atan(1.375))}, "axle"),
    Law("centre_of_mass", {"k": 0.02}, {"alpha": -0.0625},
        {"f_yf": -3.0 * math.sin(0.7 * math.atan(4.0 - 0.75 * math.pi)), "f_yr": -1.25}),
)

LAWS = COMMAND_LAWS + SENSORS + FORCE_LAWS + PARAMETER_LAWS + QUANTITY_LAWS
