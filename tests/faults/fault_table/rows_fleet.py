"""Rows of a car in a room of cars: it is stopped from there, or nobody watches it any more."""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.car import join
from dart_hal.fleet.station import Station
from fault_table.bench import Bench
from fault_table.drive import forward
from fault_table.row import Measured, Row, case
from fault_table.rows_pins import MS, PULSE

BEAT = 0.3
"""s of silence that the car allows."""
LOOK = 10.0
"""ms from one State, at which the car looks into its room, to the next."""


def stopped(nano: str, loss: float) -> Callable[[Bench], Measured]:
    """Last driving pulse after a STOP through a room that loses frames; the program drives on."""
    def measure(bench: Bench) -> Measured:
        worst, told = 0.0, 0
        for seed in range(12 if bench.full else 2):
            drive = bench.drive(nano=nano)
            room = f"local://fault-{nano}-{loss}-{seed}?loss={loss}&seed={seed}"
            with (join(drive.car, room, name="red"),
                  Station(room, "base", now=lambda car=drive.car: car.now) as station):
                drive.driving()
                drive.run(0.1 + 0.01 * seed, forward(0.4))
                at = drive.now
                call = station.call_stop("fault table")

                def both(car, state, station=station):
                    station.press()
                    car.drive(throttle=0.4)

                drive.run(1.0, both)
                worst, told = max(worst, drive.last_wrong(at)), told + len(call.answered)
        return Measured(worst, f"{told} answered, then {drive.car.mode}")
    return measure


def unwatched(nano: str) -> Callable[[Bench], Measured]:
    """Last driving pulse after the last beat of who watches the room."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(nano=nano)
        room = f"local://watched-{nano}"
        with (join(drive.car, room, name="red", beat_within=BEAT),
              Station(room, "base", now=lambda: drive.car.now) as station):
            drive.car.on_state(lambda state: station.watch() if alive else None)
            alive = True
            drive.driving()
            alive, at = False, drive.now
            drive.run(1.5, forward(0.4))
            return Measured(drive.last_wrong(at), drive.car.mode)
    return measure


ROWS = (
    Row(47, "all cars of a room are stopped, at 50 % loss", "trip, neutral, answered", (
        case("mock", "no loss", stopped("mock", 0.0), LOOK + PULSE + 10.0, MS, "run_stop",
             fast=True),
        case("mock", "50 % loss", stopped("mock", 0.5), 150.0, MS, "run_stop"),
        case("elf", "no loss", stopped("avr", 0.0), LOOK + PULSE + 10.0, MS, "run_stop"),
    )),
    Row(48, "nobody watches the room any more", "trip, neutral after 0.3 s", (
        case("mock", "silence", unwatched("mock"), 1e3 * BEAT + 50.0 + LOOK + PULSE, MS,
             "beat_within", fast=True),
    )),
)
"""Limits: a State, the pulse under way, one State more until the Nano's line has carried it (47);
the silence counts from a beat up to 50 ms old (48). At 50 % loss ten STOPs, 10 ms apart, are lost
one time in a thousand."""
