"""What is in no catalogue: causes far from every entry, and near relatives of some.

``FAR``: must end as unexplained, under no other name. ``NEAR``: the same physics
as a catalogue entry in another functional form; ``FAMILY`` says which names are
then an honest answer. Sizes of ``FAR`` disturb as much as a steering lag of medium
size, see ``out_of_catalogue_sizes.py``; those of ``NEAR`` about as much as their relative.
"""

from __future__ import annotations

import math

import numpy as np

from studies.diagnosis.near_relatives import FAMILY, NEAR
from studies.diagnosis.stranger import MOMENT, SIDE_FRONT, SIDE_REAR, Car, H, Now, Truth, X, Y
from studies.diagnosis.stranger_causes import Cause

__all__ = ["FAMILY", "FAR", "NEAR"]


def carpet(car: Car, k: float) -> None:
    """A piece of carpet on the floor, 2.4 m by 2.4 m: it brakes by k [N]."""
    def act(f: list[float], now: Now) -> None:
        if 0.0 < now.x < 2.4 and -1.2 < now.y < 1.2 and now.v > 0.05:
            f[X] -= k

    car.force.append(act)


def slippery_half(car: Car, k: float) -> None:
    """Half of the hall was polished: side forces are k smaller there."""
    def act(f: list[float], now: Now) -> None:
        if now.y > 0.0:
            f[SIDE_FRONT] *= 1.0 - k
            f[SIDE_REAR] *= 1.0 - k

    car.force.append(act)


def torque_steer(car: Car, k: float) -> None:
    """Drive shafts of unequal length: k [rad/N] of steering for what the motor pulls."""
    car.angle.append(lambda u, now: u + k * (now.motor - 2.2))


def wheel_periodic(car: Car, k: float) -> None:
    """A bump on a gear that turns once in a metre: a force of k [N] with the way."""
    def act(f: list[float], now: Now) -> None:
        f[X] += k * math.sin(2 * math.pi * now.way)

    car.force.append(act)


def resonance(car: Car, k: float) -> None:
    """The shell rattles between 1.0 and 1.3 m/s and takes k [N]."""
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * math.exp(-((now.v - 1.15) / 0.12)**2)

    car.force.append(act)


def sticky_throttle(car: Car, k: float) -> None:
    """The ESC keeps its duty until the command has moved by more than k."""
    held = [0.0]

    def act(u: float, now: Now) -> float:
        if abs(u - held[0]) > k or u == 0.0:
            held[0] = u
        return held[0]

    car.gas.append(act)


def hot_motor(car: Car, k: float) -> None:
    """Warms with the square of its force, gives up to k less above a temperature."""
    heat = [0.0]

    def warm(now: Now) -> None:
        heat[0] += H / 12.0 * ((now.motor / 3.0)**2 - heat[0])

    car.step.append(warm)
    car.motor.append(lambda f, now: f * (1.0 - k / (1.0 + math.exp(-(heat[0] - 0.6) / 0.08))))


def wind(car: Car, k: float) -> None:
    """A fan that turns to and fro in 9 s blows k [N] along x of the room, two seconds long."""
    def act(f: list[float], now: Now) -> None:
        if now.t % 9.0 < 2.0:
            f[X] += k * math.cos(now.yaw)
            f[Y] -= k * math.sin(now.yaw)

    car.force.append(act)


def speedy_steering(car: Car, k: float) -> None:
    """A program turns the wheels less the faster it goes, above 0.9 m/s."""
    car.steer.append(lambda u, now: u * (1.0 - k * max(now.v - 0.9, 0.0)))


def left_drag(car: Car, k: float) -> None:
    """A wheel rubs on the shell when turned to the left: k [N]."""
    def act(f: list[float], now: Now) -> None:
        if now.angle > 0.12 and now.v > 0.05:
            f[X] -= k

    car.force.append(act)


def compass_gyro(car: Car, k: float) -> None:
    """A fusion with the compass of a hall of steel: k [rad/s] twice around the heading."""
    car.gyro.append(lambda w, truth: w + k * np.sin(2.0 * truth.yaw + 0.4))


def dead_gyro(car: Car, k: float) -> None:
    """Turning rates below k [rad/s] are taken for standing still."""
    car.gyro.append(lambda w, truth: np.where(np.abs(w) < k, 0.0, w))


def losing_counts(car: Car, k: float) -> None:
    """Interrupts are missed above 1.2 m/s: the share k of what is beyond."""
    car.wheel.append(lambda v, truth: v - k * np.maximum(v - 1.2, 0.0))


def late_left(car: Car, k: float) -> None:
    """A servo that is k [s] later on its way to the left than to the right."""
    queue: list[float] = []
    out = [0.0]

    def act(u: float, now: Now) -> float:
        queue.append(u)
        old = queue.pop(0) if len(queue) > round(k / H) else queue[0]
        out[0] = old if u > out[0] else u
        return out[0]

    car.steer.append(act)


def crosstalk(car: Car, k: float) -> None:
    """Throttle leaks into the steering: k of what it is beyond cruising."""
    car.steer.append(lambda u, now: u + k * (now.gas - 0.26))


def brown_out(car: Car, k: float) -> None:
    """A fast servo draws the supply down: for 0.25 s the motor gives k less."""
    last, until = [0.0], [-1.0]

    def watch(now: Now) -> None:
        if abs(now.steer - last[0]) > 0.25:
            until[0] = now.t + 0.25
        last[0] += (now.steer - last[0]) * H / 0.05

    car.step.append(watch)
    car.motor.append(lambda f, now: f * (1.0 - k) if now.t < until[0] else f)


def warming_tyres(car: Car, k: float) -> None:
    """Grip grows by k within half a minute and falls back at the next rest."""
    def act(f: list[float], now: Now) -> None:
        more = k * (1.0 - 2.0 * math.exp(-(now.t % 40.0) / 12.0))
        f[SIDE_FRONT] *= 1.0 + more
        f[SIDE_REAR] *= 1.0 + more

    car.force.append(act)


def shaken_gyro(car: Car, k: float) -> None:
    """The gyro feels acceleration: k [rad/s per m/s2] to the side."""
    car.gyro.append(lambda w, truth: w + k * truth.ax)


def hopping_rear(car: Car, k: float) -> None:
    """The rear axle hops for a moment when a push of the motor comes suddenly."""
    slow, hop = [0.0], [0.0]

    def watch(now: Now) -> None:
        slow[0] += (now.motor - slow[0]) * H / 0.3
        hop[0] = min(abs(now.motor - slow[0]) / 1.0, 1.0)

    def act(f: list[float], now: Now) -> None:
        f[SIDE_REAR] *= 1.0 - k * hop[0]
        f[MOMENT] += 0.02 * k * hop[0]

    car.step.append(watch)
    car.force.append(act)


def magnet_floor(car: Car, k: float) -> None:
    """Cables under the floor pull the encoder along: k [relative] by stripes of 1.5 m."""
    def act(v: np.ndarray, truth: Truth) -> np.ndarray:
        return v * (1.0 + k * np.sign(np.sin(2 * math.pi * truth.x / 1.5)))

    car.wheel.append(act)


FAR: dict[str, tuple[Cause, float]] = {
    "carpet": (carpet, 0.8), "slippery_half": (slippery_half, 0.19),
    "torque_steer": (torque_steer, 0.075), "wheel_periodic": (wheel_periodic, 0.54),
    "resonance": (resonance, 0.94), "sticky_throttle": (sticky_throttle, 0.042),
    "hot_motor": (hot_motor, 0.33), "wind": (wind, 0.98),
    "speedy_steering": (speedy_steering, 0.6), "left_drag": (left_drag, 0.63),
    "compass_gyro": (compass_gyro, 0.037), "dead_gyro": (dead_gyro, 0.34),
    "losing_counts": (losing_counts, 0.17), "late_left": (late_left, 0.087),
    "crosstalk": (crosstalk, 2.9), "brown_out": (brown_out, 0.41),
    "warming_tyres": (warming_tyres, 0.31), "shaken_gyro": (shaken_gyro, 0.075),
    "magnet_floor": (magnet_floor, 0.028), "hopping_rear": (hopping_rear, 0.71)}
