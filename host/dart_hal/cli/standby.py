"""``dart-hal standby``: what the service on the car runs."""

from __future__ import annotations

import time
from math import inf
from pathlib import Path

import click

from dart_hal.car.exit_signals import stop_on_signals
from dart_hal.cli.common.options import Number, car_options, json_option
from dart_hal.cli.common.output import console, print_json
from dart_hal.cli.stop import reach, real
from dart_hal.core.errors import BusError
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.standby import LOOK_EVERY, Throttle, Watchman
from dart_hal.devices.links.holder import holder, port_of
from dart_hal.devices.links.notify import notify


@click.command("standby")
@car_options
@click.option("--duration", type=Number(min=0.1), default=None,
              help="seconds until it ends (default: run until stopped)")
@json_option
def command(url: str | None, car_name: str, cars: Path | None, duration: float | None,
            as_json: bool) -> None:
    """End the pulses of ESC and servo whenever no program drives: 0.2 s of neutral, then none.

    Never arms, never wakes a chip.

    Notifies systemd (ready, watchdog, status). The port stays free for drivers.
    """
    address = real(url)
    throttle, _ = reach(address, car_name, cars)
    stop_on_signals()
    post = Post(throttle)
    notify("READY=1")
    end = elapsed() + (duration or inf)
    while (now := elapsed()) < end:
        port = port_of(address)
        post.step(holder(port) if port else None, now)
        notify("WATCHDOG=1")
        time.sleep(PWM_FRAME if post.watch.owed and post.error is None else LOOK_EVERY)
    if as_json:
        print_json({"url": address.text, "departures": post.departures})


class Post:
    """One step of the watch, and a line for the journal when something changes.

    ``error``: why neutral cannot be written; a board without power drives nothing.
    """

    def __init__(self, throttle: Throttle) -> None:
        self.watch, self.departures = Watchman(), 0
        self.error: str | None = None
        self._throttle, self._said = throttle, ""

    def step(self, driver: int | None, now: float) -> None:
        """Look at who drives, and write neutral if it is due."""
        before = self.watch.driver
        self.watch.see(driver)
        if before is not None and driver is None:
            self.departures += 1
            self._say(f"pid {before} no longer drives: neutral")
        if self.watch.due(now):
            self._write(now)
        if self.error is None:
            self._say(f"pid {driver} drives" if driver is not None else
                      "neutral" if self.watch.owed else "no program drives, no pulses")

    def _write(self, now: float) -> None:
        try:
            if self.watch.switches_off:
                self._throttle.switch_off()
            else:
                self._throttle.rest()
            self.error = None
        except BusError as error:
            self.error = f"{error.what}; tried again"
            self._say(self.error)
        self.watch.wrote(self.error is None, now)

    def _say(self, line: str) -> None:
        if line != self._said:
            self._said = line
            notify(f"STATUS={line}")
            console.print(line, markup=False, highlight=False)
