"""Cars that share their plans at an intersection, a merge and in an open space: contacts, deadlocks
and the time to pass, compared with central plans for the same arrivals.

    python -m studies.control.distributed_plans [--place intersection merge open] [--seeds 200]
        [--first 2000] [--loss 0 .3 .5] [--adopt-at-once] [--rest-anywhere]
    python -m studies.control.distributed_plans --picture FILE [--first 2000] [--loss .5]

Controls: --adopt-at-once does not wait for acknowledgements, and --rest-anywhere lets plans of 3 s
end on the paths of others. The rows are those of docs/results/distributed_plans.md.
"""

from __future__ import annotations

import argparse
import time
from math import inf
from pathlib import Path

import numpy as np

from dart_hal.control.shared_plans import search
from dart_hal.control.shared_plans.planner import PlanSharer
from dart_hal.control.shared_plans.space import PlanSpace
from studies.control import crossing_light as light
from studies.control import distributed_light as cars
from studies.control.distributed_central import optimise

PLACES = ("intersection", "merge", "open")
SHORT_HORIZON = 12
"""Knots of the plans of the second control: 3 s."""
DEADLOCK = 5.0
"""All cars at rest for so long [s] before the last has passed."""


class HastySharer(PlanSharer):
    """The control: it adopts each proposal at once."""

    def is_acknowledged(self) -> bool:
        return True


def rest_anywhere(space: PlanSpace) -> PlanSpace:
    """The control: plans may end on the paths of others."""
    space.rests = tuple(tuple(np.ones_like(r) for r in own) for own in space.rests)
    return space


def arrivals(place: str, count: int, first: int):
    """So many arrivals: crossing and merge half random, three tenths near, two tenths equal."""
    if place == "open":
        return [cars.open_arrival(first + k) for k in range(count)]
    return [cars.layout_arrival(place, first + k, kind) for k, kind in light.kinds(count)]


def row(place: str, loss: float, driven, centrals, cpu: float) -> str:
    """One row of the table."""
    mean = np.array([np.mean(o.passed) for o in driven])
    last = np.array([max(o.passed) for o in driven])
    counts = {name: sum(o.counts.get(name, 0) for o in driven)
              for name in ("PROPOSED", "ADOPTED", "EXPIRED", "WITHDRAWN")}
    dead = sum(o.stalled > DEADLOCK or t == inf for o, t in zip(driven, last, strict=True))
    passed = last < inf
    ratios = "no central plans"
    if centrals:
        by_mean = (mean / [c.mean for c in centrals])[passed]
        by_last = (last / [c.last for c in centrals])[passed]
        ratios = (f"mean {by_mean.mean():.3f} (worst {by_mean.max():.2f}), last "
                  f"{by_last.mean():.3f} (worst {by_last.max():.2f})")
    error = np.max([o.error for o in driven], axis=0)
    return (f"{place}, loss {loss:g}: {len(driven)} arrivals, {sum(o.contacts for o in driven)} "
            f"contacts, least {min(o.least for o in driven):.3f} m; {dead} deadlocks, longest rest "
            f"{max(o.stalled for o in driven):.1f} s; {ratios}; {mean[passed].mean():.2f} s, last "
            f"{last[passed].mean():.2f} s, worst {last.max():.1f} s; error {error[0]:.3f} along, "
            f"{error[1]:.3f} across; {counts}; {cpu:.0f} s CPU")


def picture(file: Path, first: int, loss: float) -> None:
    """One arrival at the intersection and one in the open space, each half second."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.patches import Polygon

    from dart_lab.sim.light.world import corners

    colours = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
    figure, axes = plt.subplots(2, 2, figsize=(10, 8), height_ratios=(1.6, 1.0),
                                layout="constrained")
    for place, (top, below) in zip(("intersection", "open"), axes.T, strict=True):
        arrival = arrivals(place, 1, first)[0]
        driven = cars.drive([arrival], loss, rows=True)[0]
        rows = np.array(driven.rows)
        for i, sharer in enumerate(driven.sharers):
            path = arrival.space.paths[i][sharer.path]
            top.plot(path.x, path.y, color=colours[i], lw=0.8, alpha=0.5)
            for k in range(0, len(rows), 10):
                box = corners(rows[k, i : i + 1, 1:], cars.OUTLINE)[0]
                top.add_patch(Polygon(box, color=colours[i], lw=0,
                                      alpha=0.2 + 0.7 * k / len(rows)))
            way = np.append(0.0, np.cumsum(np.hypot(*np.diff(rows[:, i, 1:3], axis=0).T)))
            below.plot(rows[:, i, 0], way + arrival.starts[i].s, color=colours[i])
        top.set_aspect("equal")
        top.set(xlabel="x [m]", ylabel="y [m]")
        top.set_title(f"{place}, {100 * loss:.0f} % of the messages lost: each half second, "
                      f"centres at least {driven.least:.2f} m", loc="left", fontsize=8)
        below.set(xlabel="t [s]", ylabel="along its path [m]")
        below.grid(alpha=0.3)
    figure.savefig(file, dpi=90)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--place", choices=PLACES, nargs="*", default=PLACES)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=2000)
    parser.add_argument("--loss", type=float, nargs="*", default=[0.0, 0.3, 0.5])
    parser.add_argument("--adopt-at-once", action="store_true")
    parser.add_argument("--rest-anywhere", action="store_true")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    if given.picture:
        picture(given.picture, given.first, given.loss[-1])
        return
    for place in given.place:
        drawn = arrivals(place, given.seeds, given.first)
        begun = time.process_time()
        is_control = given.adopt_at_once or given.rest_anywhere
        centrals = [] if is_control else [optimise(a) for a in drawn]
        if centrals:
            print(f"{place}: central mean {np.mean([c.mean for c in centrals]):.2f} s, last "
                  f"{np.mean([c.last for c in centrals]):.2f} s, each alone "
                  f"{np.mean([c.alone for c in centrals]):.2f} s; "
                  f"{time.process_time() - begun:.0f} s CPU", flush=True)
        if given.rest_anywhere:
            search.HORIZON_KNOTS = SHORT_HORIZON
            for arrival in drawn:
                rest_anywhere(arrival.space)
        for loss in given.loss:
            begun = time.process_time()
            make = HastySharer if given.adopt_at_once else PlanSharer
            driven = cars.drive(drawn, loss, make=make)
            print(row(place, loss, driven, centrals, time.process_time() - begun), flush=True)


if __name__ == "__main__":
    main()
