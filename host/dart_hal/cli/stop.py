"""``dart-hal stop``: end the pulses of a car, from any terminal or when a service ends."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import click

from dart_hal.cli.common.options import car_options, json_option
from dart_hal.cli.common.output import console, print_json, results
from dart_hal.core.config import load_car
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import Bus
from dart_hal.core.url import Url
from dart_hal.devices.actuation.owner import refuse_claimed
from dart_hal.devices.actuation.standby import Throttle, stop
from dart_hal.devices.links.computers import resolve_bus
from dart_hal.devices.links.holder import holder, port_of
from dart_hal.devices.links.i2c import open_bus


@click.command("stop")
@car_options
@json_option
def command(url: str | None, car_name: str, cars: Path | None, as_json: bool) -> int:
    """End the pulses of ESC and servo, also of another program; exit 1 if that continues to drive.

    Sends 0.2 s of neutral, then no pulse on any channel. Needs only the I2C bus, no Nano. The
    program that drives receives a request to end.
    """
    address = require_real_car(url)
    throttle, bus = open_throttle(address, car_name, cars)
    port = port_of(address)
    # Read again in each step: the driver may end on its own, or another may begin.
    outcome = stop(throttle, lambda: holder(port) if port else None, time.sleep)
    close = getattr(bus, "close", None)
    if close is not None:
        close()
    if as_json:
        print_json({"url": address.text, **asdict(outcome)})
    else:
        before = _describe_throttle(outcome.found_us)
        results.print(f"{_describe_pulses(outcome.left_us)} (throttle was {before})"
                      + (f"; pid {outcome.ended} was requested to end" if outcome.ended else ""))
    if outcome.driver is None and outcome.at_rest:
        return 0
    console.print(f"the car is still driven; try: sudo kill -9 {outcome.driver or 'PID'}",
                  style="red")
    return 1


def _describe_throttle(pulse_us: float) -> str:
    return f"at {pulse_us:.0f} us" if pulse_us else "off"


def _describe_pulses(pulse_us: float) -> str:
    return f"throttle at {pulse_us:.0f} us" if pulse_us else "no pulse for ESC and servo"


def require_real_car(url: str | None) -> Url:
    """Return the URL of a real car. Raises UsageError for a simulated one, BusMissing."""
    address = Url.parse(url or "sim://")
    if address.scheme not in ("serial", "hwgrep"):
        raise UsageError(f"{address.scheme}:// ends with its program: there is nothing to stop",
                         found=address.text, expected="serial:///dev/dart-nano?i2c=1",
                         remedy="export DART_HAL_URL='serial:///dev/ttyUSB0?i2c=1'")
    address.known("i2c", "baud")
    return resolve_bus(address)


def open_throttle(address: Url, car_name: str, cars: Path | None) -> tuple[Throttle, Bus]:
    """Open the throttle of a car and its I2C bus, without the serial port.

    Raises ConfigError, BusError, UsageError, PcaClaimed.
    """
    files = load_car(car_name, [cars] if cars else None)
    # The bus of the URL, else that of car.toml.
    spec = address.options.get("i2c", str(files.config.pwm.bus))
    bus = open_bus(spec)
    refuse_claimed(spec, files.config.pwm.address)
    return Throttle(files, bus, time.sleep), bus
