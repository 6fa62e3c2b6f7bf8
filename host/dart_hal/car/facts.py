"""Facts for arming and trips, from States, HELLO and the car's files."""

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

# s without a good frame until the throttle goes to neutral. It is 100 ms at the pin: the PWM frame
# under way takes up to 20 ms to end.
STALE_LINK_TIME = 0.08
# s without a State until servo and ESC get no pulse at all. Neutral, written after
# ``STALE_LINK_TIME``, has stopped the motor by then. Beyond, nothing would show a neutral that
# moves the car.
MAX_TIME_WITHOUT_STATE = 0.5
# Frames, 5 s, over which the share of lost ones is computed.
LOSS_WINDOW_FRAMES = 500
# s: largest standard error of the host time of a sample that counts as synchronised.
MAX_CLOCK_STD = 2e-3
# Parameter of the firmware: ms without a heartbeat after which it stops the car.
BEAT_LIMIT = PARAM_BY_NAME["beat_timeout_ms"]
# s of good heartbeats until a Nano with /OE passes the pulses: 0.5 s, and a late heartbeat. Before
# that the ESC gets no neutral.
OE_SWITCH_ON_TIME = 0.6
# s until a Nano with a cut-off passes the pulses: 0.5 s of heartbeats, and a margin.
MAX_SWITCH_ON_TIME = 0.7
# Frames of 10 ms over which the motion of a lifted car is averaged.
LIFTED_FRAMES = 5
# rad/s and m/s2, mean of 50 ms: a car on a stand shakes, but does not turn or drive off.
MAX_LIFTED_RATE = 0.3
MAX_LIFTED_ACCELERATION = 2.0
# s without a valid sample of the IMU after which a car on a stand counts as moving.
#
# Two samples of zeros in a row are invalid, and a still car with a quiet gyro sends them; a read
# that fails costs as much. A car that leaves its stand moves 2 cm in this time at 4 m/s2.
MAX_LIFTED_GAP = 0.1


class Observer:
    """Stores from each State what later checks need; one per open car.

    ``state``: the newest. ``arrived_at``: its arrival [s]. ``tested``: outcome of the cut-off's
    self-test. ``guard_age()``: s since the guard's last sign of life, None: there is none.
    """

    def __init__(self, files: CarFiles, backend: Backend, receiver: Receiver,
                 actuator: Actuator) -> None:
        self._files = files
        self._backend = backend
        self._receiver = receiver
        self._actuator = actuator
        self.state: State | None = None
        self.arrived_at = float("-inf")
        self.rebooted = False
        self.loop_latency = 0.0
        self.tested = "pending"
        self.guard_age: Callable[[], float | None] = lambda: 0.0
        self._good_since: float | None = None
        self._beats_since: float | None = None
        self._lost: deque[int] = deque(maxlen=LOSS_WINDOW_FRAMES)
        self._motion: deque[tuple[float, float, float]] = deque(maxlen=LIFTED_FRAMES)
        self._motion_at = float("-inf")

    # -- a State arrived ---------------------------------------------------------

    def observe(self, state: State, now: float) -> None:
        """Take over a State that arrived at host time ``now`` [s]."""
        # The link is good since the last gap, lost frame included.
        if self._good_since is None or now - self.arrived_at > STALE_LINK_TIME:
            self._good_since = now
        if self._lost and state.health.lost != self._lost[-1]:
            self._good_since = now
        if "BEAT_OK" not in state.health.flags:
            self._beats_since = None
        elif self._beats_since is None:
            self._beats_since = now
        self._lost.append(state.health.lost)
        self.state = state
        self.arrived_at = now
        self._note_motion(state)

    def outputs_off(self, now: float) -> None:
        """Restart the neutral time: the Nano switches the outputs off."""
        self._beats_since = now

    def _note_motion(self, state: State) -> None:
        """Store the motion of the IMU, for a car on a stand."""
        if state.yaw_rate is None or state.accel_x is None or state.accel_y is None:
            if state.t - self._motion_at > MAX_LIFTED_GAP:
                self._motion.clear()
        else:
            self._motion.append((state.yaw_rate, state.accel_x, state.accel_y))
            self._motion_at = state.t

    # -- what follows from it -----------------------------------------------------

    @property
    def cutoff(self) -> str:
        """Return the hardware cut-off of the Nano: none, oe or mux."""
        hello = self._receiver.hello
        return hello.cutoff if hello else "none"

    @property
    def passing(self) -> bool:
        """Return whether the PCA9685's pulses reach the ESC, by the newest State."""
        live = self.state is not None and "OUTPUT_LIVE" in self.state.health.flags
        return self.cutoff == "none" or live

    @property
    def is_moving(self) -> bool:
        """Return whether the IMU shows a car that is not on its stand, or measures nothing."""
        if len(self._motion) < LIFTED_FRAMES:
            return True
        rate, x, y = (sum(values) / LIFTED_FRAMES for values in zip(*self._motion, strict=True))
        return abs(rate) > MAX_LIFTED_RATE or hypot(x, y) > MAX_LIFTED_ACCELERATION

    def blind(self, now: float) -> bool:
        """Return whether motion at neutral could go unnoticed: no State for too long."""
        return now - self.arrived_at > MAX_TIME_WITHOUT_STATE

    def stale(self, now: float) -> bool:
        """Return whether no good frame has come for ``STALE_LINK_TIME``."""
        return now - self.arrived_at > STALE_LINK_TIME

    def facts(self, mode: ArmState, now: float, neutral_for: float, silent: bool) -> Facts:
        """Return everything that the arming checks need.

        neutral_for: time [s] of neutral written so far. silent: the pulses are off since the car
        moved at neutral.
        """
        receiver = self._receiver
        state = self.state
        files = self._files
        hello = receiver.hello
        fault = self._actuator.fault
        flags = state.health.flags if state else frozenset[str]()
        doubts = state.health.doubts if state else frozenset[str]()
        moving = mode not in (ArmState.ARMED, ArmState.RAW) and bool(state and state.speed != 0.0)
        loss = (self._lost[-1] - self._lost[0]) / len(self._lost) if self._lost else 0.0
        mine = files.calibration is not None or self._backend.car_toml is not None
        board = files.calibration.board if files.calibration else None
        command = self._actuator.requested_command(now)
        cutoff = self.cutoff
        return Facts(
            hello=hello is not None and not receiver.hello_stale,
            schema_ok=receiver.schema_ok,
            protocol_ok=hello is None or hello.proto_supported,
            link_good_for=now - self._good_since if self._good_since is not None
            and not self.stale(now) else 0.0,
            frame_loss=loss, rebooted=self.rebooted,
            clock_synced=state is not None and state.health.t_std < MAX_CLOCK_STD,
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
            throttle=command.throttle if command else 0.0,
            guard_age=self.guard_age(), raw_open=mode is ArmState.RAW,
            latched=mode is ArmState.LOCKED, loop_late=self.loop_latency,
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
        """Return the time [s] for which the ESC has received neutral."""
        if cutoff != "oe":
            return written
        # A cut-off by /OE passes no neutral pulse before the outputs are switched on.
        since = self._beats_since
        return min(written, max(now - since - OE_SWITCH_ON_TIME, 0.0)) if since is not None else 0.0
