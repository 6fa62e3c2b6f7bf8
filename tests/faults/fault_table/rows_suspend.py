"""A suspend of the computer, with CLOCK_MONOTONIC that does not advance meanwhile."""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.core.ports import Chunk
from dart_hal.core.process.suspend import SuspendDetector
from fault_table.bench import Bench
from fault_table.drive import Drive, forward
from fault_table.row import Measured, Row, case
from fault_table.rows_pins import MS, PULSE

ASLEEP = 3.0
"""s."""


class StoodStill:
    """The clocks of a computer that was asleep: the car's ages as on CLOCK_MONOTONIC, the worst.

    The world and the car go on; program, guard and pump do not, and read what has come when they
    wake. ``missed`` [s]: what their clock does not know of; ``woke`` [s] of the world.
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self.missed = self.woke = 0.0
        backend = drive.backend
        clock = backend.clock
        link = backend.link
        now = clock.now
        read = link.read
        self._sleep = clock.sleep

        def read_late(timeout: float) -> Chunk | None:
            chunk = read(timeout)
            return None if chunk is None else Chunk(
                chunk.data, max(chunk.t, self.woke) - self.missed)

        clock.now = lambda: now() - self.missed  # type: ignore[method-assign]
        link.read = read_late  # type: ignore[method-assign]
        drive.car._engine.driver.suspend = SuspendDetector(
            lambda: drive.world.t, lambda: drive.world.t - self.missed)

    def suspend(self) -> float:
        """Returns when it wakes [s of the world]."""
        self._sleep(ASLEEP)
        self.missed += ASLEEP
        self.woke = self.drive.now
        return self.drive.now


def suspend_computer(options: str) -> Callable[[Bench], Measured]:
    """Last driving pulse after the computer has woken; the program goes on asking."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options)
        clocks = StoodStill(drive)
        drive.driving()
        at = clocks.suspend()
        drive.run(1.5, forward(0.4, 0.5))
        return Measured(drive.last_wrong(at), f"{drive.car.mode} {', '.join(drive.car.causes)}")
    return measure


ROWS = (
    Row(59, "the computer is suspended for 3 s while the car drives", "disarmed when it wakes", (
        case("mock", "no cut-off", suspend_computer(""), 40 + PULSE, MS, "suspend", fast=True),
    )),
)
