"""A program that drives two emulated cars in real time, and reports the pulses of their ESCs.

    python fleet_program.py ROOM SEED OUT.json     ends with its standard input
    OUT.json: {car: [[time.monotonic(), us], ...]}
"""

from __future__ import annotations

import json
import sys
import threading
import time
from functools import partial
from pathlib import Path

from dart_hal import errors
from dart_hal.car import Fleet
from dart_lab.sim.truth import world_of

MAX_ARM_TRIES = 20


def arm(fleet):
    """A busy computer leaves gaps in the frames: arm as soon as a second had none."""
    for _ in range(MAX_ARM_TRIES - 1):
        try:
            return fleet.arm()
        except errors.NotArmed:
            for _ in fleet.states(duration=1.0):
                pass
    return fleet.arm()


def note_pulse(pulses, channel, pulse):
    if channel == 1:
        pulses.append((time.monotonic(), (pulse[1] - pulse[0]) * 1e6))


def main(room, seed, out):
    urls = [f"sim://?nano=mock&pace=1&seed={int(seed) + n}" for n in range(2)]
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    with Fleet.open(urls, room=room, raise_on_trip=False) as fleet:
        pins = {car.files.config.name: [] for car in fleet.cars}
        for car, pulses in zip(fleet.cars, pins.values(), strict=True):
            world_of(car._engine.backend).watchers.append(partial(note_pulse, pulses))
        arm(fleet)
        for _ in fleet.states():
            for car in fleet.cars:
                car.drive(steering=0.1, throttle=0.3)
            if ended.is_set():
                break
    Path(out).write_text(json.dumps(pins))


if __name__ == "__main__":
    main(*sys.argv[1:])
