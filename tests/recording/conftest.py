"""A small run, written to order."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dart_hal.core.types import Applied, Health, Pose, State
from dart_hal.recording.run import RunWriter
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HELLO, STATE, TIME_PING

HELLO_VALUES = {
    "proto": 1, "req_seq": 0, "schema": 0x12345678, "fw_version": [1, 0, 0], "build": 0,
    "git": 1, "board_id": 0xDA27, "boot_count": 3, "reset_cause": 2, "bootloader": 0,
    "boot_nonce": 77, "edges_per_rev": [20, 10], "caps": 0, "clock_hz": 2_000_000,
    "param_crc": 9,
}
THIRD = 1 / 3 + 0.7e-9  # no whole number of nanoseconds


def state_frame(seq: int, k: int) -> bytes:
    """STATE number ``k`` of a car at 1 m/s with 2 mm edges."""
    t = 20_000 * (k + 1)
    values = (t, 5 * k, t - 900, 4000, 0, 0, 0, 0, 0, 0, 0, 90, 1250, 0xFF, 1, 10)
    return encode(STATE, seq, values)


def make_state(k: int, **changes: Any) -> State:
    values: dict[str, Any] = {
        "t": THIRD + 0.01 * k, "seq": k, "speed": 1.0 / 7 * k, "speed_std": 0.01,
        "yaw_rate": 0.1, "accel_x": -0.25, "accel_y": 0.5, "ticks": 5 * k,
        "pose": Pose(0.1 * k, -0.2, 3.3),
        "applied": Applied(0.1, 0.2, 1537.5, 1590.0, ("SLEW",)),
        "health": Health(frozenset({"IMU_VALID", "BEAT_OK"}), 0.005, 0.01, 0, 0, None, 1e-4,
                         "linear", (3, 3, 3, 0))}
    return State(**{**values, **changes})


def write_run(path: Path, frames: int = 20, *, close: bool = True, hello: bool = True,
              note_hello: bool = False, now: float | None = None) -> RunWriter:
    """HELLO, then a frame each 10 ms; a ping, a command and a pulse now and then."""
    writer = RunWriter(path, url="sim://?seed=1", car="sim-1", start=0.25, now=now,
                       files={"car.toml": "name = 'sim-1'\n"}, versions={"dart_hal": "0.1.0"})
    if note_hello:
        writer.hello(HELLO_VALUES)
    if hello:
        writer.rx(encode(HELLO, 255, HELLO_VALUES), 0.3)
    for k in range(frames):
        t = THIRD + 0.01 * k
        writer.rx(state_frame(k, k), t)
        if k % 5 == 0:
            writer.tx(encode(TIME_PING, k, {"ping_id": k, "host_us": int(t * 1e6)}), t)
            writer.command(t, 0.01 * k, 0.5)
            writer.i2c(0x40, bytes((6, 0, k)), t, b"\x20")
            writer.applied(t, Applied(0.01 * k, 0.25, 1500.0 + k, 1612.5, ("RANGE",)))
        writer.state(make_state(k))
    if close:
        writer.close()
    return writer


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    write_run(path)
    return path


@pytest.fixture
def writing() -> Callable[..., RunWriter]:
    return write_run


@pytest.fixture
def state() -> Callable[..., State]:
    return make_state


@pytest.fixture
def frame_of() -> Callable[[int, int], bytes]:
    return state_frame
