"""What the yaw rate does after one turn of the servo: slew, lag, linkage, tyres, gyro.

The servo turns at its slew at most and with its lag; the wheels follow the linkage, behind its
backlash where the turn before went the other way; the yaw rate follows the wheels as the tyres do
(linear bicycle), and the gyro shows it through its filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.types import FloatArray
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import PaperTyres, Vehicle

STEP, SPAN = 0.5e-3, 0.8
"""s of the grid of an answer, and how long it is: longer than a turn is held."""
BACKLASH = (0.02, 0.012)
"""rad, and one sigma, of a linkage that nobody has measured: 0.3 to 2 degrees."""
TYRES = 0.15
"""Relative, one sigma of the tyres' stiffness by a model of another car; 0.1 by its own."""
SHAPE, SHAPE_OTHERS = 0.005, 0.035
"""Relative, one sigma that the shape of a map leaves in the slew: of the car's own (fits with the
true maps of four hidden cars differ by 0.46 % rms); and of cars of its kind, of gains and ends
within 8 %."""
GYRO_HZ = 32.0
"""Hz of the BNO055's filter as the firmware sets it."""
KNOTS = 200
"""Of the steering map between the two ends of the turns."""
LAG, RATE, PLAY, GRIP = range(4)


@dataclass(frozen=True, slots=True)
class Linkage:
    """What is known of the steering: map, backlash and tyres, each with one sigma.

    shape: that of the map, relative, as it stands in the slew.
    """

    map: SteeringMap
    shape: float
    backlash: tuple[float, float]
    vehicle: Vehicle
    tyres: float


def linkage_of(files: CarFiles) -> Linkage:
    """By the car's own files, else by those of cars of its kind."""
    measured = files.calibration.steering if files.calibration else None
    play = measured.backlash if measured else None
    own = measured.map if measured else None
    return Linkage(steering_map(files.config, own), SHAPE_OTHERS if own is None else SHAPE,
                   BACKLASH if play is None else (play.value, max(play.std, 1e-3)),
                   vehicle_of(files.model), TYRES)


class Kind(NamedTuple):
    """A turn between two pulses [us]; reverses: the turn before went the other way."""

    before: float
    to: float
    reverses: bool


Answers = Callable[[tuple[float, float, float, float]], FloatArray]
"""(lag [s], slew [us/s], play [rad], stiffness) -> (k, n), see ``answers_of``."""


def answers_of(kinds: tuple[Kind, ...], linkage: Linkage, speed: float) -> Answers:
    """What the gyro shows of each kind of turn (k, n) at ``times()``: shares 0..1 of its change.

    speed [m/s]. The newest are remembered.
    """
    ends = [pulse for kind in kinds for pulse in kind[:2]]
    knots = np.linspace(min(ends), max(ends), KNOTS)
    curve = knots, np.array([linkage.map.angle(float(knot)) for knot in knots])
    tyres = lru_cache(maxsize=8)(lambda grip: _tyres(linkage.vehicle, grip, speed))

    @lru_cache(maxsize=8)
    def answers(p: tuple[float, float, float, float]) -> FloatArray:
        from scipy.signal import lfilter

        b, a = tyres(max(p[GRIP], 0.1))
        seen = -np.expm1(-2.0 * np.pi * GYRO_HZ * STEP)
        share = np.array([_share(kind, p, curve) for kind in kinds])
        return np.asarray(lfilter([seen], [1.0, seen - 1.0], lfilter(b, a, share)))

    return answers


def times() -> FloatArray:
    """Times [s] after the servo began to turn (n,)."""
    return np.arange(0.0, SPAN, STEP)


def _share(kind: Kind, p: tuple[float, float, float, float], curve: tuple[FloatArray, FloatArray]
           ) -> FloatArray:
    """Where the wheels are at ``times()``, as a share 0..1 of the curvature's change.

    curve: pulses [us] and their angles [rad] by the map. The wheels lie at one flank of the slot,
    and wait for the other where the turn reverses.
    """
    since, way = times(), abs(kind.to - kind.before)
    gone = np.minimum(p[RATE] * since, -way * np.expm1(-since / max(p[LAG], 1e-6)))
    turned = kind.before + np.sign(kind.to - kind.before) * gone
    angle = np.interp(turned, *curve)
    start, end = (float(np.interp(x, *curve)) for x in (kind.before, kind.to))
    up, half = np.sign(end - start), 0.5 * abs(p[PLAY])
    held = up * start + (half if kind.reverses else -half)
    way_of = np.tan(np.maximum(up * angle - half, held)) - np.tan(held)
    return np.asarray(way_of / (np.tan(up * end - half) - np.tan(held)))


def _tyres(p: Vehicle, grip: float, speed: float) -> tuple[FloatArray, FloatArray]:
    """Yaw rate by road-wheel angle as a filter of gain 1 at rest, step ``STEP``.

    Linear bicycle (``vehicle.bicycle``) with the tyres ``grip`` times as stiff.
    """
    from scipy.signal import cont2discrete, ss2tf

    body, front, rear = p.body, *(grip * c for c in stiffness(p))
    m, i, a, b = body.mass, body.yaw_inertia, body.l_f, body.l_r
    cross = b * rear - a * front
    matrix = np.array([[-(front + rear) / (m * speed), cross / (m * speed) - speed],
                       [cross / (i * speed), -(a * a * front + b * b * rear) / (i * speed)]])
    push = np.array([[front / m], [a * front / i]])
    gain = float((-np.linalg.solve(matrix, push))[1, 0])
    ad, bd, cd, dd, _ = cont2discrete((matrix, push, np.array([[0.0, 1.0 / gain]]),
                                       np.zeros((1, 1))), STEP)
    top, bottom = ss2tf(ad, bd, cd, dd)
    return np.asarray(top[0]), np.asarray(bottom)


def stiffness(p: Vehicle) -> tuple[float, float]:
    """Cornering stiffness of front and rear axle [N/rad] at small angles."""
    tyres = p.tyres
    if isinstance(tyres, PaperTyres):
        return (tyres.front_D * tyres.front_C * tyres.front_B, tyres.rear_cornering_stiffness)
    return (p.body.front_load * tyres.front_D * tyres.front_C * tyres.front_B,
            p.body.rear_load * tyres.rear_D * tyres.rear_C * tyres.rear_B)
