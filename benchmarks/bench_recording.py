"""What a recording costs: CPU and bytes for a second of driving."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from figures import Figure

from dart_hal.core.types import Applied, Health, Pose, State
from dart_hal.recording.run import RunWriter

SECONDS = 20.0
RUNS = 5
FRAME = bytes(range(48))


def record(path: Path, seconds: float) -> float:
    """Write what a car writes: 100 States, 50 pulses, commands and bus writes a second, and the
    bytes of both ways. Returns the CPU time [s]."""
    health = Health(frozenset({"IMU_VALID", "BEAT_OK"}), 0.005, 0.01, 0, 0, None, 1e-4, "linear",
                    (3, 3, 3, 0))
    path.unlink(missing_ok=True)
    begin = time.process_time()
    with RunWriter(path, url="sim://", car="bench") as writer:
        for k in range(round(100 * seconds)):
            t = 0.01 * k + 1 / 3
            writer.rx(FRAME, t)
            writer.rx(FRAME[:20], t)
            applied = Applied(0.1, 0.2, 1500.0 + k % 50, 1590.0, ("SLEW",))
            if k % 2 == 0:
                writer.tx(FRAME[:24], t)
                writer.command(t, 0.01, 0.5)
                writer.i2c(0x40, FRAME[:9], t)
                writer.applied(t, applied)
            writer.state(State(t=t, seq=k, speed=0.1, speed_std=0.01, yaw_rate=0.1, accel_x=-0.2,
                               accel_y=0.5, ticks=5 * k, pose=Pose(0.1 * k, -0.2, 3.3),
                               applied=applied, health=health))
    return time.process_time() - begin


def cost(scale: float = 1.0) -> tuple[float, float]:
    """(CPU time, bytes) of a second of driving; of the time the least of some runs."""
    seconds = SECONDS * scale
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        best = min(record(path, seconds) for _ in range(RUNS))
        return best / seconds, path.stat().st_size / seconds


def figures(scale: float = 1.0) -> list[Figure]:
    cpu, size = cost(scale)
    return [Figure("recording, CPU per second of driving", 1e3 * cpu, "ms"),
            Figure("recording, per second of driving", 1e-3 * size, "kB")]


if __name__ == "__main__":
    print("{:.2f} ms, {:.0f} bytes for a second of driving".format(
        *(factor * value for factor, value in zip((1e3, 1.0), cost(), strict=True))))
