"""Recordings without motion capture: hidden drives with the columns of the mocap taken off."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dart_hal.recording.dart import Messages, Recording
from dart_hal.vehicle import PAPER
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.onboard_drive import prepare_stretches
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read

SENSORS = 10  # columns


def without_mocap(path):
    """The same file as schema A: each message once, sensors and commands alone."""
    head, *lines = Path(path).read_text().splitlines()
    rows = [",".join(head.split(",")[:SENSORS])]
    last = None
    for line in lines:
        cells = line.split(",")[:SENSORS]
        if float(cells[0]) != 0.0 and cells[0] != last:
            rows.append(",".join(cells))
            last = cells[0]
    Path(path).write_text("\r\n".join(rows) + "\r\n", newline="")
    return path


def record_onboard(folder, p=PAPER, seed=0, seconds=60.0):
    path = folder / f"onboard_{seed}.csv"
    return read(without_mocap(hidden_drive.write(path, p, seed,
                                                 hidden_drive.Plan(seconds=seconds))))


def evidence(*recordings):
    return OnboardEvidence([o for r in recordings for o in prepare_stretches(r)], PAPER.body.l_r)


def make_recording(n=120, speed=1.0, **columns):
    """A recording by hand: n messages, one each 0.1 s, of a car that rolls straight on."""
    t = columns.pop("t", np.arange(n) * 0.1)
    given = {"throttle": 0.2, "steering": 0.0, "speed": speed, "yaw_rate": 0.0, "accel_x": 0.0,
             "accel_y": 0.0} | columns
    series = {k: np.array(np.broadcast_to(v, len(t)), dtype=float) for k, v in given.items()}
    segment = np.concatenate([[0], np.cumsum(np.diff(t) > 0.3)])
    messages = Messages(t=t, arrival=t, segment=segment, throttle_raw=series["throttle"],
                        gate=np.ones(len(t), dtype=bool), **series)
    return Recording(Path("made/by_hand.csv"), "A", messages, None, "ok", 0.04, "", ())
