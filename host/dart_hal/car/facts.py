"""What a car's States, HELLO and files tell that arming and trips ask about."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from datetime import datetime, timezone
from math import hypot

from dart_hal.car.receive import Receiver
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Doubt, State
from dart_hal.devices.actuation import Actuator, ArmState, Facts
from dart_hal.devices.links.base import Backend
from dart_hal.wire.messages import PARAM_BY_NAME

STALE = 0.08
"""s without a good frame until the throttle goes neutral: 100 ms at the pin, where the
PWM frame under way takes up to 20 ms to end."""
BLIND = 0.5
"""s without a State until servo and ESC get no pulse at all. Neutral, which comes after ``STALE``,
has stopped the motor by then; longer, and a neutral that drives the car would go unnoticed."""
LOSS_WINDOW = 500
"""Frames, 5 s, over which the share of lost ones is judged."""
CLOCK_GOOD = 2e-3
"""s, one sigma of the host time of a sample that counts as synchronised."""
BEAT_LIMIT = PARAM_BY_NAME["beat_timeout_ms"]
OUTPUTS = {0: "none", 1: "oe", 2: "mux"}
OUTPUT_ON_AFTER = 0.6
"""s of good heartbeats until a Nano with /OE lets the pulses through (0.5 s, and
what a late beat costs): before that the ESC has seen no neutral at all."""
LIVE_AFTER = 0.7
"""s that a Nano with a cut-off may take to pass the pulses on: 0.5 s of beats, and margin."""
LIFTED_FRAMES = 5
LIFTED_RATE, LIFTED_ACC = 0.3, 2.0
"""rad/s and m/s2, mean of 50 ms: a car on a stand shakes, but does not turn or leave."""
MAX_LIFTED_GAP = 0.1
"""s without a valid sample of the IMU after which a car on a stand counts as moving.

Two samples of zeros in a row are invalid, and a still car with a quiet gyro sends them; a read
that fails costs as much. A car that leaves its stand moves 2 cm in this time at 4 m/s2.
"""


class Observer:
    """Keeps of each State what is asked for later; one per open car.

    ``state`` the newest, ``seen_at`` its arrival [s]; ``tested`` the outcome of
    the cut-off's self-test.
    """

    def __init__(self, files: CarFiles, backend: Backend, receiver: Receiver,
                 actuator: Actuator) -> None:
        self._files, self._backend = files, backend
        self._receiver, self._actuator = receiver, actuator
        self.state: State | None = None
        self.seen_at = float("-inf")
        self.rebooted = False
        self.loop_late = 0.0
        self.tested = "pending"
        self.guard_age: Callable[[], float | None] = lambda: 0.0
        self._good_since: float | None = None
        self._beats_since: float | None = None
        self._lost: deque[int] = deque(maxlen=LOSS_WINDOW)
        self._motion: deque[tuple[float, float, float]] = deque(maxlen=LIFTED_FRAMES)
        self._motion_at = float("-inf")

    # -- a State arrived ---------------------------------------------------------

    def seen(self, state: State, now: float) -> None:
        """A State arrived at host time ``now``."""
        if self._good_since is None or now - self.seen_at > STALE:
            self._good_since = now
        if self._lost and state.health.lost != self._lost[-1]:
            self._good_since = now
        if "BEAT_OK" not in state.health.flags:
            self._beats_since = None
        elif self._beats_since is None:
            self._beats_since = now
        self._lost.append(state.health.lost)
        self.state, self.seen_at = state, now
        self._note_motion(state)

    def outputs_off(self, now: float) -> None:
        """The Nano was told to switch the outputs off: neutral begins when they are back."""
        self._beats_since = now

    def _note_motion(self, state: State) -> None:
        if state.yaw_rate is None or state.accel_x is None or state.accel_y is None:
            if state.t - self._motion_at > MAX_LIFTED_GAP:
                self._motion.clear()
        else:
            self._motion.append((state.yaw_rate, state.accel_x, state.accel_y))
            self._motion_at = state.t

    # -- what follows from it -----------------------------------------------------

    @property
    def cutoff(self) -> str:
        """The hardware cut-off that the Nano works: none, oe or mux."""
        hello = self._receiver.hello
        return OUTPUTS.get((hello.caps >> 2 & 3) if hello else 0, "none")

    @property
    def passing(self) -> bool:
        """Whether the PCA9685's pulses reach the ESC as far as the Nano says."""
        live = self.state is not None and "OUTPUT_LIVE" in self.state.health.flags
        return self.cutoff == "none" or live

    @property
    def on_the_move(self) -> bool:
        """Whether the IMU shows a car that is not on its stand, or shows nothing."""
        if len(self._motion) < LIFTED_FRAMES:
            return True
        rate, x, y = (sum(values) / LIFTED_FRAMES for values in zip(*self._motion, strict=True))
        return abs(rate) > LIFTED_RATE or hypot(x, y) > LIFTED_ACC

    def blind(self, now: float) -> bool:
        """No State for so long that a car that moves at neutral would go unnoticed."""
        return now - self.seen_at > BLIND

    def stale(self, now: float) -> bool:
        """No good frame for too long."""
        return now - self.seen_at > STALE

    def facts(self, mode: ArmState, now: float, neutral_for: float, silent: bool) -> Facts:
        """Everything that arming asks about; ``neutral_for`` [s]: written neutral so far;
        ``silent``: the pulses are off since the car moved at neutral."""
        receiver, state, files = self._receiver, self.state, self._files
        hello, fault = receiver.hello, self._actuator.fault
        flags = state.health.flags if state else frozenset[str]()
        doubts = state.health.doubts if state else frozenset[str]()
        moving = mode not in (ArmState.ARMED, ArmState.RAW) and bool(state and state.speed != 0.0)
        loss = (self._lost[-1] - self._lost[0]) / len(self._lost) if self._lost else 0.0
        mine = files.calibration is not None or self._backend.car_toml is not None
        board = files.calibration.board if files.calibration else None
        asked, cutoff = self._actuator.asked(now), self.cutoff
        return Facts(
            hello=hello is not None and not receiver.hello_stale,
            schema_ok=receiver.schema_ok,
            protocol_ok=hello is None or hello.proto_supported,
            link_good_for=now - self._good_since if self._good_since is not None
            and not self.stale(now) else 0.0,
            frame_loss=loss, rebooted=self.rebooted,
            clock_synced=state is not None and state.health.t_std < CLOCK_GOOD,
            imu_required=files.config.imu.required, imu_absent="IMU_ABSENT" in flags,
            imu_stale="IMU_STALE" in flags or "IMU_VALID" not in flags,
            imu_stuck="IMU_STUCK" in flags, imu_doubted=bool(state and state.health.imu_doubted),
            wheel_moves=moving,
            moves_at_neutral=silent and (state is None or state.speed != 0.0),
            encoder_lost=not {Doubt.ENCODER_DEAD, Doubt.ENCODER_LOW}.isdisjoint(doubts),
            encoder_noisy=not {Doubt.ENCODER_HIGH, Doubt.ENCODER_NOISY}.isdisjoint(doubts),
            bus_fault=None if fault is None else fault.part,
            neutral_for=self._neutral_for(now, neutral_for, cutoff),
            arm_neutral=files.config.throttle.arm_neutral,
            clock_calibrated=self._actuator.clock_calibrated,
            throttle=asked.throttle if asked else 0.0,
            guard_age=self.guard_age(), raw_open=mode is ArmState.RAW,
            latched=mode is ArmState.LOCKED, loop_late=self.loop_late,
            calibration_missing=not mine,
            other_board=bool(board and hello and board != hello.board),
            calibration_unbound=files.calibration is not None and board is None,
            calibration_old=files.calibration is not None and "CALIBRATION_OLD"
            in files.calibration.warnings(datetime.now(timezone.utc)),
            cutoff_required=files.config.safety.cutoff_required, cutoff=cutoff,
            cutoff_test=self.tested, cutoff_test_required=files.config.safety.cutoff_test,
            beat_limit=receiver.params.get(BEAT_LIMIT.id),
            watchdog_fired="WATCHDOG_LAST_BOOT" in flags,
            imu_calibrated=state is None or state.health.calib[1] == 3,
            firmware_dirty=hello is not None and hello.dirty,
            simulated=self._backend.virtual or self._backend.simulated)

    def _neutral_for(self, now: float, written: float, cutoff: str) -> float:
        """s for which the ESC has seen neutral."""
        if cutoff != "oe":
            return written
        since = self._beats_since
        return min(written, max(now - since - OUTPUT_ON_AFTER, 0.0)) if since is not None else 0.0
