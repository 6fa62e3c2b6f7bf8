"""Cars with something that no effect of the catalogue describes, driven like the hidden ones."""

from __future__ import annotations

import numpy as np

from dart_hal.vehicle import PAPER
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read

SIMULATION_STEP = 0.002  # s
MASS = PAPER.body.mass
INERTIA = PAPER.body.yaw_inertia


def carpet(newton):
    """More drag on the half of the room where x > 0."""
    def force(x, y, eta, vx, vy, om, tau, delta):
        return (-newton * np.tanh(vx / 0.1) if x > 0 else 0.0), 0.0, 0.0
    return push_car(force)


def cogging(newton):
    """Motor force that rises and falls with the speed: a resonance of the drive train."""
    def force(x, y, eta, vx, vy, om, tau, delta):
        return newton * np.exp(-((vx - 1.6) / 0.25)**2), 0.0, 0.0
    return push_car(force)


def rubs_to_the_left(newton):
    """A wheel that touches the body when it is turned to the left."""
    def force(x, y, eta, vx, vy, om, tau, delta):
        return (-newton * np.tanh(vx / 0.1) if delta > 0.05 else 0.0), 0.0, 0.0
    return push_car(force)


def wind(newton):
    """A wind across the room that blows only where y > 0."""
    def force(x, y, eta, vx, vy, om, tau, delta):
        f = newton if y > 0 else 0.0
        return f * np.cos(eta), -f * np.sin(eta), 0.0
    return push_car(force)


def out_of_round(newton):
    """A wheel with a flat that is met once in a metre."""
    def wrap(step, dt):
        way = [0.0]

        def changed_step(*now):
            x, y, eta, vx, vy, om = step(*now)
            way[0] += vx * dt
            return (x, y, eta, vx + newton * np.sin(2.0 * np.pi * way[0]) / MASS * dt, vy, om)
        return changed_step
    return wrap


def torque_steer(rad):
    """The motor turns the wheels: by ``rad`` at a tenth of full throttle."""
    return steer_by(lambda vx, tau, delta: delta + rad * (tau - 0.2) / 0.1)


def soft_at_speed(share):
    """Wheels that turn less the faster the car goes."""
    return steer_by(lambda vx, tau, delta: delta * (1.0 - share * (vx - 1.5)))


def push_car(force):
    def wrap(step, dt):
        def changed_step(*now):
            fx, fy, mz = force(*now)
            x, y, eta, vx, vy, om = step(*now)
            return x, y, eta, vx + fx / MASS * dt, vy + fy / MASS * dt, om + mz / INERTIA * dt
        return changed_step
    return wrap


def steer_by(angle):
    def wrap(step, dt):
        def changed_step(x, y, eta, vx, vy, om, tau, delta):
            return step(x, y, eta, vx, vy, om, tau, float(angle(vx, tau, delta)))
        return changed_step
    return wrap


STRANGE_CARS = {
    # name: (car of a medium size, channels in which it must show, a variable that must be named)
    "carpet": (carpet(0.3), {"v_x"}, {"x"}),
    "cogging": (cogging(0.4), {"v_x"}, {"speed", "throttle"}),
    "rubs_to_the_left": (rubs_to_the_left(0.3), {"v_x"},
                         {"steering_angle", "direction", "lateral_acceleration"}),
    "wind": (wind(0.3), {"v_x", "v_y"}, {"heading", "x", "y"}),
    "out_of_round": (out_of_round(0.3), {"v_x"}, {"way"}),
    "torque_steer": (torque_steer(0.02), {"omega", "v_y"}, {"throttle", "speed"}),
    "soft_at_speed": (soft_at_speed(0.15), {"omega", "v_y"},
                      {"steering_angle", "direction", "lateral_acceleration"}),
}


def write(path, wrap, seed, plan, monkeypatch):
    """A recording of such a car; wrap None: of the model itself."""
    make = hidden_drive.make_native_step
    if wrap is not None:
        monkeypatch.setattr(hidden_drive, "make_native_step",
                            lambda p, kind, dt: wrap(make(p, kind, dt), dt))
    hidden_drive.write(path, PAPER, seed, plan)
    monkeypatch.setattr(hidden_drive, "make_native_step", make)
    return path


def looked_at(paths, p=PAPER):
    """(evidence, p, residuals, noise) for ``unexplained``; the ages of messages and of commands,
    which are nothing that a car has, are fitted first."""
    evidence = Evidence([prepare_drive(read(path), p.body.l_r) for path in paths], p.body.l_r)
    noise = estimate_noise(evidence.residuals(p), evidence.blocks())
    ages = np.zeros(2)
    for _ in range(3):
        tried = [MessageTiming(*(ages + by)) for by in ((0.0, 0.0), (SIMULATION_STEP, 0.0),
                                                        (0.0, SIMULATION_STEP))]
        here, *there = (np.clip(noise.stack(evidence.residuals(p, t))[0], -5, 5) for t in tried)
        slopes = np.stack([(other - here) / SIMULATION_STEP for other in there], axis=1)
        ages = np.clip(ages - np.linalg.lstsq(slopes, here, rcond=None)[0], -0.02, 0.1)
    residuals = evidence.residuals(p, MessageTiming(*ages))
    return evidence, p, residuals, estimate_noise(residuals, evidence.blocks())
