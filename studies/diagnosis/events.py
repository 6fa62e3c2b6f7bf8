"""Events that come at times of their own, for a simulated car: gusts, a lifted axle, lost commands.

Each function hangs a hook on a ``Car``; the same seed gives the same events in every drive.
"""

from __future__ import annotations

import math

import numpy as np

from studies.diagnosis.stranger import SIDE_REAR, Car, Now, X, Y

MESSAGE = 0.1
"""s from one command message to the next."""


def add_gusts(car: Car, newton: float, seed: int) -> np.ndarray:
    """Add wind of one second from anywhere, every 4 to 10 s. Returns when each gust begins [s]."""
    rng = np.random.default_rng(seed)
    begins = np.cumsum(rng.uniform(4.0, 10.0, size=20))
    angles = rng.uniform(0.0, 2.0 * math.pi, size=20)

    def act(f: list[float], now: Now) -> None:
        for begin, angle in zip(begins, angles, strict=True):
            if begin <= now.t < begin + 1.0:
                f[X] += newton * math.cos(now.yaw - angle)
                f[Y] -= newton * math.sin(now.yaw - angle)

    car.force.append(act)
    return begins


def lift_rear_axle(car: Car, share: float, seed: int) -> None:
    """Reduce the grip of the rear axle for 0.4 s, at some moments of large lateral force."""
    rng = np.random.default_rng(seed)
    until, last = [-1.0], [-10.0]

    def act(f: list[float], now: Now) -> None:
        if now.t < 0.01:
            until[0], last[0] = -1.0, -10.0
        if abs(now.ay) > 2.5 and now.t > last[0] + 2.0 and rng.random() < 0.01:
            until[0], last[0] = now.t + 0.4, now.t
        if now.t < until[0]:
            f[SIDE_REAR] *= 1.0 - share

    car.force.append(act)


def lose_commands(car: Car, share: float, seed: int) -> None:
    """Lose a share of the messages: the steering keeps the command before for one more message."""
    lost = np.random.default_rng(seed).random(4000) < share
    held = [0.0]

    def act(command: float, now: Now) -> float:
        if now.t < 0.01 or not lost[int(now.t / MESSAGE)]:
            held[0] = command
        return held[0]

    car.steer.append(act)
