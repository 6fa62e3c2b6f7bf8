"""Does the encoder say what the car does? Against accelerometer and model.

    reference   v' = a_x + omega^2 x_imu, drawn to the encoder within LEAK:
                what changes faster than that must be felt as well
    low         the speed that the throttle explains at least
    free        the speed that even lifted wheels cannot pass

A reference above the encoder says that edges are missing, below it that the
wheels spin (the motor explains their speed) or that edges come from nowhere
(it does not). Silence while wheels must turn is a dead encoder.

Missing edges are the dangerous kind: a speed loop would open the throttle.
So ENCODER_LOW and ENCODER_DEAD stay until the car is disarmed and stands, or,
for a dead one, until edges come again; the others end by themselves.
"""

from __future__ import annotations

from math import copysign, hypot, inf

from dart_hal.core.types import Doubt
from dart_hal.estimation.bounds import SpeedBounds
from dart_hal.vehicle.parameters import Vehicle

LEAK, QUICK = 1.0, 0.2
"""s that a reference remembers. The long one sees edges that are missing from the start;
for the quick one an offset means little, so it sees a slow wheel fall silent."""
FRESH, AGES, DRIFT = 0.06, 0.04, 0.2
"""m/s2 of accelerometer that means nothing: right after its offset was learnt at rest
(0.3 deg of tilt), more for each second since (the fusion's vertical tilts under
acceleration), at most (1.2 deg). Times LEAK it is a difference of speeds."""
SIGMAS, STD_MOST = 2.0, 0.04
"""Of the encoder's own stated deviation, and m/s of it that count: uneven marks, age of a
pair. More only says that edges are missing, which is the question."""
LOST = 0.33
"""Share of the speed that must be gone for the quick reference: marks that fall out, not a
moment that two sensors place differently."""
GAIN = 0.12
"""Share of the change of speed: mounting within 3 deg, scale, filter, age of the pair."""
SIDEWAYS = 0.2
"""Share of the lateral acceleration that appears along the car: omega v_y at the rear axle
with 0.1 rad of slip, and 3 deg of mounting with 0.05 rad of roll."""
CLIPPED = 35.0
"""m/s2: the part ends at 39; what a crash was worth is unknown then."""
LATE = 0.025
"""s between the moments that encoder and accelerometer speak of: half a pair of edges and
its age (7 to 12 ms), filter and skew of the IMU. Times the acceleration."""
SOON = 0.1
"""s for which an acceleration counts in that."""
AGREES = 0.5
"""s of agreement that end ENCODER_HIGH and ENCODER_SLIPS."""
SILENCE = 0.3
"""s without an edge in which the model has to predict EDGES of them."""
EDGES = 5
"""Missing or invented, as travel: less is the coarseness of the marks, also at a start."""
BEHIND = 0.1, 0.3
"""m/s below ``low`` and s that it lasts: edges are missing."""
PUSHED = 3.0
"""m/s that a hand gives the car; faster edges at neutral are noise."""
TELLS = 0.3
"""s for which rejected edges are told."""
FREE = 1.3, 0.3
"""Share and m/s by which wheels may pass ``free``: the recorded car reaches 5.16 m/s at a
throttle of 0.9, where the paper's model of it ends at 4.1."""
DRIVEN = 1.0
"""s after the last throttle in which the accelerometer is asked: later a hand may carry it."""
RESTS = 1.0
"""s of standing, disarmed, after which the next drive judges anew."""
LEARN = 0.5
"""s: time constant of the accelerometer's offset at rest."""
MAX_OFFSET = 1.0
"""m/s2: 6 deg of tilt."""
FORGET = 5.0
"""s in which a reference that is contradicted fades."""


class Reference:
    """Speed [m/s] by the accelerometer, drawn to the encoder within ``leak`` s."""

    def __init__(self, leak: float) -> None:
        self._leak = leak
        self.set(0.0)

    def set(self, speed: float) -> None:
        """Begin anew from the encoder's speed."""
        self.value, self.gap, self.most = speed, 0.0, inf
        self._slack = 0.0

    def follow(self, speed: float, felt: float, unsure: float, drift: float, extra: float,
               doubted: bool, dt: float) -> None:
        """One frame: ``gap`` how much faster it is than the encoder, ``most`` what means nothing.

        felt, unsure, drift [m/s2]: acceleration, what of it may be wrong, and its
        offset; extra [m/s]: what the encoder's own speed may be wrong.
        """
        target = 0.0 if doubted else copysign(abs(speed), self.value)
        share = dt / (FORGET if doubted else self._leak)
        self.value += felt * dt + (target - self.value) * share
        self._slack += unsure * dt - self._slack * dt / self._leak
        self.gap = abs(self.value) - abs(speed)
        self.most = drift * self._leak + self._slack + extra


class EncoderCheck:
    """Judges the wheel speed frame by frame: ``doubts``, and ``std`` of what it may miss.

    metres: per edge; x_imu [m]: of the IMU ahead of the rear axle; identified:
    the vehicle is this car's own.
    """

    def __init__(self, vehicle: Vehicle, identified: bool, metres: float, x_imu: float) -> None:
        self.bounds = SpeedBounds(vehicle, identified)
        self._owing, self._x = EDGES * metres, x_imu
        self._offset = 0.0
        self._slow, self._quick = Reference(LEAK), Reference(QUICK)
        self.restart()

    def restart(self) -> None:
        """Another boot: nothing is held against it."""
        self.bounds.restart()
        self.doubts: frozenset[str] = frozenset()
        self._slow.set(0.0)
        self._quick.set(0.0)
        self.std = self._jerk = self._missing = self._excess = self._behind = self._agreed = 0.0
        self._low = self._dead = False
        self._high: Doubt | None = None
        self._noisy = self._still = self._silent = 0.0
        self._idle = DRIVEN
        self._drift = DRIFT
        self._owed, self._owed_for = 0.0, 0.0

    def judge(self, dt: float, speed: float, std: float, new: int, rejected: bool,
              throttle: float, steering: float, armed: bool, accel: float | None,
              turn: float | None) -> None:
        """One frame.

        dt [s] since the last; speed [m/s] signed with one sigma, and new edges of
        it; rejected: it dropped edges as noise; throttle -1..1 and steering [rad] at the pins;
        armed: a command may move the car; accel [m/s2] along the car and turn
        [rad/s], None = not trusted.
        """
        if dt <= 0.0:
            return
        self.bounds.advance(throttle, steering, dt)
        self._silent = 0.0 if new else self._silent + dt
        self._noisy = TELLS if rejected else max(self._noisy - dt, 0.0)
        self._idle = 0.0 if throttle != 0.0 else self._idle + dt
        standing = throttle == 0.0 and self._silent > SILENCE
        self._still = self._still + dt if standing else 0.0
        if standing and not armed:
            self._rest(accel, dt)
        driven = armed and self._idle < DRIVEN and self._still < RESTS
        self._follow(speed, std, accel if driven else None, turn, dt)
        self._feel(abs(speed), dt, armed)
        self._expect(abs(speed), new, dt, armed)
        self._publish(abs(speed))

    # -- the reference -------------------------------------------------------

    def _rest(self, accel: float | None, dt: float) -> None:
        """It stands and nobody drives: learn the offset, forget old doubts."""
        if accel is not None:
            share = min(dt / LEARN, 1.0)
            offset = self._offset + (accel - self._offset) * share
            self._offset = min(max(offset, -MAX_OFFSET), MAX_OFFSET)
            self._drift = FRESH if self._still > RESTS else self._drift
        if self._still > RESTS:
            self._low = False

    def _follow(self, speed: float, std: float, accel: float | None, turn: float | None,
                dt: float) -> None:
        """Both references one frame on; without an acceleration they begin anew."""
        if accel is None or turn is None:
            self._jerk = 0.0
            self._slow.set(speed)
            self._quick.set(speed)
            return
        self._drift = min(self._drift + AGES * dt, DRIFT)
        felt = accel - self._offset + turn * turn * self._x
        unsure = (abs(felt) if abs(accel) > CLIPPED
                  else GAIN * abs(felt) + SIDEWAYS * abs(turn * speed))
        self._jerk = max(abs(felt), self._jerk * (1.0 - min(dt / SOON, 1.0)))
        doubted = bool(self._low or self._high is not None or self._missing or self._excess)
        extra = LATE * self._jerk + SIGMAS * min(std, STD_MOST)
        for reference in (self._slow, self._quick):
            reference.follow(speed, felt, unsure, self._drift, extra, doubted, dt)

    def _feel(self, speed: float, dt: float, armed: bool) -> None:
        """Missing and invented edges by what the accelerometer feels."""
        slow, quick = self._slow, self._quick
        sudden = quick.gap > max(quick.most, LOST * abs(quick.value))
        gap = slow.gap if slow.gap > slow.most else quick.gap if sudden else 0.0
        spun = -quick.gap > max(quick.most, LOST * abs(quick.value))
        over = -slow.gap if -slow.gap > slow.most else -quick.gap if spun else 0.0
        self._missing = self._missing + gap * dt if gap and self._high is None else 0.0
        self._excess = self._excess + over * dt if over else 0.0
        if self._missing >= self._owing:
            self._low = True
        hand = 0.0 if armed else PUSHED
        share, more = FREE
        invented = speed > max(share * self.bounds.free + more, hand)
        if invented or self._excess >= self._owing:
            self._high = Doubt.ENCODER_HIGH if invented else Doubt.ENCODER_SLIPS
            self._agreed = 0.0
        elif self._high is not None:
            self._agreed = self._agreed + dt if -self._slow.gap < 0.5 * self._slow.most else 0.0
            if self._agreed >= AGREES:
                self._high = None

    # -- the model -----------------------------------------------------------

    def _expect(self, speed: float, new: int, dt: float, armed: bool) -> None:
        """Edges that the throttle must have made."""
        low = self.bounds.low
        below, lasting = BEHIND
        self._behind = self._behind + dt if armed and speed < low - below else 0.0
        if new:
            self._owed = self._owed_for = 0.0
            self._dead = self._dead and self._low
        elif armed and low > 0.0:
            self._owed += low * dt
            self._owed_for += dt
        owed = self._owed_for >= SILENCE and self._owed >= self._owing
        felt = (self._low and self._missing >= self._owing and self._idle < SILENCE
                and self._silent >= 0.5 * SILENCE)
        if owed or felt:
            self._dead = True
        elif self._behind >= lasting and self._silent < SILENCE:
            self._low = True

    # -- what is said ----------------------------------------------------------

    def _publish(self, speed: float) -> None:
        """Names, and one sigma [m/s] that covers what the encoder may miss."""
        names = {name for name, holds in ((Doubt.ENCODER_DEAD, self._dead),
                                          (Doubt.ENCODER_LOW, self._low),
                                          (Doubt.ENCODER_NOISY, self._noisy > 0.0)) if holds}
        if self._high is not None:
            names.add(self._high)
        self.doubts = frozenset(name.value for name in names)
        gap = abs(self._slow.gap)
        std = gap if gap > 0.5 * self._slow.most or self._silent > 0.0 else 0.0
        if self._low or self._dead:
            std = max(std, speed, 0.5 * (self.bounds.high - speed))
        if self._high is not None:
            std = max(std, 0.5 * speed)
        self.std = std


def covering(stated: float, missed: float) -> float:
    """One sigma of a speed with what the checks found beside it [m/s]."""
    return hypot(stated, missed) if missed else stated
