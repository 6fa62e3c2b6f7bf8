"""The actuator: what the plan wants, in counts, on the pins of a PCA9685.

It has no thread and no clock: the owner calls ``frame(now)`` once per PWM frame (every second
STATE frame). Each plan asks ``demand`` what the supervisor's state allows; by default neutral.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import cast

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BadCommand, BusError, PcaFault
from dart_hal.core.ports import Bus
from dart_hal.core.types import Applied, Limit
from dart_hal.devices.actuation.counters import ActuatorCounters
from dart_hal.devices.actuation.limits import LONGEST_RAW, Command, Pulses, checked, raw_pulses
from dart_hal.devices.actuation.no_bus import NoBus
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES, TRIES, Pca9685
from dart_hal.devices.actuation.plan import OFF, Output, Plan, Planner
from dart_hal.devices.actuation.play import play_of
from dart_hal.devices.actuation.quantiser import NOMINAL_HZ, Quantiser
from dart_hal.devices.actuation.steering_map import steering_map

READ_BACK_EVERY = 1.0
"""s between two looks at MODE1, PRE_SCALE and the pulses of the frame before."""
REOPEN_EVERY = 0.1
"""s between attempts to bring a lost PCA9685 back."""
WATCH_PULSE_US = 2300.0
"""Longer than every pulse that leaves the house (2250 us)."""
BACKWARD = 1e-6
"""s by which time may seem to go back through rounding."""
_NOT_ARMED = (Limit.NOT_ARMED.value,)
_NO_PULSES = (0, 0)


class Actuator:
    """The servo and the ESC of one car.

    ``bus`` None (a replay): commands are worked out and reported as NOT_SENT.
    ``sleep`` lets time pass in the backend's clock. ``demand`` is what the
    supervisor's state lets the pins carry. ``gate`` is asked right before each
    write that moves the car; a name it returns trips that write to neutral.
    ``fault`` is the bus error that holds, None = the chip obeys.
    """

    def __init__(self, files: CarFiles, bus: Bus | None, sleep: Callable[[float], None], *,
                 demand: Callable[[], Output] = Output,
                 gate: Callable[[], str | None] | None = None) -> None:
        car, clock = files.config, files.oscillator_hz
        table = files.calibration.steering.map if files.calibration else None
        self.car, self.counters = car, ActuatorCounters()
        self.demand, self.gate = demand, gate
        self.map = steering_map(car, table)
        self.neutral_us = files.neutral_us
        self.clock_calibrated = clock is not None
        self.pca = Pca9685(bus if bus is not None else cast(Bus, NoBus()),
                           address=car.pwm.address, frequency=car.pwm.frequency,
                           channels=(car.steering.channel, car.throttle.channel), sleep=sleep,
                           oscillator_hz=clock.value if clock else NOMINAL_HZ)
        self.fault: BusError | None = None
        self.watched = self._watching = False
        self._sending, self._sleep, self._opened = bus is not None, sleep, False
        self.moving = False
        """Whether the last frame carried something else than neutral."""
        self.found_pulses = False
        """Whether ``open`` found a pulse of another program on the pins."""
        play = play_of(files, self.map)
        self._planner = Planner(car, self.map, self.neutral_us, self.pca.frame, play)
        # to and fro by a count would shake the wheels across the play that is taken up
        self._quantisers = tuple(Quantiser(self.pca.count_us, car.pwm.error_feedback and still)
                                 for still in (play is None, True))
        self._trips: list[str] = []
        self._lapsed: Command | Pulses | None = None
        self._checked_at = self._tried_at = -math.inf
        self.applied = self._applied(self._at_rest(0.0), _NOT_ARMED)

    # -- life ------------------------------------------------------------

    def open(self, *, keep_off: bool = False) -> Applied:
        """Bring the pins to neutral and centre from any state; hold them for two frames.

        keep_off: channels that carry no pulse get none. A pulse that is found is replaced by
        neutral for ``NEUTRAL_FRAMES``, so that the ESC gives it up.
        Raises PcaMissing, PcaFault or BusError after three tries.
        """
        for attempt in range(TRIES if self._sending else 0):
            try:
                off = keep_off and self.pca.is_off()
                self.found_pulses = not off
                self._bring_up(off)
                self._sleep((NEUTRAL_FRAMES if keep_off and not off else 2) * self.pca.frame)
                break
            except BusError as error:
                self.counters.bus_errors += 1
                self.fault = error
                if attempt == TRIES - 1:
                    raise
                self._sleep(REOPEN_EVERY)
        self._opened = True
        return self.applied

    def close(self) -> None:
        """Throttle neutral and steering held for ``NEUTRAL_FRAMES``, then no pulse on any channel.

        After it nobody sees whether the neutral drives the car, so none is left on the pins.
        Never sleeps the chip: asleep it would keep the old pulse for its waking.
        Raises BusError when this could not be written.
        """
        if not self._opened:
            return
        self._opened = False
        self._planner.forget()
        off = self._planner.output.throttle == "off"
        counts = self._at_rest(self._planner.angle)
        try:
            for _ in range(0 if off else NEUTRAL_FRAMES):
                self._send(counts)
                self._sleep(self.pca.frame)
        finally:
            if self._sending:
                self.pca.all_off()
            self.applied = self._applied(_NO_PULSES, OFF.why)

    # -- commands --------------------------------------------------------

    def command(self, steering: float, throttle: float, valid_for: float, source: str,
                now: float) -> Applied:
        """A source wants steering [rad] and throttle [-1..1] for ``valid_for`` s.

        Returns what the next frame will put on the pins. Raises BadCommand for
        what is no number and for time going back; the throttle is then neutral
        already.
        """
        self._planner.obey(self.demand())
        with self._tripping():
            wanted = checked(steering, throttle, valid_for, source, now)
            self._in_order(now)
            self._planner.arbiter.put(wanted)
            plan = self._planner.plan(now, source)
        self.counters.overridden += any(name.startswith("OVERRIDDEN") for name in plan.limited)
        return self._applied(self._peek(plan), plan.limited, plan.moving)

    def pulses(self, steering_us: float, throttle_us: float | None, now: float,
               valid_for: float = LONGEST_RAW) -> Applied:
        """Pulses for calibration, for at most 0.2 s; they act while the output is raw.

        throttle_us None: no pulse for the ESC, with the wheels off the ground alone.
        Raises BadCommand outside 1000 to 2000 us; the throttle is neutral then.
        """
        self._planner.obey(self.demand())
        with self._tripping():
            self._in_order(now)
            self._planner.raw = raw_pulses(steering_us, throttle_us, self.neutral_us,
                                           self.demand().full_range, now, valid_for)
            plan = self._planner.plan(now, "raw")
        return self._applied(self._peek(plan), plan.limited, plan.moving)

    @contextmanager
    def _tripping(self) -> Iterator[None]:
        """Whatever a command path raises, the throttle is neutral before it is heard of."""
        try:
            yield
        except BaseException:
            self.refuse()
            raise

    def _in_order(self, now: float) -> None:
        if now < self._planner.last - BACKWARD:
            raise BadCommand("time went back", found=f"{now} s",
                             expected=f"{self._planner.last} s or later")

    def asked(self, now: float) -> Command | None:
        """What the winning source asks for at ``now``, armed or not; None = nothing."""
        return self._planner.arbiter.winner(now)

    @property
    def throttle_cap(self) -> float | None:
        """Largest |throttle| for now (the encoder is lost), None = the car's limits."""
        return self._planner.throttle_cap

    @throttle_cap.setter
    def throttle_cap(self, cap: float | None) -> None:
        self._planner.throttle_cap = cap

    @property
    def astray(self) -> bool:
        """The pins may move the car and the state demands that they do not."""
        written, demanded = self._planner.output, self.demand()
        goes_off = demanded.throttle == "off" and written.throttle != "off"
        return goes_off or (written.live and not demanded.live)

    @property
    def at_neutral(self) -> bool:
        """Whether the pins carry the neutral pulse of the car's files, as far as is known."""
        return self._opened and not self.moving and self.applied.throttle_us > 0.0

    def stop(self) -> Applied:
        """Throttle neutral now, steering held; a ramp if car.toml asks for one.

        Raises nothing: a bus error stands in ``fault`` and is reported as a trip.
        """
        self._planner.obey(self.demand())
        self._planner.forget()
        return self._put(self._planner.stopped(_NOT_ARMED))

    def neutral(self) -> Applied:
        """Throttle neutral and steering centred, now. Raises nothing, as ``stop``."""
        self._planner.forget()
        return self._put(self._planner.neutral(0.0, _NOT_ARMED))

    def _watch_pulse(self) -> None:
        """The spare channel shows the Nano when the ESC's pulse is high.

        It rises with it, is longer than any of them, and is on while there is a
        cut-off: the Nano switches between pulses alone. Raises BusError.
        """
        if self.watched != self._watching:
            self.clock_pulse(WATCH_PULSE_US if self.watched else None)
            self._watching = self.watched

    def clock_pulse(self, pulse_us: float | None) -> None:
        """Pulse on the spare clock channel, None = off. Raises BusError."""
        counts = None if pulse_us is None else Quantiser(self.pca.count_us).rest(pulse_us)
        if self._sending:
            self.pca.write_channel(self.car.pwm.clock_channel, counts)

    # -- one frame -------------------------------------------------------

    def frame(self, now: float) -> Applied:
        """One PWM frame: expire, limit, quantise, write both channels, read back each second.

        A repeated command is written again. Bus errors do not pass through:
        they stand in ``fault``, are reported once by ``trips()``, and the chip
        is tried again each 100 ms.
        """
        if not math.isfinite(now) or now < self._planner.last - BACKWARD:
            self._trip("TIME_BACKWARD")
            return self.stop()
        self.counters.frames += 1
        self._planner.obey(self.demand())
        plan = self._planner.plan(now)
        self._note_expiry(now)
        self._planner.last = now
        if self.fault is not None:
            self._revive(now)
            return self.applied
        if self._sending and now - self._checked_at >= READ_BACK_EVERY \
                and not self._read_back(now):
            return self.applied
        return self._put(plan)

    def trips(self) -> tuple[str, ...]:
        """Names of what must disarm the car, each told once.

        COMMAND_INVALID, COMMAND_EXPIRED, TIME_BACKWARD, PCA_WRITE_FAILED,
        PCA_READBACK, and what ``gate`` says.
        """
        names, self._trips = tuple(dict.fromkeys(self._trips)), []
        return names

    # -- counts and writes -------------------------------------------------

    def _put(self, plan: Plan) -> Applied:
        if not self._opened or self._planner.output.throttle == "untouched":
            return self.applied
        tripped = self.gate() if self.gate is not None and plan.moving else None
        if tripped is not None:
            self._trip(tripped)
            plan = self._planner.neutral(self._planner.angle, (*plan.limited, *_NOT_ARMED))
        off = self._planner.output.throttle == "off"
        counts = _NO_PULSES if off else self._step(plan)
        try:
            self._send(counts)
            self._watch_pulse()
        except BusError as error:
            self._lost(error, "PCA_WRITE_FAILED")
            return self.applied
        if not off:
            self._planner.wrote(plan, counts[0] * self.pca.count_us)
        self.moving = plan.moving
        why = (*OFF.why, *plan.limited) if off else plan.limited
        self.applied = self._applied(counts, why, plan.moving)
        return self.applied

    def _peek(self, plan: Plan) -> tuple[int, int]:
        """Counts that the next frame would write."""
        steering, throttle = self._quantisers
        esc = throttle.peek if plan.moving else throttle.rest
        return steering.peek(plan.steering_us), esc(plan.throttle_us) if plan.throttle_us else 0

    def _step(self, plan: Plan) -> tuple[int, int]:
        """Counts of this frame with error feedback; a neutral throttle stands still."""
        steering, throttle = self._quantisers
        esc = throttle.step if plan.moving else throttle.settle
        return steering.step(plan.steering_us), esc(plan.throttle_us) if plan.throttle_us else 0

    def _at_rest(self, angle: float) -> tuple[int, int]:
        """Counts of neutral, rounded down: never above it; steering at ``angle``."""
        plan = self._planner.neutral(angle, _NOT_ARMED)
        steering, throttle = self._quantisers
        throttle.error = 0.0
        return steering.settle(plan.steering_us), int(plan.throttle_us / self.pca.count_us)

    def _send(self, counts: tuple[int, int]) -> None:
        if self._sending:
            self.pca.write(counts)
            self.counters.writes += 1
            self.counters.retries = self.pca.retries

    def _applied(self, counts: tuple[int, int], why: tuple[str, ...],
                 moving: bool = False) -> Applied:
        """What counts mean. Neutral is 0.0, though its count is up to 2.4 us off."""
        steering_us, throttle_us = (n * self.pca.count_us for n in counts)
        pulled = (throttle_us - self.neutral_us) / self.car.throttle.span_us
        throttle = pulled if moving and counts[1] else 0.0
        standing = [] if self.map.calibrated else [Limit.UNCALIBRATED.value]
        standing += [] if self._sending else [Limit.NOT_SENT.value]
        angle = self._planner.meant(steering_us) if counts[0] else self._planner.angle
        return Applied(angle, throttle, steering_us, throttle_us,
                       tuple(dict.fromkeys((*why, *standing))))

    # -- faults ------------------------------------------------------------

    def _bring_up(self, off: bool) -> None:
        """Open the chip at neutral and centre; ``off``: without pulses."""
        rest = self._at_rest(0.0)
        counts = _NO_PULSES if off else rest
        self.pca.open(counts)
        self.fault, self._opened, self._watching = None, True, False
        self.moving = False
        self._planner.angle, self._planner.throttle = self.map.angle(
            rest[0] * self.pca.count_us), 0.0
        self.applied = self._applied(counts, OFF.why if off else _NOT_ARMED)

    def _read_back(self, now: float) -> bool:
        """Before the write of a frame: after it a stranger's pulse would be gone.

        While the guard has tripped its neutral stands there, and that is right.
        """
        self._checked_at = now
        self.counters.read_backs += 1
        guarded = self.gate is not None and self.gate() is not None
        try:
            self.pca.check(pulses=not guarded)
        except PcaFault as error:
            self._lost(error, "PCA_READBACK")
            self._revive(now)
        except BusError as error:
            self._lost(error, "PCA_WRITE_FAILED")
        else:
            return True
        return False

    def _revive(self, now: float) -> None:
        """Open the chip again at neutral, at most each 100 ms."""
        if now - self._tried_at < REOPEN_EVERY:
            return
        self._tried_at = now
        try:
            self._bring_up(self.demand().throttle == "off")
        except BusError as error:
            self.fault = error
            self.counters.bus_errors += 1
            return
        self.counters.reinits += 1
        self._checked_at = now

    def _lost(self, error: BusError, name: str) -> None:
        self.fault = error
        self.counters.bus_errors += 1
        self._checked_at = -math.inf                    # look at the chip as soon as it answers
        self._trip(name)

    def _note_expiry(self, now: float) -> None:
        """A command ran out. Running out at neutral is a stop; with throttle on, a hang."""
        lapsed = self._planner.lapsed(now)
        if lapsed is None or lapsed is self._lapsed:
            return
        self._lapsed = lapsed
        self.counters.expired += 1
        if lapsed.throttle != 0.0:
            self._trips.append("COMMAND_EXPIRED")

    def refuse(self) -> None:
        """A command that cannot be obeyed: trip, and neutral at once."""
        self.counters.bad_commands += 1
        self._trip("COMMAND_INVALID")
        self.stop()

    def _trip(self, name: str) -> None:
        """Neutral until the supervisor has answered with another output."""
        self._trips.append(name)
        self._planner.latch()
