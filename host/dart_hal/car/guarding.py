"""The guard process of a real car: started while the Nano boots, asked at each write.

A simulated car in this process needs none: its world stands still with the
program. On a real bus the guard writes neutral when this program dies or hangs.
"""

from __future__ import annotations

import subprocess
import threading
from contextlib import suppress

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BusError
from dart_hal.devices.actuation import Actuator, Guard
from dart_hal.devices.actuation.owner import own
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.i2c import open_bus

PATIENCE = 15.0
"""s that its start may take on a busy machine."""


def own_actuator(backend: Backend, files: CarFiles) -> None:
    """Let nobody else drive the PCA9685 of a real bus until ``backend`` is closed.

    Raises PcaBusy, PcaClaimed.
    """
    spec = backend.url.options.get("i2c")
    if spec is not None and backend.bus is not None and not backend.virtual:
        backend.closers = (*backend.closers, own(spec, files.config.pwm.address))


class GuardPost:
    """Starts a guard for the bus ``spec`` (``1``, ``unix:/path``) and keeps watch with it.

    Make it when the actuator is open. ``error``: why there is no guard.
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
        """Wait until the guard watches, or cannot be started."""
        self._start.join(PATIENCE)

    @property
    def age(self) -> float | None:
        """s since the guard last spoke; None = there is none."""
        return self._guard.age if self._guard is not None else None

    @property
    def tripped(self) -> bool:
        """Whether the guard has seen this program hang and writes neutral itself."""
        return self.age is not None and self._guard is not None and self._guard.tripped

    def gate(self) -> str | None:
        """Why no throttle may be written now; None = go on."""
        return self._guard.gate() if self._guard is not None else "GUARD_SILENT"

    def beat(self, *, at_neutral: bool, off: bool = False) -> None:
        """This program lives; at neutral, a trip of the guard is acknowledged.

        off: the pulses are off, and the guard must leave them off.
        """
        if self._guard is None:
            return
        if at_neutral and self._guard.tripped:
            self._guard.acknowledge()
        self._guard.beat(off=off)

    def close(self, *, at_neutral: bool) -> None:
        """Let the guard end; without neutral on the pins it tries for another while."""
        self.ready()
        guard, self._guard = self._guard, None
        if guard is not None and at_neutral:
            with suppress(subprocess.TimeoutExpired):
                guard.close()
        elif guard is not None:
            guard.leave()
