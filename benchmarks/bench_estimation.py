"""Estimators: time per frame, error of wheel speed, error of the clock.

    python benchmarks/bench_estimation.py [--json]

Wheels and links are simulated by the same code as in tests/estimation.
"""

from __future__ import annotations

import importlib.util
import json
import math
import platform
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from dart_hal.core.types import ExternalPose
from dart_hal.estimation import ClockFit, ExternalPoseEstimator, FrameReader, Odometry, WheelSpeed
from dart_hal.estimation.pose_tracking import PoseTracker

METRES, EDGES = 0.00206459, 20
FRAMES = 20_000
WIRE = 44 * 10 / 500_000


def simulation() -> ModuleType:
    """The simulated wheels and links of the tests."""
    path = Path(__file__).parent.parent / "tests" / "estimation" / "conftest.py"
    spec = importlib.util.spec_from_file_location("estimation_simulation", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def cpu_us(work: Callable[[], object], count: int, repeats: int = 5) -> tuple[float, float]:
    """(best, worst) CPU time per item [us]."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append((time.process_time() - start) / count * 1e6)
    return min(times), max(times)


def cost() -> dict[str, tuple[float, float]]:
    """CPU time per frame [us] of each stage at 2 m/s, turning."""
    rng = random.Random(1)
    rows = []
    for k in range(FRAMES):
        t = 0.01 * k
        count = int(2.0 * t / METRES)
        edge = count * METRES / 2.0
        rows.append(((int(t * 2e6) % 2**32, count, int(edge * 2e6) % 2**32, 2064, 0, 0, 0, 0, 0,
                      5, 3, 900, 500, 255, 1, 3), t + WIRE + 1e-3 * rng.random()))
    reader = FrameReader()
    samples = [reader.read(*row) for row in rows]

    def frames() -> None:
        fresh = FrameReader()
        for values, t in rows:
            fresh.read(values, t)

    def clock() -> None:
        fit = ClockFit()
        for sample, (_, t) in zip(samples, rows, strict=True):
            fit.add_frame(sample.t_dev, t, WIRE)
            fit.to_host(sample.t_dev)

    def speed() -> None:
        wheel = WheelSpeed(METRES, EDGES)
        for s in samples:
            wheel.update(s.ticks, s.edge_t, s.edge_dt, s.t_dev, 1.0, 1)

    def odometry() -> None:
        pose = Odometry()
        for s in samples:
            pose.update(s.t_dev, 2.0 * s.t_dev, 2.0, s.gyro[2] if s.gyro else None, s.imu_t)
            pose.pose  # noqa: B018

    return {work.__name__: cpu_us(work, FRAMES) for work in (frames, clock, speed, odometry)}


def cost_in_a_room(rate: int) -> dict[str, tuple[float, float]]:
    """CPU time per frame [us] of what external poses add, at 2 m/s along a circle, 10 ms late.

    tracking: which poses are believed; room: that and the Kalman filter. rate [Hz]: of the poses.
    """
    reckoned, count = Odometry(), 2000
    rows = []
    for k in range(count):
        t, turn = 0.01 * k, 0.01 * k
        motion = reckoned.update(t, 2.0 * t, 2.0, 1.0, t - 0.004)
        external = ExternalPose(t, t + 0.01, 2.0 * math.sin(turn), 2.0 - 2.0 * math.cos(turn), turn)
        rows.append((t, reckoned.pose, motion, external if k % (100 // rate) == 0 else None))

    def tracking() -> None:
        tracker = PoseTracker()
        for t, pose, _, external in rows:
            tracker.update(t, pose)
            if external is not None:
                tracker.add(external)
            tracker.estimate_at(t)

    def room() -> None:
        estimator = ExternalPoseEstimator(Odometry())
        for t, pose, motion, external in rows:
            estimator.update(t, pose, motion)
            if external is not None:
                estimator.add(external)

    return {work.__name__: cpu_us(work, count, 3) for work in (tracking, room)}


def speed_rows(sim: ModuleType) -> dict[str, dict[str, float]]:
    """rms error [m/s]: even ring, uneven ring, uneven ring with its table, upstream."""
    rng = random.Random(1)
    raw = [1 + rng.gauss(0, 0.03) + (0.12 if i % 2 else -0.12) for i in range(10)]
    ring = [f * 10 / sum(raw) for f in raw]
    profiles = {f"{v:g} m/s": ((lambda t, v=v: v), (lambda t, v=v: v * t))
                for v in (5.0, 3.0, 2.0, 1.0, 0.3, 0.04)}
    profiles["1.5 + sin(pi t)"] = (
        lambda t: 1.5 + math.sin(math.pi * t),
        lambda t: 1.5 * t + (1 - math.cos(math.pi * t)) / math.pi)
    ten = {"metres": 0.00412918, "n": 10, "duration": 16.0}
    rows = {}
    for name, profile in profiles.items():
        rows[name] = {
            "even 20": sim.simulate_speed(*profile, metres=METRES, n=EDGES, duration=8.0).rms,
            "uneven 10": sim.simulate_speed(*profile, true_ring=ring, **ten).rms,
            "with table": sim.simulate_speed(*profile, true_ring=ring, table=ring, **ten).rms,
            "count per 0.1 s": sim.simulate_speed(*profile, true_ring=ring, upstream=True,
                                                  **ten).rms}
    return rows


def clock_rows(sim: ModuleType) -> dict[str, dict[str, float]]:
    """p99 error of host time [ms] by share of disturbed frames; worst of 5 seeds."""
    rows = {}
    for disturbed in (0.01, 0.05, 0.3):
        runs = [sim.simulate_clock(disturbed, seed, duration=60.0) for seed in range(5)]
        rows[f"{disturbed:.0%} disturbed"] = {
            "hull": 1e3 * max(sim.p99(r.late) for r in runs),
            "hull, 3 to 20 s, max": 1e3 * max(max(map(abs, r.early)) for r in runs),
            "arrival": 1e3 * max(sim.p99(r.arrival) for r in runs),
            "rate, ppm": 1e6 * max(abs(r.rate_error) for r in runs)}
    return rows


def table(title: str, rows: dict[str, dict[str, float]]) -> None:
    columns = list(next(iter(rows.values())))
    print(f"\n| {title} | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{row[c]:.3g}" for c in columns) + " |")


def main() -> None:
    sim = simulation()
    costs = {name: {"best": best, "worst": worst} for name, (best, worst) in cost().items()}
    costs["all"] = {key: sum(c[key] for c in costs.values()) for key in ("best", "worst")}
    result = {"machine": platform.processor() or platform.machine(),
              "python": platform.python_version(), "cpu_us_per_frame": costs,
              "speed_rms_m_s": speed_rows(sim), "clock_ms": clock_rows(sim)}
    if "--json" in sys.argv:
        print(json.dumps(result))
        return
    print(f"Python {result['python']} on {result['machine']}, CPU time, {FRAMES} frames, 5 runs")
    table("CPU us per frame", costs)
    table("rms error of the speed, m/s", result["speed_rms_m_s"])
    table("error of host time, ms", result["clock_ms"])


if __name__ == "__main__":
    main()
