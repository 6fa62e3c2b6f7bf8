"""How many of 200 arrivals of four cars are across in time, and how near they come.

    python -m studies.control.crossing_figures [--layout intersection] [--seeds 200] [--ways any]
        [--loss 0 .3 .5 .8] [--bursts 0.5] [--fault dead|mute|restart|lost]

--fault: one car in each arrival dies or falls silent for ever somewhere on its way, or restarts for
1.5 s with its stamp, or without.
"""

from __future__ import annotations

import argparse
import time
from math import inf

import numpy as np

from dart_hal.control.crossing.layouts import LAYOUTS
from studies.control import crossing_light as light


def fault_of(kind, seed):
    """Of one car, anywhere on its way."""
    rng = np.random.default_rng([seed, 30])
    car, s, t = int(rng.integers(0, 4)), float(rng.uniform(1.0, 5.0)), float(rng.uniform(0.5, 8.0))
    return {"dead": light.Faults(dead=(car, s)), "mute": light.Faults(mute=(car, t)),
            "restart": light.Faults(restart=(car, t, 1.5, True)),
            "lost": light.Faults(restart=(car, t, 1.5, False))}.get(kind, light.NO_FAULTS)


def campaign(layout, count, loss=0.0, bursts=0.0, ways="straight", seconds=40.0, first=0,
             fault="", **options):
    """(least distances [m], times of the last car across [s]) of so many arrivals."""
    least, last = [], []
    for seed, kind in light.kinds(count):
        starts = light.arrivals(layout, first + seed, kind, ways)
        network = light.Network(np.random.default_rng([first + seed, 28]), len(starts), loss,
                                bursts)
        run = light.drive(layout, starts, network, seconds, fault_of(fault, first + seed),
                          **options)
        least.append(run.least)
        last.append(max(run.across))
    return np.array(least), np.array(last)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--layout", choices=tuple(LAYOUTS), default="intersection")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--ways", choices=("straight", "any"), default="straight")
    parser.add_argument("--loss", type=float, nargs="*", default=[0.0, 0.3, 0.5, 0.8])
    parser.add_argument("--bursts", type=float, default=0.0)
    parser.add_argument("--fault", choices=("dead", "mute", "restart", "lost"), default="")
    given = parser.parse_args()
    layout = LAYOUTS[given.layout]()
    for loss in given.loss:
        begun = time.process_time()
        least, last = campaign(layout, given.seeds, loss, given.bursts, given.ways,
                               first=given.first, fault=given.fault)
        print(f"{layout.name}, {given.ways}, loss {loss:g}, bursts {given.bursts:g} "
              f"{given.fault}: least "
              f"{least.min():.3f} m; in 12 s {np.sum(last <= 12.0)} of {len(last)}, median "
              f"{np.median(last):.1f}, worst {last.max():.1f} s, never {np.sum(last == inf)}; "
              f"{time.process_time() - begun:.0f} s CPU", flush=True)


if __name__ == "__main__":
    main()
