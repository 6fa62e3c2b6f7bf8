"""The figures of docs/use_cases/platooning.md.

    python -m studies.control.platoon_figures published            the published law, its own steps
    python -m studies.control.platoon_figures strings              peaks along the string
    python -m studies.control.platoon_figures rule --scenarios 150         without noise; 12 CPU min
    python -m studies.control.platoon_figures noise --scenarios 2000       noise and loss; 9 CPU min
    python -m studies.control.platoon_figures speeds               told speeds that are lies
    python -m studies.control.platoon_figures cars --seeds 20 [--first 1] [--tracker lane]
                                                                 emulated; 20 CPU s a seed

``rule``, ``noise``: random attacks, brakes and leaders, 5 followers, 50 s; the smallest gap.
``cars``: see ``platoon_cars``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from math import inf, pi, sin

import numpy as np

from dart_hal.control.platoon.follower import PlatoonFollower
from dart_hal.control.platoon.gains import DART, STABLE, TRUCK, PlatoonGains
from dart_hal.control.platoon.safe import SafetyMargins
from dart_hal.control.platoon.stability import peak_gain
from studies.control.platoon_loop import Line, Scenario, drive, published, random_scenario

STEPS = tuple((dt, delay) for dt in (0.1, 0.05) for delay in (0.0, 0.1, 0.2))
"""dt, delay [s]."""
BARE = {"rule": False, "compensated": False, "detects": False}
RULE = {"compensated": False, "detects": False}
NOISY = Line(noise=0.02, rate=8.0, wrong=0.03)


def lie(t: float) -> float:
    return 1000.0


def as_published() -> None:
    for forward in ("", "all", "limited"):
        told = lie if forward else None
        gaps = (published(DART, 9, 0.1, 50.0, forward=forward,
                          drive=lambda t: 0.8 * sin(2.0 * pi * t / 10.0)),
                published(DART, 9, 0.1, 50.0, forward=forward, told=told),
                published(DART, 9, 0.1, 50.0, forward=forward, told=told, brakes=25.0))
        print(f"feed-forward {forward or 'none':8s} wave {gaps[0].min():7.4f}, attack "
              f"{gaps[1].min():8.4f}, attack and brake {gaps[2].min():8.4f} m")
    for name, gains, n in (("cars", DART, 3), ("trucks", TRUCK, 3)):
        for brakes in (inf, 25.0):
            least = published(gains, n, 0.1, 60.0, told=lie, brakes=brakes).min()
            print(f"{name}, attack, brakes at {brakes:g} s: {least:.4f} m")
    for dt in (0.1, 0.05, 0.01, 0.001):
        print(f"dt {dt:g}: {published(DART, 3, dt, 40.0, told=lie, brakes=25.0).min():.4f} m")
    for alpha in (0.95, 0.9, 0.8, 0.7, 0.5):
        gains = replace(DART, alpha=alpha)
        least = [published(gains, 3, dt, 40.0, told=lie, brakes=25.0, delay=d).min()
                 for dt, d in ((0.1, 0.0), (0.01, 0.05), (0.01, 0.1), (0.01, 0.2))]
        print(f"alpha {alpha:g}: dt 0.1 s {least[0]:.4f}; dt 0.01, delay 0.05, 0.1, 0.2 s "
              + ", ".join(f"{x:.4f}" for x in least[1:]) + " m")


def strings() -> None:
    for name, gains in (("published", DART), ("stable", STABLE)):
        for dt, age in ((0.1, 0.0), (0.1, 0.1), (0.05, 0.05), (0.05, 0.1)):
            for told in (False, True):
                peaks = [
                    peak_gain(gains, dt, d, feed_forward=told, age=age) for d in (0.0, 0.1, 0.2)
                ]
                print(f"{name:9s} dt {dt:g}, {'told ' + str(age) + ' s ago' if told else 'ACC':14s}"
                      " delay 0, 0.1, 0.2 s: " + ", ".join(f"{p:.4f}" for p in peaks))


def gaps_of(
    count: int,
    gains: PlatoonGains,
    dt: float,
    delay: float,
    margins: SafetyMargins,
    line: Line | None,
    **how: bool,
) -> np.ndarray:
    """Smallest gap [m] of each scenario."""
    line = line or Line()
    out, trust = [], 0.5 if line.noise else 1.0
    for seed in range(count):
        rng = np.random.default_rng([seed, 3])
        scenario = random_scenario(rng, gains, 5, 50.0)
        lossy = replace(line, loss=rng.uniform(0.0, 0.5)) if line.noise else line
        out.append(
            drive(
                scenario,
                lambda: PlatoonFollower(gains, dt, delay, margins, trust=trust, **how),
                5,
                50.0,
                dt=dt,
                delay=delay,
                line=lossy,
                rng=rng,
            )[0].min()
        )
    return np.array(out)


def rule(count: int) -> None:
    for dt, delay in STEPS:
        laws = {**{f"alpha {a:g}": (replace(DART, alpha=a), BARE) for a in (0.95, 0.8, 0.5, 0.2)},
                "ACC": (replace(DART, share=0.0), BARE),
                **{f"rule, alpha {a:g}": (replace(DART, alpha=a), RULE) for a in (0.95, 0.2)},
                "all": (STABLE, {})}
        for name, (gains, how) in laws.items():
            gaps = gaps_of(count, gains, dt, delay, SafetyMargins(m=0.02), None, **how)
            print(f"dt {dt:g}, delay {delay:g} s, {name:16s} least gap {gaps.min():+.4f} m, "
                  f"contacts {(gaps <= 0.0).sum()} of {count}", flush=True)
    gaps = gaps_of(count, TRUCK, 0.1, 0.1, SafetyMargins(7.848, 7.848, m=0.5), None, **RULE)
    bare = gaps_of(count, TRUCK, 0.1, 0.1, SafetyMargins(), None, **BARE)
    print(f"trucks, dt 0.1, delay 0.1 s, rule {gaps.min():+.3f} m, without {bare.min():+.3f} m, "
          f"contacts {(gaps <= 0.0).sum()} and {(bare <= 0.0).sum()} of {count}")
    for b_s in (1.0, 0.9):
        weak = Line(brake=(0.9, 1.0))
        gaps = gaps_of(count, DART, 0.1, 0.1, SafetyMargins(b_s, 1.0, m=0.02), weak, **RULE)
        print(f"true brakes 0.9 to 1 m/s2, b_s {b_s:g}: {gaps.min():+.4f} m, contacts "
              f"{(gaps <= 0.0).sum()} of {count}", flush=True)


def noise(count: int) -> None:
    margins = SafetyMargins(e_g=0.05, e_v=0.03, m=0.02)
    for dt, delay in STEPS[1::3]:
        for name, gains, how in (("published, rule", DART, RULE), ("published", DART, BARE),
                                 ("stable, rule, detector", STABLE, {})):
            gaps = gaps_of(count, gains, dt, delay, margins, NOISY, **how)
            print(f"dt {dt:g}, delay {delay:g} s, {name:22s} least gap {gaps.min():+.4f} m, "
                  f"contacts {(gaps <= 0.0).sum()} of {count}", flush=True)


def speeds() -> None:
    """The second car tells a wrong speed from 10 s on; the leader brakes at 10, 10.6, 20 s."""
    margins, line = SafetyMargins(e_g=0.05, e_v=0.05, m=0.03), replace(NOISY, loss=0.3)
    for detects in (False, True):
        for off in (0.1, 0.15, 0.2, 0.3, 0.5, 1.0, -0.3):
            runs = [drive(Scenario(brakes=(brakes, inf),
                                   speeds={1: lambda t, off=off: off if t > 10.0 else 0.0}),
                          lambda detects=detects: PlatoonFollower(STABLE, 0.05, 0.1, margins,
                                                                  detects=detects),
                          3, 30.0, dt=0.05, delay=0.1, line=line, rng=np.random.default_rng(seed))
                    for seed in range(3) for brakes in (10.0, 10.6, 20.0)]
            least = [gaps.min() for gaps, _ in runs]
            found = sum([f.distrusts for f in who] == [False, True, False] for _, who in runs)
            print(f"{'looked for' if detects else 'believed'}: told {off:+g} m/s: least gap "
                  f"{min(least):+.3f} m, contacts {sum(x <= 0 for x in least)}, found {found} of 9")
    called = 0
    for seed in range(25):
        rng = np.random.default_rng([seed, 3])
        honest = random_scenario(rng, STABLE, 5, 50.0)
        lossy = replace(NOISY, loss=rng.uniform(0.0, 0.5))
        called += sum(
            f.distrusts
            for f in drive(
                honest,
                lambda: PlatoonFollower(STABLE, 0.05, 0.1, margins),
                5,
                50.0,
                dt=0.05,
                delay=0.1,
                line=lossy,
                rng=rng,
            )[1]
        )
    print(f"{called} of 125 followers of true speeds called a liar")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("published", "strings", "rule", "noise", "speeds",
                                         "cars"))
    parser.add_argument("--scenarios", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--tracker", default="lqr", choices=("lqr", "pursuit", "lane"))
    given = parser.parse_args()
    if given.what == "cars":
        from studies.control.platoon_cars import figures

        figures(range(given.first, given.first + given.seeds), given.tracker)
    elif given.what in ("rule", "noise"):
        {"rule": rule, "noise": noise}[given.what](given.scenarios)
    else:
        {"published": as_published, "strings": strings, "speeds": speeds}[given.what]()


if __name__ == "__main__":
    main()
