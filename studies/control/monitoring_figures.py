"""Emulated cars monitor: how evenly they spread, how near they come, what they see, by their truth.

    python -m studies.control.monitoring_figures [--seeds 2] [--plants kinematic paper named]
        [--loss 0.3] [--seconds 30] [--nano mock]
    python -m studies.control.monitoring_figures --bound
    python -m studies.control.monitoring_figures --nine [--seconds 8]

Three cars on the 1:2 curve, from up to 0.4 rad beside their slots. Plants: "kinematic", without
slip; "paper", the hidden cars of the seeds; "named", the later published set with lags of 0.12 s of
steering and 0.08 s of throttle, which the car's model.toml holds 3 % wrongly, as a diagnosis names
them. Poses by lidar, in the map of a hall. About a second of CPU for a second of the drive.
--bound: no drive, but after which share of the bound nothing is unseen, of five starts, and the
same with one robot missing and with 0.9 of the sensing radius.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from math import cos, sin
from pathlib import Path

import numpy as np

from dart_hal.control.monitoring.detection import clearing_time, coverage
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.kuramoto import disagreement
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.config import save_model
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.parameters import Delay
from dart_hal.vehicle.sets import UPSTREAM_2024
from dart_lab.sim.truth import truth
from studies.control.monitoring_targets import parts_of, seen_at

EXAMPLE = Path(__file__).parents[2] / "examples" / "use_cases" / "monitoring.py"
TEAM = Formation(Lissajous(3.3, 0.9, 1, 2), 3, 1)
OMEGA, K = 0.25, 0.25
NINE, SLOW = Formation(Lissajous(14.0, 31.0, 5, 4), 9, 5), (0.01, 0.02)
"""Scaled by 17, as its tightest bend needs; Omega and k [rad/s] for 0.2 to 1.4 m/s."""
LAGS, WRONG, PULSE = {"steering_lag": 0.12, "throttle_lag": 0.08}, 0.97, 0.013


def example():
    """The module of examples/use_cases/monitoring.py."""
    spec = importlib.util.spec_from_file_location(EXAMPLE.stem, EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass
class Drive:
    """true: x, y [m] of the rear axles at 20 Hz, (k, n, 2); X, (k, n); modes of all answers."""

    true: np.ndarray
    X: np.ndarray
    contacts: int
    modes: Counter
    team: list

    def error(self, rows=slice(-100, None)) -> np.ndarray:
        """m by which each car is away from its place, that of the mean phase, (k, n)."""
        X = self.X[rows]
        p = min((1, 2), key=lambda p: disagreement(X[-1], p))
        slots = 2.0 * np.pi * p / 3 * np.arange(3)
        off = np.remainder(X - slots - X[:, :1] + np.pi, 2.0 * np.pi) - np.pi
        mean = X[:, :1] + off.mean(axis=1, keepdims=True)
        return np.linalg.norm(self.true[rows] - TEAM.curve.position(mean + slots), axis=-1)

    @property
    def settled(self) -> float:
        """Largest error of a phase between neighbours at the end [rad], of the nearest spread."""
        return min(disagreement(self.X[-1], p) for p in TEAM.windings)

    def targets(self, radius: float, n: int = 100) -> np.ndarray:
        """s (m,) after which moving targets are seen by the cars where they truly are, in the last
        ``bound`` s; inf: not by then. n random ones, of which those that are seen at once are 0."""
        rows = self.true[-round(20.0 * TEAM.bound(OMEGA)) - 1:]
        parts, rng = parts_of(TEAM.curve, rows, radius, 41), np.random.default_rng(7)
        return np.array([seen_at(parts, int(at), rng)
                         for at in rng.integers(len(parts[0]), size=n)]) / 20.0

    def needed(self, most: float) -> float:
        """Radius [m], a twentieth of ``most`` exact, from which on no target is unseen for as long
        as the bound."""
        rows = self.true[-round(20.0 * TEAM.bound(OMEGA)) - 1:]
        t = 0.05 * np.arange(len(rows))
        return next(r for r in np.linspace(0.0, most, 21)[1:]
                    if np.isfinite(clearing_time(TEAM.curve, t, rows, r, 41)))

    @property
    def least(self) -> float:
        """m between two cars at any time."""
        to = np.linalg.norm(self.true[:, :, None] - self.true[:, None], axis=-1)
        return float(to[:, ~np.eye(to.shape[-1], dtype=bool)].min())


def driven(seed=1, plant="paper", loss=0.3, seconds=30.0, nano="mock",
           each=lambda fleet, team: None, guard=True) -> Drive:
    """One drive of three cars."""
    module, true = example(), []
    places = module.starts(TEAM, noise=0.4, seed=seed)
    at = [tuple(map(float, place.split(","))) for place in places]

    def look(fleet, team):
        each(fleet, team)
        look.count += 1
        if look.count % 5 == 1:
            true.append([_in_room(car, start)
                         for car, start in zip(fleet.cars, at, strict=True)])

    look.count = 0
    with tempfile.TemporaryDirectory() as folder:
        options, opened = _car(plant, seed, Path(folder))
        chart = module.hall(folder, TEAM.curve)
        options += f"&nano={nano}&lidar=1&map={chart}"
        opened["poses"] = [f"lidar:{chart}?start={place}" for place in places]
        rows, team, contacts = module.drive(
            module.urls(places, seed, options), TEAM, OMEGA, K,
            f"local://monitoring?loss={loss}&seed={seed}", seconds, look, guard, **opened)
    modes = sum((robot.answers for robot in team), Counter())
    n = min(len(rows), len(true))
    return Drive(np.array(true[:n]), rows[:n, :, 2], len(contacts), modes, team)


def _in_room(car, at):
    """x, y [m] of the true rear axle of a car that began at a pose."""
    t = truth(car._engine.backend)
    return at[0] + cos(at[2]) * t.x - sin(at[2]) * t.y, at[1] + sin(at[2]) * t.x + cos(at[2]) * t.y


def _car(plant, seed, folder):
    """Options of the URL, and of ``Fleet.open``."""
    if plant != "named":
        return ("physics=kinematic" if plant == "kinematic" else "physics=dynamic"), {}
    car = replace(UPSTREAM_2024, name="named", delay=Delay())
    told = replace(car, delay=Delay(PULSE, PULSE))
    for effect, k in LAGS.items():
        car, told = apply(car, effect, k=k), apply(told, effect, k=WRONG * k)
    save_model(model_of(car), folder / "true.toml")
    for n in range(3):
        name = f"sim-{seed + n}"
        (folder / name).mkdir()
        save_model(model_of(replace(told, name=name)), folder / name / "model.toml")
    return f"vehicle={folder / 'true.toml'}", {"cars": folder}


def nine(seed: int = 1, seconds: float = 8.0, loss: float = 0.3) -> Drive:
    """The published team, on the published curve as wide as cars need it, by a motion capture."""
    module, true = example(), []
    places = module.starts(NINE, noise=0.02, seed=seed)
    at = [tuple(map(float, place.split(","))) for place in places]

    def look(fleet, team):
        true.append([_in_room(car, start) for car, start in zip(fleet.cars, at, strict=True)])

    rows, team, contacts = module.drive(
        module.urls(places, seed), NINE, *SLOW, f"local://monitoring?loss={loss}&seed={seed}",
        seconds, look)
    modes = sum((robot.answers for robot in team), Counter())
    return Drive(np.array(true[::5]), rows[:, :, 2], len(contacts), modes, team)


def tell_of_nine(seconds: float) -> None:
    one = nine(seconds=seconds)
    way = np.linalg.norm(np.diff(one.true[-40:], axis=0), axis=-1).sum(axis=0) / (0.05 * 39)
    begin, end = (disagreement(X, NINE.p) for X in (one.X[0], one.X[-1]))
    print(f"nine cars, {seconds:g} s: {one.contacts} contacts, nearest {one.least:.2f} m, phases "
          f"within {begin:.3f} rad of the spread at the begin and {end:.3f} at the end; "
          f"{way.min():.2f} to {way.max():.2f} m/s in the last 2 s; {dict(one.modes)}")


def bounds() -> None:
    """Of teams that are spread exactly."""
    for curve, p, alpha in ((Lissajous(1000.0, 1000.0, 13, 12), 11, 7),
                            (Lissajous(0.8, 1.8, 5, 4), 5, 4), (Lissajous(3.9, 7.8, 3, 2), 2, 1)):
        team = Formation(curve, curve.a + curve.b, p, alpha)
        t, r_s = np.linspace(0.0, 1.5, 300), team.sensing_radius
        lap = 2.0 * np.pi / team.n
        X = [team.slots(lap * (begin + t)) for begin in np.linspace(0.0, 1.0, 5, endpoint=False)]
        whole = [clearing_time(curve, t, curve.position(one), r_s) for one in X]
        missing = clearing_time(curve, t, curve.position(X[0][:, 1:]), r_s)
        less = [clearing_time(curve, t, curve.position(one), 0.9 * r_s) for one in X]
        now, _ = coverage(curve, curve.position(X[0][:200:4]), r_s)
        print(
            f"{curve.a}:{curve.b}: r_s {r_s:.3f} m sees {now.min():.0%} to {now.max():.0%}; "
            f"nothing unseen after {min(whole):.2f} to {max(whole):.2f} of the bound, one less "
            f"{missing:.2f}, 0.9 r_s {min(less):.2f} to {max(less):.2f}; proven "
              f"{team.is_bound_proven}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--plants", nargs="+", default=["kinematic", "paper", "named"])
    parser.add_argument("--loss", type=float, nargs="+", default=[0.3])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--nano", choices=["mock", "avr"], default="mock")
    parser.add_argument("--bound", action="store_true")
    parser.add_argument("--nine", action="store_true")
    asked = parser.parse_args()
    if asked.bound:
        bounds()
        return
    if asked.nine:
        tell_of_nine(asked.seconds)
        return
    for plant in asked.plants:
        for loss in asked.loss:
            for seed in range(1, 3 * asked.seeds, 3):
                one = driven(seed, plant, loss, asked.seconds, asked.nano)
                error = one.error()
                rate = float(np.diff(one.X[-100:, 0]).mean() / 0.05)
                t = 0.05 * np.arange(100)
                seen = clearing_time(TEAM.curve, t, one.true[-100:],
                                     TEAM.sensing_radius + float(error.max()), 41)
                needed = one.needed(TEAM.sensing_radius)
                found = one.targets(needed)
                share = {str(mode): f"{n / one.modes.total():.1%}" for mode, n in one.modes.items()}
                print(f"{plant}, loss {loss:.0%}, seeds {seed} to {seed + 2}: {one.contacts} "
                      f"contacts, nearest {one.least:.2f} m; at the end phases within "
                      f"{one.settled:.3f} rad, cars within {error.max():.2f} m of their place, "
                      f"X' {rate:.3f} rad/s; nothing unseen after {seen:.2f} s (bound "
                      f"{TEAM.bound(rate):.1f} s), nor with {needed:.2f} m by the bound: "
                      f"{np.isfinite(found).sum()} of {len(found)} moving targets seen, the last "
                      f"after {found.max():.2f} s; {share}", flush=True)


if __name__ == "__main__":
    main()
