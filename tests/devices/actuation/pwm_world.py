"""A PCA9685 register model in a world whose time moves only by sleeping."""

from __future__ import annotations

from pathlib import Path

import msgspec

from dart_hal.core.config import Calibration, CarFiles, Quantity, parse_config
from dart_hal.devices.actuation import Actuator
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.pca9685 import Pca9685Model as Chip

EXAMPLE = Path(__file__).parents[3] / "cars" / "dart-01" / "car.toml"


def car_files(oscillator_hz: float | None = 25e6, **limits: float | None) -> CarFiles:
    """The example car, free of slew limits, with a measured clock unless None."""
    car = parse_config(EXAMPLE.read_text(encoding="utf-8"), "car.toml")
    free = {"steering_slew": None, "throttle_slew": None, "max_throttle": 1.0,
            "min_throttle": -1.0, **limits}
    car = msgspec.structs.replace(car, limits=msgspec.structs.replace(car.limits, **free))
    cal = Calibration(car=car.name)
    if oscillator_hz is not None:
        cal = cal.with_quantities({"pwm.oscillator_hz": Quantity(oscillator_hz, 1e3)})
    return CarFiles(car, cal, None, Path("cars"), "car.toml")


class World:
    """Chip, bus and time; ``pulses`` are read from the pins, never from registers."""

    def __init__(self, oscillator_hz: float = 25e6, update: str = "next_frame") -> None:
        self.t = 0.0
        self.chip = Chip(oscillator=oscillator_hz, update=update)
        self.bus = VirtualBus(lambda: self.t, [self.chip])
        self._pulses: dict[int, list[tuple[float, float]]] = {}

    def sleep(self, seconds: float) -> None:
        self.t += seconds

    def write(self, *data: int) -> None:
        """A write by some other program."""
        self.bus.writeto(0x40, bytes(data))
        self.t += 0.01

    def pulses(self, channel: int) -> list[tuple[float, float]]:
        """(rise [s], length [us]) of every pulse so far."""
        self.chip.output.advance(self.t)
        found = self._pulses.setdefault(channel, [])
        found += [(rise, (fall - rise) * 1e6) for rise, fall in self.chip.output.take(channel)]
        return list(found)

    def actuator(self, files: CarFiles | None = None, **options: object) -> Actuator:
        return Actuator(files or car_files(), self.bus, self.sleep, **options)

    def run(self, actuator: Actuator, frames: int) -> None:
        """Frames of 20 ms, as the owner's loop gives them."""
        for _ in range(frames):
            actuator.frame(self.t)
            self.t += 0.02

    def abandoned(self, prescale: int = 121, pulse_counts: int = 338, sleeping: bool = False,
                  auto_increment: bool = True) -> None:
        """State left by a program that died at throttle 0.33 (338 counts = 1649 us)."""
        self.write(0xFE, prescale)
        self.write(0x00, 0x20)
        self.t += 0.001
        self.write(0x06, 0, 0, 0x33, 0x01, 0, 0, pulse_counts & 0xFF, pulse_counts >> 8)
        self.write(0x00, 0x20 * auto_increment + 0x10 * sleeping)
        self.t += 0.1
