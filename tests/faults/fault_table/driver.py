"""A program that drives, and then does what its mode names: the driver of the rows with processes.

    python driver.py URL CAR CARS HOW

Prints "driving" when the pins carry a throttle, then reads a line; on "now" it
prints "at STAMP" (CLOCK_MONOTONIC) and does HOW. Ends with an error where no
throttle came within ``PATIENCE``.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from contextlib import suppress

from dart_hal.car import Car
from dart_hal.core.errors import LinkLost, NotArmed
from fault_table import switches, switches_nano  # noqa: F401 - the layers that may be gone
from fault_table.drive import WAIVED
from fault_table.layers import inherit
from fault_table.stand import RIG_TIMEOUT_S

THROTTLE = 0.3
LONG_BLOCK_S = 3.0
ESC_STARTS = 2.2
"""s of neutral after which every ESC obeys: one that does not looks like a dead encoder."""


def report(*words: object) -> None:
    print(*words, flush=True)


def hog() -> None:
    """One call that keeps the interpreter to itself."""
    begin = time.monotonic()
    while time.monotonic() - begin < LONG_BLOCK_S:
        sum(range(40_000_000))


def fork() -> None:
    """A worker, as a data loader forks it; it lives on."""
    worker = os.fork()
    if worker == 0:
        while True:
            time.sleep(1.0)
    report("worker", worker)


def block(car: Car) -> None:
    """A listener that never comes back."""
    car.on_state(lambda state: time.sleep(1e6))


HOW = {
    "patient": lambda car: None,
    "wait": lambda car: None,
    "segfault": lambda car: ctypes.string_at(0),
    "exit": lambda car: os._exit(3),
    "exec": lambda car: os.execv("/bin/sleep", ["sleep", "5"]),
    "stall": lambda car: time.sleep(LONG_BLOCK_S),
    "hog": lambda car: hog(),
    "fork": lambda car: fork(),
    "listener": block,
    "error": lambda car: 1 / 0,
}


def main(url: str, name: str, cars: str, how: str) -> None:
    requested = threading.Event()
    signal.signal(signal.SIGHUP, signal.SIG_DFL)    # a suite under nohup hands down "ignore"

    def listen() -> None:
        for order in sys.stdin:
            if order.strip() == "now":
                requested.set()
        os._exit(0)     # the suite is gone: an orphan would find the next car by its number

    with Car.open(url, car=name, cars=cars or None, raise_on_trip=False) as car:
        threading.Thread(target=listen, daemon=True).start()
        driven = 0
        done = False
        reported = False
        deadline = time.monotonic() + RIG_TIMEOUT_S
        with suppress(LinkLost):
            for _ in car.states(duration=ESC_STARTS, timeout=20.0):
                pass
        while True:
            if not reported and time.monotonic() > deadline:
                sys.exit(f"no throttle within {RIG_TIMEOUT_S:.0f} s: {car.mode} {car.causes}")
            with suppress(NotArmed, LinkLost):
                if not reported and car.mode != "ARMED":      # later trips are not healed
                    driven = 0
                    car.arm(waive=WAIVED)
            if how == "patient" and reported:
                time.sleep(0.5)
            with suppress(LinkLost):
                for state in car.states(timeout=20.0):
                    if requested.is_set() and not done:
                        done = True
                        report("at", time.monotonic())
                        HOW[how](car)
                    car.drive(throttle=THROTTLE, valid_for=0.5)
                    driven += state.applied.throttle > 0.2
                    if driven > 20 and not reported:
                        reported = True
                        report("driving")
                    if not reported and (car.mode != "ARMED" or time.monotonic() > deadline):
                        break


if __name__ == "__main__":
    with inherit():
        main(*sys.argv[1:5])
