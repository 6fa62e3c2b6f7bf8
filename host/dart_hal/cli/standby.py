"""``dart-hal standby``: end the pulses when no program drives. The service on the car runs it."""

from __future__ import annotations

import time
from contextlib import suppress
from math import inf
from pathlib import Path

import click

from dart_hal.car.exit_signals import stop_on_signals
from dart_hal.cli.common.options import FiniteNumber, car_options, json_option
from dart_hal.cli.common.output import console, print_json
from dart_hal.cli.stop import open_throttle, require_real_car
from dart_hal.core.errors import BusError
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.standby import POLL_INTERVAL, Throttle, Watchman
from dart_hal.devices.links.holder import holder, port_of
from dart_hal.devices.links.notify import notify


@click.command("standby")
@car_options
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="seconds until it ends (default: run until stopped)")
@json_option
def command(url: str | None, car_name: str, cars: Path | None, duration: float | None,
            as_json: bool) -> None:
    """End the pulses of ESC and servo whenever no program drives: 0.2 s of neutral, then none.

    It never arms and never wakes a PCA9685 that sleeps. It notifies systemd (ready, watchdog,
    status) and leaves the serial port free for programs that drive.
    """
    address = require_real_car(url)
    throttle, _ = open_throttle(address, car_name, cars)
    stop_on_signals()
    post = StandbyService(throttle)
    notify("READY=1")
    end = elapsed() + (duration or inf)
    try:
        while (now := elapsed()) < end:
            # Resolved in each round: a Nano that is plugged in again may get another name.
            port = port_of(address)
            post.step(holder(port) if port else None, now)
            notify("WATCHDOG=1")
            # Neutral is written frame by frame. A slower poll is enough if nothing is to be
            # written, and after a bus error.
            time.sleep(PWM_FRAME if post.watch.owed and post.error is None else POLL_INTERVAL)
    finally:
        post.close()
    if as_json:
        print_json({"url": address.text, "departures": post.departures})


class StandbyService:
    """Watches which program drives, writes neutral when none does, and reports changes.

    ``error``: why neutral cannot be written. A board without power sends no pulses.
    """

    def __init__(self, throttle: Throttle) -> None:
        self.watch = Watchman()
        self.departures = 0
        self.error: str | None = None
        self._throttle = throttle
        self._reported = ""

    def step(self, driver: int | None, now: float) -> None:
        """Enter the pid of the program that drives [or None], and write neutral if it is due."""
        # A pid that disappears is a program that ended, perhaps killed: the pulses are its last.
        previous = self.watch.driver
        self.watch.note_driver(driver)
        if previous is not None and driver is None:
            self.departures += 1
            self._report(f"pid {previous} no longer drives: neutral")
        if self.watch.due(now):
            self._write(now)
        if self.error is None:
            self._report(f"pid {driver} drives" if driver is not None else
                         "neutral" if self.watch.owed else "no program drives, no pulses")

    def close(self) -> None:
        """End the pulses if the service ends while it writes neutral."""
        if self.watch.owed:
            with suppress(BusError):
                self._throttle.switch_off()

    def _write(self, now: float) -> None:
        """Write neutral, or end all pulses; a bus error is kept and the write repeated."""
        try:
            if self.watch.switches_off:
                self._throttle.switch_off()
            else:
                self._throttle.rest()
            self.error = None
        except BusError as error:
            self.error = f"{error.what}; tried again"
            self._report(self.error)
        self.watch.note_write(self.error is None, now)

    def _report(self, line: str) -> None:
        """Report a line to systemd and the journal, if it is not the last one."""
        if line != self._reported:
            self._reported = line
            notify(f"STATUS={line}")
            console.print(line, markup=False, highlight=False)
