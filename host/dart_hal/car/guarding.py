"""The guard process of a real car: started while the Nano boots, checked at each write.

On a real bus the guard writes neutral when this program dies or hangs. A simulated car in this
process needs none: its time stops with the program.
"""

from __future__ import annotations

import subprocess
import threading
from contextlib import suppress
from dataclasses import dataclass, replace

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BusError
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import Applied, Limit
from dart_hal.devices.actuation import Actuator, Guard
from dart_hal.devices.actuation.owner import lock_chip
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES
from dart_hal.devices.actuation.plan import OFF_DEMAND
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.i2c import open_bus

# s that the start of the guard may take on a busy machine.
MAX_GUARD_START_TIME = 15.0


def own_actuator(backend: Backend, files: CarFiles) -> None:
    """Reserve the PCA9685 of a real bus for this program until ``backend`` is closed.

    Raises PcaBusy, PcaClaimed.
    """
    spec = backend.url.options.get("i2c")
    if spec is not None and backend.bus is not None and not backend.virtual:
        backend.closers = (*backend.closers, lock_chip(spec, files.config.pwm.address))


@dataclass(frozen=True, slots=True)
class Hang:
    """A time [s] in which the guard wrote the pins, because this program hung.

    before: what they carried until then. neutral: throttle pulse of the guard [us].
    """

    start: float
    end: float
    before: Applied
    neutral: float

    def correct(self, applied: Applied, t: float) -> Applied:
        """Return what the pins carried at ``t``; ``applied``: what they carry after the hang.

        States of the hang are decoded after it, from the buffer of the port.
        """
        if t >= self.end:
            return applied
        if t < self.start:
            return self.before
        # Neutral, and no pulse after NEUTRAL_FRAMES of it.
        off = t >= self.start + NEUTRAL_FRAMES * PWM_FRAME
        return replace(self.before, throttle=0.0, throttle_us=0.0 if off else self.neutral,
                       steering_us=0.0 if off else self.before.steering_us,
                       limited=OFF_DEMAND.why if off else (Limit.NOT_ARMED.value,))


class GuardPost:
    """Starts the guard of a bus, and exchanges signs of life with it.

    spec: the bus (``1``, ``unix:/path``). actuator: open already. ``error``: why there is no guard.
    """

    def __init__(self, spec: str, actuator: Actuator) -> None:
        self.error: BusError | None = None
        self._guard: Guard | None = None
        self._actuator = actuator
        actuator.gate = self.gate
        self._start = threading.Thread(target=self._run, args=(spec,), name="dart-hal guard",
                                       daemon=True)
        self._start.start()

    def _run(self, spec: str) -> None:
        """Start the guard process."""
        actuator = self._actuator
        neutral = int(actuator.neutral_us / actuator.pca.count_us)
        try:
            self._guard = Guard(spec, open_bus, address=actuator.car.pwm.address,
                                channel=actuator.car.throttle.channel, neutral_counts=neutral)
        except BusError as error:
            self.error = error
        except OSError as error:
            self.error = BusError("the guard process does not start", found=str(error))

    def ready(self) -> None:
        """Wait until the guard runs, or cannot be started."""
        self._start.join(MAX_GUARD_START_TIME)

    @property
    def age(self) -> float | None:
        """Return the time [s] since the guard's last sign of life; None: there is no guard."""
        return self._guard.age if self._guard is not None else None

    @property
    def tripped(self) -> bool:
        """Return whether the guard has found this program hanging and writes neutral itself."""
        return self.age is not None and self._guard is not None and self._guard.tripped

    @property
    def writes(self) -> bool:
        """Return whether the guard has tripped, and the bus has taken all that it wrote."""
        return self.tripped and self._guard is not None and not self._guard.failed

    def gate(self) -> str | None:
        """Return why no throttle may be written now; None: it may."""
        return self._guard.gate() if self._guard is not None else "GUARD_SILENT"

    def beat(self, *, at_neutral: bool, off: bool = False) -> None:
        """Send a sign of life; at neutral, also acknowledge a trip of the guard.

        off: the pulses are off, and the guard must keep them off.
        """
        if self._guard is None:
            return
        if at_neutral and self._guard.tripped:
            self._guard.acknowledge()
            self._actuator.renew_watch_pulse()
        self._guard.beat(off=off)

    def close(self, *, at_neutral: bool) -> None:
        """End the guard. Without neutral on the pins it goes on trying for a while."""
        self.ready()
        guard, self._guard = self._guard, None
        if guard is not None and at_neutral:
            with suppress(subprocess.TimeoutExpired):
                guard.close()
        elif guard is not None:
            guard.leave()
