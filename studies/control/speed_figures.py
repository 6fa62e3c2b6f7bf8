"""How ``drive_speed`` answers on hidden cars, by their true speed.

    python -m studies.control.speed_figures --seeds 30 [--first 1] [--lag 0 0.084] [--plot PNG]

Three drives a car: a step from rest, a sine of 0.5 Hz between 0.5 and 2.5 m/s, forward and
back. Each on a car of which nothing is known, on one that ``calibrate all`` has measured, and on
one whose model was identified as well: the truth with errors of an identification. Some seconds a
car.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from msgspec.structs import replace as replace_table

from dart_hal.car import Car
from dart_hal.core.config import Calibration, DriveTable, Quantity, save_calibration, save_model
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.parameters import Delay, Vehicle
from dart_lab.sim.truth import world_of
from studies.calibration.hidden_errors import holding_pulse, true_sensors

IDENTIFIED, LATE_STD, NEUTRAL_STD = 0.02, 0.003, 1.0
"""Relative error of a force, s of a delay or lag, us of neutral: what is left after measuring."""
STEP, SINE, THERE = 1.0, (1.5, 1.0, 0.5), 0.8
"""m/s; mean and amplitude [m/s], Hz; m/s forward, 0.5 back."""
BACK = -0.5
LAGS = (0.0, 0.084)
KNOWN = ("nothing", "calibrated", "model")
"""Of the car: no file, calibration.toml, or model.toml and the neutral."""
CALIBRATED = {"throttle.deadband_forward_us": 0.3, "throttle.saturation_us": 2.0,
              "latency.pulse_to_wheel": 0.0015, "latency.pulse_to_wheel_lag": 0.002}
"""Standard errors of what the loop takes of a calibration."""
DRIVEN, DRIVEN_STD = (0.3, 0.5, 0.75, 1.0), 0.3
"""m/s that fit into 4 m, and us."""

Reference = Callable[[float], float]


def step(t: float) -> float:
    return STEP


def sine(t: float) -> float:
    mean, size, hertz = SINE
    return mean - size * float(np.cos(2.0 * np.pi * hertz * t)) if t > 0.0 else mean - size


def there_and_back(t: float) -> float:
    return THERE if t < 2.0 or t >= 4.5 else BACK


@dataclass(frozen=True, slots=True)
class Driven:
    """t [s] since the first command, true speed and reference [m/s], throttle; (n,) each."""

    t: np.ndarray
    speed: np.ndarray
    reference: np.ndarray
    throttle: np.ndarray
    limited: list[tuple[str, ...]]


def hidden_url(seed: int, lag: float) -> str:
    late = f"&effect=throttle_lag:{lag}" if lag else ""
    return f"sim://?seed={seed}&nano=mock{late}"


def identified(backend: Backend, seed: int, lag: float) -> Vehicle:
    """The vehicle that an identification would find: the truth with its errors."""
    car = world_of(backend).car
    rng = np.random.default_rng([seed, 77])

    def near(value: float, part: float = IDENTIFIED) -> float:
        return value * (1.0 + part * float(rng.normal()))

    def late(value: float) -> float:
        return max(value + LATE_STD * float(rng.normal()), 0.0)

    p, span = car.vehicle, 450.0 / car.esc.saturation_us
    motor = replace(p.motor, d=near(p.motor.d * span), e=near(p.motor.e * span),
                    g=near(p.motor.g / span))
    friction = replace(p.friction, a=near(p.friction.a), c=near(p.friction.c, 0.1))
    return replace(p, name=f"sim-{seed}", motor=motor, friction=friction, effects=(), delay=Delay(
        throttle_s=late(0.0), throttle_lag_s=late(lag), steering_s=late(car.servo.delay)))


def write_files(backend: Backend, seed: int, lag: float, known: str, cars: Path) -> None:
    """calibration.toml with the ESC's neutral; what else is ``known``: model.toml as identified, or
    what ``calibrate all`` measures on 4 m of floor."""
    car, folder = world_of(backend).car, cars / f"sim-{seed}"
    rng = np.random.default_rng([seed, 78])
    neutral = Quantity(car.esc.neutral_us + NEUTRAL_STD * float(rng.normal()), NEUTRAL_STD)
    measured = {"throttle.neutral_us": neutral}
    table = None
    if known == "calibrated":
        true = true_sensors(hidden_url(seed, lag))
        measured |= {name: Quantity(true[name] + std * float(rng.normal()), std)
                     for name, std in CALIBRATED.items()}
        table = DriveTable(speed=DRIVEN, std_us=(DRIVEN_STD,) * len(DRIVEN), pulse_us=tuple(
            holding_pulse(seed, v) + DRIVEN_STD * float(rng.normal()) for v in DRIVEN))
    cal = Calibration(car=folder.name).with_quantities(measured)
    save_calibration(replace_table(cal, throttle=replace_table(cal.throttle, drive=table)), folder)
    if known == "model":
        save_model(model_of(identified(backend, seed, lag)), folder / "model.toml")


def driven(seed: int, lag: float, known: str, reference: Reference, seconds: float,
           steering: float = 0.15, waits: float = 0.0) -> Driven:
    """One drive of a hidden car; ``waits`` s at reference(0) come before t = 0."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        if known != "nothing":
            backend = open_backend(hidden_url(seed, lag))
            write_files(backend, seed, lag, known, Path(folder))
            backend.close()
        backend = open_backend(hidden_url(seed, lag))
        with Car.over(backend, cars=folder) as car:
            world = world_of(backend)
            car.arm()
            start = None
            for state in car.states(duration=seconds + waits):
                start = state.t if start is None else start
                t = state.t - start - waits
                wanted = reference(t)
                applied = car.drive_speed(steering=steering, speed=wanted)
                true = world.truth()
                rows.append((t, true.v_x, wanted, applied.throttle, applied.limited))
    t, v, r, u = np.array([row[:4] for row in rows]).T
    return Driven(t, v, r, u, [row[4] for row in rows])


def settling(drive: Driven, target: float, part: float = 0.05) -> float:
    """s until the speed stays within ``part`` of the target."""
    away = np.flatnonzero(np.abs(drive.speed - target) > part * abs(target))
    return float(drive.t[min(away[-1] + 1, len(drive.t) - 1)]) if len(away) else 0.0


def figures(seed: int, lag: float, known: str) -> dict[str, float]:
    """Settling [s], overshoot [-], rms on the sine [m/s], s to reverse and to go forward."""
    up = driven(seed, lag, known, step, 2.5)
    wave = driven(seed, lag, known, sine, 6.0, waits=2.0)
    turn = driven(seed, lag, known, there_and_back, 6.5)
    follows = wave.t > 0.0
    back = (turn.t > 2.0) & (turn.t < 4.5)
    reversed_at = turn.t[back & (turn.speed < 0.9 * BACK)]
    forward_at = turn.t[(turn.t > 4.5) & (turn.speed > 0.9 * THERE)]
    return {"settling": settling(up, STEP), "overshoot": float(up.speed.max() / STEP - 1.0),
            "sine": float(np.sqrt(np.mean((wave.speed - wave.reference)[follows] ** 2))),
            "reverse": float(reversed_at[0] - 2.0) if len(reversed_at) else np.inf,
            "forward": float(forward_at[0] - 4.5) if len(forward_at) else np.inf}


def plot(seeds: range, lags: list[float], path: Path) -> None:
    """Step, sine and change of direction of some cars: one row a lag, with and without a model."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    drives = ((step, 1.2, 0.0, "step"), (sine, 4.0, 1.0, "sine of 0.5 Hz"),
              (there_and_back, 6.5, 0.0, "forward, reverse, forward"))
    figure, axes = plt.subplots(len(lags), 3, figsize=(12, 2.9 * len(lags)), squeeze=False,
                                layout="constrained")
    for row, lag in zip(axes, lags, strict=True):
        for axis, (reference, seconds, waits, title) in zip(row, drives, strict=True):
            for known, colour in zip(KNOWN, ("tab:orange", "tab:green", "tab:blue"), strict=True):
                for seed in seeds:
                    drive = driven(seed, lag, known, reference, seconds, waits=waits)
                    axis.plot(drive.t, drive.speed, color=colour, lw=0.8, alpha=0.8, label=(
                        known if seed == seeds[0] else None))
            axis.plot(drive.t, drive.reference, "k--", lw=0.8, label="asked for")
            axis.set_title(f"{title}, lag of the motor {1e3 * lag:.0f} ms", fontsize=9)
            axis.set_xlabel("s", fontsize=8)
            axis.grid(alpha=0.3)
        row[0].set_ylabel("true speed [m/s]", fontsize=8)
    axes[0][0].axhspan(0.95 * STEP, 1.05 * STEP, color="0.85", zorder=0)
    axes[-1][0].axhspan(0.95 * STEP, 1.05 * STEP, color="0.85", zorder=0)
    axes[0][0].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--lag", type=float, nargs="*", default=list(LAGS))
    parser.add_argument("--known", nargs="*", choices=KNOWN, default=list(KNOWN))
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    if given.plot:
        plot(range(given.first, given.first + given.seeds), given.lag, given.plot)
        return
    for lag in given.lag:
        for known in given.known:
            rows = [figures(seed, lag, known)
                    for seed in range(given.first, given.first + given.seeds)]
            print(f"lag {lag:.3f} s, {known}, {len(rows)} cars")
            for name in rows[0]:
                values = np.array([row[name] for row in rows])
                print(f"  {name:10s} median {np.median(values):.3f}, 90 % "
                      f"{np.quantile(values, 0.9):.3f}, worst {values.max():.3f} "
                      f"(seed {given.first + int(values.argmax())})")


if __name__ == "__main__":
    main()
