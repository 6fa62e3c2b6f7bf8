"""What the pins may carry: actuator and supervisor, fed with what is known."""

from __future__ import annotations

from collections import deque

from dart_hal.actuation import Actuator, Event, Facts, Supervisor, not_armed, refusals
from dart_hal.actuation import State as Mode
from dart_hal.actuation.arming import WAIVABLE
from dart_hal.actuation.supervisor import COMES_BY_WAITING
from dart_hal.car.guarding import GuardPost
from dart_hal.car.identity import Hello
from dart_hal.car.receive import Receiver
from dart_hal.car.transmit import Transmitter
from dart_hal.config import CarFiles
from dart_hal.errors import BadCommand, BusError, NotArmed
from dart_hal.links.base import Backend
from dart_hal.types import Applied, Doubt, State

STALE = 0.1
"""s without a good frame: the throttle goes neutral."""
LOSS_WINDOW = 500
"""Frames, 5 s, over which the share of lost ones is judged."""
CLOCK_GOOD = 2e-3
"""s, one sigma of the host time of a sample that counts as synchronised."""
OUTPUTS = {0: "none", 1: "oe", 2: "mux"}
OUTPUT_ON_AFTER = 0.6
"""s of good heartbeats until a Nano with /OE lets the pulses through (0.5 s, and
what a late beat costs): before that the ESC has seen no neutral at all."""
REFUSAL_OF = {"LINK_STALE": "LINK_NOT_GOOD_500MS", "COMMAND_EXPIRED": "THROTTLE_NOT_NEUTRAL",
              "TIME_BACKWARD": "COMMAND_INVALID", "PCA_READBACK": "PCA_MODE",
              "GUARD_TRIPPED": "GUARD_SILENT"}
"""A trip during ARMING, as the reason why it did not arm."""


class Driver:
    """Actuator and supervisor of one open car; the engine calls it in its step."""

    def __init__(self, files: CarFiles, backend: Backend, transmitter: Transmitter,
                 receiver: Receiver) -> None:
        self._files, self._backend = files, backend
        self._transmitter, self._receiver = transmitter, receiver
        self.actuator = Actuator(files, backend.bus, backend.clock.sleep)
        throttle = files.config.throttle
        self.supervisor = Supervisor(throttle.arm_neutral,
                                     getattr(files.config.steering, "follow_disarmed", False))
        self._guard: GuardPost | None = None
        self.waived: tuple[str, ...] = ()
        self._state: State | None = None
        self.seen_at = float("-inf")
        self._good_since: float | None = None
        self._beats_since: float | None = None
        self._lost: deque[int] = deque(maxlen=LOSS_WINDOW)
        self._rebooted = False

    @property
    def applied(self) -> Applied:
        return self.actuator.applied

    @property
    def mode(self) -> Mode:
        return self.supervisor.state

    # -- life ------------------------------------------------------------------

    def open(self, now: float) -> None:
        """Bring the pins to neutral; on a real bus call a guard. Raises BusError."""
        self.supervisor.event(Event.OPEN, now)
        try:
            self.actuator.open()
        except BusError:
            self.supervisor.event(Event.OPEN_FAILED, now)
            raise
        self.supervisor.event(Event.OPENED, now)
        self.actuator.set_output(self.supervisor.output)
        bus = self._backend.url.options.get("i2c")
        if bus is not None and not self._backend.virtual and self._backend.bus is not None:
            self._guard = GuardPost(bus, self.actuator)

    def ready(self) -> None:
        """The Nano has answered: the guard must watch before anything can be armed."""
        if self._guard is not None:
            self._guard.ready()

    def close(self, now: float) -> None:
        """Neutral for two frames; what cannot be written is left to the layers below."""
        self.supervisor.event(Event.CLOSE, now)
        neutral = True
        try:
            self.actuator.close()
        except BusError:
            neutral = False
            self.actuator.stop()
        if self._guard is not None:
            self._guard.close(at_neutral=neutral)

    def lost(self, now: float) -> None:
        """The link is gone: neutral at once."""
        self.supervisor.step(now, causes=("LINK_STALE",), bus_ok=self.actuator.fault is None)
        self.actuator.set_output(self.supervisor.output)
        self.actuator.stop()

    # -- what is known -----------------------------------------------------------

    def seen(self, state: State, now: float) -> None:
        """A State arrived."""
        if self._good_since is None or now - self.seen_at > STALE:
            self._good_since = now
        if self._lost and state.health.lost != self._lost[-1]:
            self._good_since = now
        if "BEAT_OK" not in state.health.flags:
            self._beats_since = None
        elif self._beats_since is None:
            self._beats_since = now
        self._lost.append(state.health.lost)
        self._state, self.seen_at = state, now
        self._cap_throttle(state)

    def on_boot(self, hello: Hello) -> None:
        """Another boot than before: disarm, and refuse until arm() is called again."""
        self._rebooted = self.mode is not Mode.DISARMED or self._rebooted
        self.supervisor.event(Event.REBOOT, self._backend.clock.now(), ("MCU_REBOOTED",))

    def facts(self, now: float) -> Facts:
        """Everything that arming asks about."""
        hello, state, files = self._receiver.hello, self._state, self._files
        flags = state.health.flags if state else frozenset[str]()
        doubts = state.health.doubts if state else frozenset[str]()
        moving = self.mode not in (Mode.ARMED, Mode.RAW) and bool(state and state.speed != 0.0)
        loss = (self._lost[-1] - self._lost[0]) / len(self._lost) if self._lost else 0.0
        mine = files.calibration is not None or self._backend.car_toml is not None
        fault = self.actuator.fault is not None
        asked = self.actuator.asked(now)
        virtual = self._backend.virtual or self._backend.bus is None
        cutoff = OUTPUTS.get((hello.caps >> 2 & 3) if hello else 0, "none")
        return Facts(
            hello=hello is not None, schema_ok=self._receiver.schema_ok,
            protocol_ok=hello is None or hello.proto_supported,
            link_good_for=now - self._good_since if self._good_since is not None
            and now - self.seen_at < STALE else 0.0,
            frame_loss=loss, rebooted=self._rebooted,
            clock_synced=state is not None and state.health.t_std < CLOCK_GOOD,
            imu_required=files.config.imu.required, imu_absent="IMU_ABSENT" in flags,
            imu_stale="IMU_STALE" in flags or "IMU_VALID" not in flags,
            imu_stuck="IMU_STUCK" in flags, imu_doubted=bool(state and state.health.imu_doubted),
            wheel_moves=moving,
            encoder_lost=not {Doubt.ENCODER_DEAD, Doubt.ENCODER_LOW}.isdisjoint(doubts),
            encoder_noisy=not {Doubt.ENCODER_HIGH, Doubt.ENCODER_NOISY}.isdisjoint(doubts),
            pca_present=not fault, write_failed=fault,
            neutral_for=self._neutral_for(now, cutoff),
            arm_neutral=files.config.throttle.arm_neutral,
            clock_calibrated=self.actuator.clock_calibrated,
            throttle=asked.throttle if asked else 0.0,
            guard_age=0.0 if virtual else self._guard.age if self._guard else None,
            raw_open=self.mode is Mode.RAW, latched=self.mode is Mode.LOCKED,
            calibration="ok" if mine else "missing",
            cutoff_required=files.config.safety.cutoff_required,
            cutoff=cutoff,
            watchdog_fired="WATCHDOG_LAST_BOOT" in flags)

    def _neutral_for(self, now: float, cutoff: str) -> float:
        """s for which the ESC has seen neutral."""
        written = self.supervisor.neutral_for(now)
        if cutoff != "oe":
            return written
        since = self._beats_since
        return min(written, max(now - since - OUTPUT_ON_AFTER, 0.0)) if since is not None else 0.0

    def _cap_throttle(self, state: State) -> None:
        """An encoder that is lost caps the throttle; in RAW one that is doubted does."""
        health = state.health
        lost = health.speed_doubted if self.mode is Mode.RAW else health.encoder_lost
        cap = self._files.config.limits.encoder_lost_throttle
        self.actuator.throttle_cap = cap if lost else None

    # -- the PWM frame -------------------------------------------------------------

    def frame(self, now: float) -> Applied:
        """Let the supervisor decide, then write one PWM frame."""
        causes = list(self.actuator.trips())
        if now - self.seen_at > STALE and self.mode is not Mode.OPENING:
            causes.append("LINK_STALE")
        if self._guard is not None and self._guard.tripped:
            causes.append("GUARD_TRIPPED")
        refused = refusals(self.facts(now), self.waived) if self.mode is Mode.ARMING else ()
        self._step(now, causes, refused)
        applied = self.actuator.frame(now)
        if late := self.actuator.trips():
            self._step(now, list(late), ())
        if self._guard is not None:
            self._guard.beat(at_neutral=self.supervisor.output.throttle == "neutral"
                             and self.actuator.fault is None)
        return applied

    def _step(self, now: float, causes: list[str], refused: tuple[str, ...]) -> None:
        before = self.supervisor.output
        self.supervisor.step(now, causes=causes, refused=refused,
                             bus_ok=self.actuator.fault is None)
        if self.supervisor.output != before:
            self.actuator.set_output(self.supervisor.output)

    def heartbeat(self, now: float) -> None:
        hello, applied = self._receiver.hello, self.applied
        direction = (applied.throttle > 0.0) - (applied.throttle < 0.0)
        self._transmitter.heartbeat(applied, self.supervisor.beat,
                                    hello.boot_nonce if hello else 0, direction, now)

    # -- what the user asks for ------------------------------------------------------

    def arm(self, now: float, waive: tuple[str, ...]) -> None:
        """Start arming. Raises NotArmed with every reason that waiting will not cure."""
        self._rebooted = False
        self.waived = waive
        self.supervisor.arm(now, refusals(self.facts(now), waive))
        self.actuator.set_output(self.supervisor.output)

    def refused(self) -> NotArmed:
        """Why arming ended in DISARMED."""
        names = [REFUSAL_OF.get(name, name) for name in self.supervisor.reasons]
        return not_armed(dict.fromkeys(names or ["LINK_NOT_GOOD_500MS"]))

    def settled(self, now: float) -> bool:
        """Whether everything that comes by waiting after an open or a drive is there."""
        facts = self.facts(now)
        return (facts.link_good_for >= 0.1 and facts.clock_synced and not facts.imu_stale
                and not facts.wheel_moves
                and (facts.guard_age is None or facts.guard_age <= STALE))

    def open_raw(self, now: float) -> None:
        """Enter RAW. Raises NotArmed unless link, firmware and bus are good."""
        if held := self.raw_refusals(now):
            raise not_armed(held)
        self.event(Event.RAW_OPEN, now)
        if self.mode is not Mode.RAW:
            raise not_armed(("PCA_ABSENT",))

    def arm_refusals(self, now: float) -> tuple[str, ...]:
        """What keeps the car from arming and does not come by waiting."""
        return tuple(name for name in refusals(self.facts(now)) if name not in COMES_BY_WAITING)

    def raw_refusals(self, now: float) -> list[str]:
        """Why RAW may not be entered now."""
        needless = ("NEUTRAL_TOO_SHORT",)
        return [name for name in refusals(self.facts(now), WAIVABLE) if name not in needless]

    def raw_pulses(self, steering_us: float, throttle_us: float) -> Applied:
        """Pulses in RAW. Raises BadCommand in any other state."""
        if self.mode is not Mode.RAW:
            causes = ", ".join(self.supervisor.causes)
            raise BadCommand("pulses() needs raw()", found=f"the car is {self.mode.value}"
                             + (f" since {causes}" if causes else ""),
                             remedy="with car.raw(): car.pulses(...)")
        return self.actuator.pulses(steering_us, throttle_us)

    def event(self, event: Event, now: float) -> None:
        """Tell the supervisor and put its answer on the pins at the next frame."""
        self.supervisor.event(event, now)
        self.actuator.set_output(self.supervisor.output)

    def stop(self, now: float) -> Applied:
        """Throttle neutral now, steering held; the car is disarmed."""
        self.event(Event.STOP, now)
        return self.actuator.stop()
