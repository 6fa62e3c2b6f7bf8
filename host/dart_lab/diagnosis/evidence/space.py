"""What may move while a cause is tested: base parameters, effects found so far, and nuisances.

Nuisances are of the recordings and not of the car: how old a sensor message is
when it is stamped, and how long before its message a command was already
acting: a little more at one message and a little less at the next, which
blurs a step as a lag does. A gyro is read a little earlier or later than an
encoder; and where commands keep step with messages, smoothing moves a yaw rate
by as much. Within what nuisances may do nothing is named.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.flat import unchecked, unit, value
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.shooting.coordinates import Coordinates

from ..policy import USUAL, PriorPolicy

LATE, LATE_REACH, LATE_SPREAD = 0.007, 0.0115, 0.008
"""s; age of a message at its stamp, beside mocap: the promptest arrival still waits for its line
and for the next row, up to 10 ms. At most LATE_REACH from LATE, usually LATE_SPREAD."""
POSES_LATE = -0.007
"""s; the same in a run of our own, whose messages have no age: there poses are late instead, 3 to
15 ms by an optical system, and not at all where that was calibrated. As far to both sides."""
APART_REACH, APART_SPREAD = 0.008, 0.004
"""s; between gyro and encoder, at most and usually: half of what the smoothing reaches."""
MAX_COMMAND_AGE = 0.100  # s; commands are logged with the next message, up to this late
COMMAND_AGE_STEP = 0.020  # s; of one step of a fit
STEP = 1e-3  # of the prior, one-sided
TIMING_STEP, READING_STEP = 4e-3, 5e-4
"""s, both sides: what is held has no slope below its grid; a reading bends within milliseconds, and
a slope over more of it leads a fit beside the best."""
TIMES = 4  # numbers of a Timing
EDGE = 1e-6  # of a prior standard deviation; a fit that is nearer to a bound is on it
NONE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Timing:
    """late: age of a sensor message at its stamp [s]; command_age: of a command, before its
    message, anywhere within ``spread`` of it; gyro: how much older it is than the encoder."""

    late: float = LATE
    command_age: float = 0.0
    spread: float = 0.0
    gyro: float = 0.0

    def advanced(self, p: Vehicle) -> Vehicle:
        """The vehicle with delays counted from the messages of its commands."""
        d = p.delay
        return unchecked(p, {"delay": {"steering_s": d.steering_s - self.command_age,
                                       "throttle_s": d.throttle_s - self.command_age}})


EXACT = Timing(late=0.0)
"""Nothing is late and nothing ahead."""


class Space:
    """Points x (k,) in prior standard deviations: parameters by name, then those of ``Timing``.

    Spread as a share of what it can be: no command is younger than its message.
    """

    def __init__(self, p: Vehicle, free: Sequence[str],
                 known: Mapping[str, float] = NONE, late: float = LATE,
                 policy: PriorPolicy = USUAL.prior, loose: Collection[str] = (),
                 fixed_effects: Collection[str] = ()) -> None:
        """free: names of base parameters; those of the effects of p are free as well, whether they
        are among them or not, except those of fixed_effects (names of effects).

        late: what the age of the messages is expected to be [s]. loose: known ones that may go
        further than is believed; the prior pulls at them as at all others.
        """
        self._late, self.loose = late, tuple(loose)
        effects = {f"{a.name}.{q.name}": q for a in p.effects if a.name not in fixed_effects
                   for q in a.effect.parameters}
        self.names = tuple(dict.fromkeys((*free, *effects)))
        amounts = {n: policy.effect_width * q.sizes[1] for n, q in effects.items()}
        # with mocap the age of a message moves readings alone, without it commands as well
        own = (READING_STEP if late else TIMING_STEP, TIMING_STEP, TIMING_STEP, READING_STEP)
        self._timed = (*(TIMING_STEP if unit(p, n) == "s" else 0.0 for n in self.names), *own)
        self._inner = Coordinates(p, self.names, known, amounts)
        ends = (np.array([-1.0, 0.0, 0.0, -1.0]), np.array(
            [1.0, MAX_COMMAND_AGE / LATE_REACH, 1.0, 1.0]))
        # beyond what is believed, something else must be the cause
        reach = np.array([policy.believed if n in known and n not in loose else np.inf
                          for n in self.names])
        self.low = np.concatenate([np.maximum(self._inner.low, -reach), ends[0]])
        self.high = np.concatenate([np.minimum(self._inner.high, reach), ends[1]])

    def __len__(self) -> int:
        return len(self.low)

    def strained(self, x: FloatArray, believed: float) -> tuple[str, ...]:
        """Names of what goes as far at x as is believed of it, and would go further."""
        return tuple(n for n, at, low, high in zip(self.names, x, self.low, self.high, strict=False)
                     if believed in (-low, high) and believed - abs(at) < EDGE)

    @property
    def pull(self) -> FloatArray:
        """(k,) how hard the prior pulls to 0; not at all at the age of commands: it has bounds."""
        return np.concatenate([np.ones(len(self.names)), [
            (LATE_REACH / LATE_SPREAD)**2, 0.0, 0.0, (APART_REACH / APART_SPREAD)**2]])

    @property
    def reach(self) -> FloatArray:
        """(k,) how far one step may go: commands change in steps and ramps, and how well an age
        suits them has more than one best."""
        return np.concatenate([np.full(len(self.names), np.inf),
                               [np.inf, COMMAND_AGE_STEP / LATE_REACH, np.inf, np.inf]])

    def split(self, x: FloatArray) -> tuple[Vehicle, Timing]:
        """The vehicle and the timing at a point."""
        n = len(self.names)
        age = float(x[n + 1] * LATE_REACH)
        return self._inner.vehicle(x[:n]), Timing(
            float(self._late + x[n] * LATE_REACH), age, float(x[n + 2]) * widest(age),
            float(x[n + 3]) * APART_REACH)

    def point(self, timing: Timing) -> FloatArray:
        """The base with that timing."""
        return np.concatenate([np.zeros(len(self.names)), self._ends(timing)])

    def start(self, vehicle: Vehicle, timing: Timing) -> FloatArray:
        """The point of a vehicle that differs from the base in what is free."""
        inner = self._inner.find(np.array([value(vehicle, n) for n in self.names]))
        return np.asarray(np.clip(np.concatenate([inner, self._ends(timing)]), self.low, self.high))

    def carried(self, x: FloatArray, other: Space, y: FloatArray) -> FloatArray:
        """The point x with what is also in another space as it is at y there, timing included."""
        out = x.copy()
        for i, name in enumerate(other.names):
            if name in self.names:
                out[self.names.index(name)] = y[i]
        out[len(self.names):] = y[len(other.names):]
        return np.asarray(np.clip(out, self.low, self.high))

    def steps(self, x: FloatArray) -> list[tuple[float, float]]:
        """(up, down) by which each coordinate is varied for its derivative, within bounds."""
        out = []
        n = len(self.names)
        blur = 0.5 * widest(x[n + 1] * LATE_REACH)  # steps twice as wide: a narrow one does nothing
        widths = (LATE_REACH, LATE_REACH, max(blur, TIMING_STEP), APART_REACH)
        for i in range(len(self)):
            timed = self._timed[i]
            width = widths[i - n] if i >= n else self._inner.width(i)
            size = timed / width if timed else STEP
            up = min(size, self.high[i] - x[i])
            down = min(size, x[i] - self.low[i]) if timed or up < size else 0.0
            out.append((float(up), float(down)))
        return out

    def standard_errors(self, x: FloatArray, covariance: FloatArray) -> dict[str, float]:
        """By name in SI units, from a covariance (k, k) of x."""
        n = len(self.names)
        sizes = np.sqrt(np.maximum(np.diag(covariance)[:n], 0.0)) * self._inner.slope(x[:n])
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def _ends(self, timing: Timing) -> FloatArray:
        late, age = (timing.late - self._late) / LATE_REACH, timing.command_age / LATE_REACH
        return np.array([late, age, timing.spread / max(widest(timing.command_age), 1e-9),
                         timing.gyro / APART_REACH])


def widest(age: float) -> float:
    """How far ages of commands may spread around their mean [s], between 0 and the maximum."""
    return max(min(age, MAX_COMMAND_AGE - age), 0.0)
