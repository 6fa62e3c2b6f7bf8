"""A car in virtual time whose ESC pin is watched: every pulse, with its world time."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from dart_hal.car import Car
from dart_hal.core.errors import BadCommand, LinkLost
from dart_hal.core.types import State
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO, STATE
from dart_lab.sim.cutoff import Direct
from dart_lab.sim.esc import EscMode
from dart_lab.sim.failures import parse_failure, schedule_failures
from dart_lab.sim.faults import LineFaults
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import World
from fault_table.row import NEVER

WAIVED = ("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED")
ESC = 1
"""Channel of the throttle."""
SLACK = 5e-6
"""s around neutral that an ESC takes for neutral; PWM counts are 4.9 us."""
MAX_PWM_PERIOD_S = 0.0205
"""s between two pulses of 50 Hz, a slow oscillator included."""
FULL = 1.0
DRIVING_PULSE_S = 1.55e-3
"""s of a pulse that certainly drives."""

ESC_IS_ARMED = (r"arm_neutral = 2\.0", "arm_neutral = 0.1")
"""Edit of car.toml: five pulses of neutral are enough."""

CUTOFF_HOLDS = True
"""False: the hardware cut-off welds at the first driving pulse, after it was tested."""

Command = Callable[[Car, State], object]
Edit = tuple[str, str]
"""Pattern in the text of car.toml, and what replaces it."""


def forward(throttle: float, valid_for: float = 0.2) -> Command:
    """A loop that requests this throttle at every State, in any mode."""
    return lambda car, state: car.drive(throttle=throttle, valid_for=valid_for)


def weld_if_removed(world: World) -> None:
    """The layer "cutoff" is gone: from the first driving pulse on the lead is a plain wire."""
    if CUTOFF_HOLDS:
        return

    def weld(channel: int, pulse: tuple[float, float]) -> None:
        if channel == ESC and pulse[1] - pulse[0] > DRIVING_PULSE_S:
            world._wiring = Direct(world.pca)
            world.pca.set_oe(False, world.t)
            world.watchers.remove(weld)

    world.watchers.append(weld)


class Drive:
    """One simulated car. Use as a context manager; ``pulses`` are (rise, fall) at the ESC.

    ``brief``: an earlier program has armed the ESC, which obeys without its 2 s of neutral, and
    ``driving`` takes 0.4 s instead of 1 s.
    """

    def __init__(self, folder: Path, options: str = "", *, nano: str = "mock",
                 edit: Edit | None = None, edits: Sequence[Edit] = (),
                 prepare: Callable[[World], None] | None = None,
                 opened: float = 0.0, brief: bool = False) -> None:
        backend = open_backend(f"sim://?nano={nano}{options}")
        self._brief = brief
        if brief:
            world_of(backend).esc.mode = EscMode.READY
            backend.car_toml = re.sub(*ESC_IS_ARMED, backend.car_toml)
        while world_of(backend).t < opened:     # sets where the PWM frame lies to the Nano's slot
            world_of(backend).advance(opened)
        for pattern, text in (*edits, *([] if edit is None else [edit])):
            backend.car_toml = re.sub(pattern, text, backend.car_toml)
        if prepare is not None:
            prepare(world_of(backend))
        self.backend, self.world = backend, world_of(backend)
        self.pulses: list[tuple[float, float]] = []
        self.hellos: list[tuple[float, int]] = []
        self.states: list[State] = []
        self.deaf_to_hello = False
        self.sample: tuple[int, ...] = ()
        """Words of the IMU in the newest STATE."""
        self._decoder = FrameDecoder(UP)
        self.world.watchers.append(self._saw)
        weld_if_removed(self.world)
        self.car = Car.over(backend, cars=folder, raise_on_trip=False)
        self.neutral = self.car.files.neutral_us * 1e-6
        self.car.on_bytes(self._heard)

    def __enter__(self) -> Drive:
        return self

    def __exit__(self, *_: object) -> None:
        self.car.close()

    @property
    def now(self) -> float:
        return self.world.t

    def arm(self) -> Drive:
        """Arm, with an ESC that has received its 2 s of neutral in any case."""
        self.run(self.settling)
        self.car.arm(waive=WAIVED)
        return self

    def run(self, seconds: float, command: Command | None = None) -> list[State]:
        """Live on for so long, also through a lost link; return the States."""
        end = self.now + seconds
        states = []
        while self.now < end - 0.005:
            with suppress(LinkLost):
                for state in self.car.states(duration=end - self.now, timeout=0.05):
                    states.append(state)
                    if command is not None:
                        with suppress(BadCommand):
                            command(self.car, state)
                    if self.now >= end - 0.005:
                        break
        self.states = states
        return states

    @property
    def settling(self) -> float:
        """s from the start until the car can arm: clock and IMU settle, the ESC starts."""
        return 0.3 if self._brief else 2.2

    def driving(self, throttle: float = 0.4, seconds: float | None = None) -> Drive:
        """Armed and on its way: at the end the pin carries a throttle."""
        if seconds is None:
            seconds = 0.4 if self._brief else 1.0
        self.arm().run(seconds, forward(throttle))
        assert self.wrong(self.pulses[-1]), (
            f"it does not drive: {self.car.mode} {self.car.causes} {self.states[-1].applied}")
        return self

    def fail(self, text: str, seconds: float | None = None, delay: float = 0.0) -> float:
        """Let a failure (``mcu:reset``, ``enc:wrong=0.5``) begin now, or ``delay`` s later;
        returns the time."""
        at = self.now + 0.002 + delay
        lasts = f"+{seconds}" if seconds is not None else ""
        schedule_failures(self.world, [parse_failure(f"{text}@{at:.6f}{lasts}")])
        return at

    def silence(self, seconds: float = NEVER) -> float:
        """The line carries nothing, either way, from now on."""
        link = self.backend.link
        now = self.now
        for line in (link._up, link._down):
            line.faults = LineFaults(silence=[(now, now + seconds)])
        return now

    def wrong(self, pulse: tuple[float, float]) -> bool:
        """Whether an ESC would drive forward on it."""
        rise, fall = pulse
        return fall - rise > self.neutral + SLACK

    def off(self, pulse: tuple[float, float]) -> bool:
        """Whether it differs from neutral in either direction (but for the stub of a cut-off)."""
        rise, fall = pulse
        return abs(fall - rise - self.neutral) > SLACK and fall - rise > 900e-6

    def last_wrong(self, since: float) -> float:
        """ms from ``since`` to the end of the last pulse that drives; NEVER = it goes on."""
        last = max((fall for rise, fall in self.pulses if self.wrong((rise, fall))), default=0.0)
        if last > self.now - 3 * MAX_PWM_PERIOD_S:
            return NEVER
        return max(0.0, (last - since) * 1e3)

    def last_off(self, since: float) -> float:
        """ms from ``since`` to the end of the last pulse that drives forward or backward."""
        last = max((fall for rise, fall in self.pulses if self.off((rise, fall))), default=0.0)
        return NEVER if last > self.now - 3 * MAX_PWM_PERIOD_S else max(0.0, (last - since) * 1e3)

    def _saw(self, channel: int, pulse: tuple[float, float]) -> None:
        if channel == ESC:
            self.pulses.append(pulse)

    def _heard(self, direction: str, data: bytes, t: float) -> bytes:
        if direction != "rx":
            return data
        frames = self._decoder.feed(data)
        for frame in frames:
            if frame.message is STATE:
                values = frame.as_dict()
                self.sample = (*values["gyro"], *values["lin_acc"])
        hello = [frame for frame in frames if frame.message is HELLO]
        self.hellos += [(t, frame.as_dict()["boot_count"]) for frame in hello]
        return b"" if hello and self.deaf_to_hello else data
