"""Coordinates of a fit: parameters of the model, sizes of its effects, and the timing.

The timing belongs to the recordings and not to the car:

- the age of a sensor message at its stamp;
- the time from a command to the message that logs it, and its spread from message to message,
  which blurs a step as a lag does;
- how much older a gyro reading is than one of the encoder. Where commands are synchronous with
  messages, smoothing shifts the yaw rate by a similar time.

Every fit estimates the timing too, so an effect is accepted only beyond what it can explain.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dart_hal.core.config.model import Covariance
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.flat import replace_unchecked, unit, value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale

from .coordinates import Coordinates
from .policy import USUAL_PRIOR, PriorPolicy

# Relative to mocap, even the fastest message waits for its line and for the next row, up to 10 ms.
MESSAGE_AGE = 0.007  # s; expected age of a message at its stamp, with motion capture
MESSAGE_AGE_REACH = 0.0115  # s; largest deviation from the expected age
MESSAGE_AGE_STD = 0.008  # s; prior standard deviation of the age
# Messages of a run have no age. Poses are late instead, 3 to 15 ms by an optical system, and not at
# all after a calibration of their delay.
RUN_MESSAGE_AGE = -0.007  # s; the expected age in a run
# Half of the time over which the yaw rate is smoothed.
GYRO_AGE_REACH = 0.008  # s; largest age of the gyro relative to the encoder
GYRO_AGE_STD = 0.004  # s; its prior standard deviation
MAX_COMMAND_AGE = 0.100  # s; commands are logged with the next message, up to this late
COMMAND_AGE_STEP = 0.020  # s; largest step of a fit
PRIOR_STEP = 1e-3  # prior standard deviations; one-sided difference for a derivative
# Commands are held from sample to sample, so a smaller step gives no slope.
TIMING_STEP = 4e-3  # s; two-sided difference for delays and ages of commands
# A reading bends within milliseconds: a slope over a longer time misses the minimum.
READING_STEP = 5e-4  # s; two-sided difference for ages of readings
BOUND_TOLERANCE = 1e-6  # prior standard deviations; a fit that is nearer to a bound is on it
NO_STANDARD_ERRORS: Mapping[str, float] = MappingProxyType({})
# Added to the diagonal of correlations. A real car differs from its model, so a combination of its
# parameters is not known as well as a fit states: with 1e-3 the log of another car got yaw_inertia
# as a cause, with .05, .2 and .5 none.
CORRELATION_ERROR = 0.05


@dataclass(frozen=True, slots=True)
class MessageTiming:
    """Times of messages relative to what they report [s].

    message_age: age of a sensor message at its stamp; command_age: mean time from a command to its
    message; age_spread: largest deviation from that mean; gyro_age: how much older the gyro
    reading is than that of the encoder.
    """

    message_age: float = MESSAGE_AGE
    command_age: float = 0.0
    age_spread: float = 0.0
    gyro_age: float = 0.0

    def shift_delays(self, p: Vehicle) -> Vehicle:
        """Return the vehicle with delays counted from the messages of its commands."""
        d = p.delay
        return replace_unchecked(p, {"delay": {"steering_s": d.steering_s - self.command_age,
                                       "throttle_s": d.throttle_s - self.command_age}})


# Readings and commands act at the stamp of their message.
NO_DELAY = MessageTiming(message_age=0.0)


class Space:
    """Points x (k,): parameters by name in prior standard deviations, then the timing.

    Ages are in units of their reach (``MESSAGE_AGE_REACH``, ``GYRO_AGE_REACH``). The spread of the
    command age is a fraction of the largest possible one, because no command is younger than its
    message.
    """

    def __init__(self, p: Vehicle, free: Sequence[str],
                 known: Mapping[str, float] = NO_STANDARD_ERRORS, message_age: float = MESSAGE_AGE,
                 policy: PriorPolicy = USUAL_PRIOR, loose: Collection[str] = (),
                 fixed_effects: Collection[str] = (), joint: Covariance | None = None) -> None:
        """Set coordinates and bounds.

        free: names of base parameters; the parameters of the effects of p are free as well, except
        those of fixed_effects (names of effects). known: standard errors of base parameters.
        message_age: expected age of the messages [s]. loose: known parameters without a bound;
        their prior stays. joint: covariance of known parameters, for their correlations; None:
        they are independent.
        """
        self._message_age = message_age
        self.loose = tuple(loose)
        scale = find_scale(p.body)
        effects = {f"{a.name}.{q.name}": q.at_scale(scale) for a in p.effects
                   if a.name not in fixed_effects for q in a.effect.parameters}
        self.names = tuple(dict.fromkeys((*free, *effects)))
        amounts = {n: policy.effect_width * q.sizes[1] for n, q in effects.items()}
        # With mocap the age of a message shifts only readings, without it commands as well.
        # Its step must then be long enough to change held commands.
        of_ages = (READING_STEP if message_age else TIMING_STEP, TIMING_STEP, TIMING_STEP,
                   READING_STEP)
        of_parameters = (TIMING_STEP if unit(p, n) == "s" else 0.0 for n in self.names)
        self._timing_step = (*of_parameters, *of_ages)
        self._inner = Coordinates(p, self.names, known, amounts)
        timing_low = np.array([-1.0, 0.0, 0.0, -1.0])
        timing_high = np.array([1.0, MAX_COMMAND_AGE / MESSAGE_AGE_REACH, 1.0, 1.0])
        # A parameter further from its stated value than this has another cause.
        reach = np.array([policy.max_stated_stds if n in known and n not in loose else np.inf
                          for n in self.names])
        self.low = np.concatenate([np.maximum(self._inner.low, -reach), timing_low])
        self.high = np.concatenate([np.minimum(self._inner.high, reach), timing_high])
        self.prior_precision = self._find_prior_precision(known, joint)

    def __len__(self) -> int:
        return len(self.low)

    def names_at_bound(self, x: FloatArray, believed: float) -> tuple[str, ...]:
        """Return the parameters that are at x on their bound of ``believed`` standard errors."""
        return tuple(n for n, xi, low, high in zip(self.names, x, self.low, self.high, strict=False)
                     if believed in (-low, high) and believed - abs(xi) < BOUND_TOLERANCE)

    def _find_prior_precision(self, known: Mapping[str, float], joint: Covariance | None
                              ) -> FloatArray:
        """Return the matrix P (k, k) of the prior's loss x^T P x.

        It is 1 for a parameter by itself, and the inverse of the stated correlations for known
        ones; those of them that are not free are at their stated values. It is 0 for age and spread
        of commands, which have bounds.
        """
        n = len(self.names)
        out = np.diag(np.concatenate([np.ones(n), [
            (MESSAGE_AGE_REACH / MESSAGE_AGE_STD)**2, 0.0, 0.0,
            (GYRO_AGE_REACH / GYRO_AGE_STD)**2]]))
        stated = [name for name in (joint.names if joint else ()) if known.get(name, 0.0) > 0.0]
        free = [name for name in stated if name in self.names]
        place = [self.names.index(name) for name in free]
        mine = [stated.index(name) for name in free]
        precision = np.linalg.inv(self.stated_correlation(stated, joint))
        out[np.ix_(place, place)] = precision[np.ix_(mine, mine)]
        return out

    @property
    def prior_root(self) -> FloatArray:
        """Return the matrix U (k, k) with U^T U = P."""
        n = len(self.names)
        out = np.sqrt(np.diag(np.diag(self.prior_precision)))
        out[:n, :n] = np.linalg.cholesky(self.prior_precision[:n, :n]).T
        return out

    def stated_correlation(self, names: Sequence[str], joint: Covariance | None) -> FloatArray:
        """Return the correlations (k, k) of coordinates by a covariance of their parameters.

        0 where it has none; with ``CORRELATION_ERROR`` on the diagonal.
        """
        out = (1.0 + CORRELATION_ERROR) * np.eye(len(names))
        listed = joint.names if joint else ()
        shared = [i for i, name in enumerate(names) if name in listed]
        if joint and shared:
            rows = [listed.index(names[i]) for i in shared]
            covariance = np.array(joint.matrix)[np.ix_(rows, rows)]
            # A coordinate rises while a negative parameter falls.
            std = np.sqrt(np.diag(covariance)) * [
                self._inner.directions.get(names[i], 1.0) for i in shared]
            known = std != 0.0
            there = np.array(shared, dtype=np.int64)[known]
            out[np.ix_(there, there)] = (covariance[np.ix_(known, known)]
                                         / np.outer(std[known], std[known])
                                         + CORRELATION_ERROR * np.eye(len(there)))
        return out

    @property
    def max_step(self) -> FloatArray:
        """Largest change (k,) in one step of a fit.

        Commands change in steps and ramps, so the loss has several minima over their age.
        """
        return np.concatenate([np.full(len(self.names), np.inf),
                               [np.inf, COMMAND_AGE_STEP / MESSAGE_AGE_REACH, np.inf, np.inf]])

    def split(self, x: FloatArray) -> tuple[Vehicle, MessageTiming]:
        """Return the vehicle and the timing at a point."""
        n = len(self.names)
        age = float(x[n + 1] * MESSAGE_AGE_REACH)
        return self._inner.vehicle(x[:n]), MessageTiming(
            float(self._message_age + x[n] * MESSAGE_AGE_REACH), age,
            float(x[n + 2]) * max_age_spread(age), float(x[n + 3]) * GYRO_AGE_REACH)

    def point(self, timing: MessageTiming) -> FloatArray:
        """Return the point of the base vehicle with a timing."""
        return np.concatenate([np.zeros(len(self.names)), self._timing_coordinates(timing)])

    def start(self, vehicle: Vehicle, timing: MessageTiming) -> FloatArray:
        """Return the point of a vehicle that differs from the base in free parameters."""
        inner = self._inner.find(np.array([value(vehicle, n) for n in self.names]))
        return np.asarray(np.clip(np.concatenate([inner, self._timing_coordinates(timing)]),
                                  self.low, self.high))

    def transfer(self, x: FloatArray, other: Space, y: FloatArray) -> FloatArray:
        """Return x with the shared parameters and the timing of a point y in another space."""
        out = x.copy()
        for i, name in enumerate(other.names):
            if name in self.names:
                out[self.names.index(name)] = y[i]
        out[len(self.names):] = y[len(other.names):]
        return np.asarray(np.clip(out, self.low, self.high))

    def steps(self, x: FloatArray) -> list[tuple[float, float]]:
        """Return (up, down), the differences of each coordinate for its derivative, in bounds."""
        out = []
        n = len(self.names)
        # The spread is varied by at least the step that changes the held commands.
        blur = 0.5 * max_age_spread(x[n + 1] * MESSAGE_AGE_REACH)
        widths = (MESSAGE_AGE_REACH, MESSAGE_AGE_REACH, max(blur, TIMING_STEP), GYRO_AGE_REACH)
        for i in range(len(self)):
            timed = self._timing_step[i]
            width = widths[i - n] if i >= n else self._inner.width(i)
            size = timed / width if timed else PRIOR_STEP
            up = min(size, self.high[i] - x[i])
            down = min(size, x[i] - self.low[i]) if timed or up < size else 0.0
            out.append((float(up), float(down)))
        return out

    def standard_errors(self, x: FloatArray, covariance: FloatArray) -> dict[str, float]:
        """Return standard errors in SI units by name, from a covariance (k, k) of x."""
        n = len(self.names)
        sizes = np.sqrt(np.maximum(np.diag(covariance)[:n], 0.0)) * self._inner.slope(x[:n])
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def correlation(self, names: Sequence[str], covariance: FloatArray) -> FloatArray:
        """Return the correlations (n, n) of parameters, from a covariance (k, k) of x."""
        rows = [self.names.index(name) for name in names]
        part = covariance[np.ix_(rows, rows)]
        std = np.sqrt(np.diag(part)) * [self._inner.directions[name] for name in names]
        return np.asarray(part / np.outer(std, std))

    def _timing_coordinates(self, timing: MessageTiming) -> FloatArray:
        """Return the last coordinates of a point with this timing."""
        return np.array([(timing.message_age - self._message_age) / MESSAGE_AGE_REACH,
                         timing.command_age / MESSAGE_AGE_REACH,
                         timing.age_spread / max(max_age_spread(timing.command_age), 1e-9),
                         timing.gyro_age / GYRO_AGE_REACH])


def max_age_spread(age: float) -> float:
    """Return how far ages of commands may deviate from their mean [s], within their bounds."""
    return max(min(age, MAX_COMMAND_AGE - age), 0.0)
