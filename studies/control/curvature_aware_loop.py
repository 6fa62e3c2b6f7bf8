"""MPCC beside CA-MPCC, by the published weights and by tuned ones, on the 22.92 m track.

    python -m studies.control.curvature_aware_loop [--laps 3] [--noise] [--rough]
    python -m studies.control.curvature_aware_loop --arcs
    python -m studies.control.curvature_aware_loop --causes
    python -m studies.control.curvature_aware_loop --obstacles 10

On the light simulation, by their own throttle and steering: progress error of the plans (rms of
their ends, of all stages), rms and largest error of the true rear axle, how often it left the lane
of +-0.30 m, flying laps. --rough: the path's curvature as it steps, not its mean over 0.2 m.
--arcs: progress error beside an exact arc. --causes: of what the error of a plan's
end is made. --obstacles: passes of a disc
that moves on in the lane. The emulated car: ``curvature_aware_emulated``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from dart_hal.control.curvature_aware.curvature import GRID, curvature, fit_weights
from dart_hal.control.curvature_aware.generator import (
    LOOKAHEAD_FACTOR,
    PATH_STAGES,
    TUNED,
    WEIGHTS,
    PathWeights,
)
from dart_hal.control.curvature_aware.progress import Law, make_rates, make_stage
from dart_hal.control.curvature_aware.two_layers import TwoLayers
from dart_hal.control.mpc.obstacles import Obstacle, clearance
from dart_hal.control.mpc.reference import PathReference
from dart_hal.control.paths import Path
from dart_hal.control.tracks import track_named
from dart_hal.vehicle.parameters import Delay, Vehicle
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from studies.control.mpc_loop import LATE, Loop, P, figures, limits_of

TRACK = track_named("racetrack_vicon_2")
LANE, BEHIND = 0.30, 3.0
"""m to either side; m of way that no figure counts."""
KINEMATIC = replace(UPSTREAM_2024, kind="kinematic", delay=Delay())
"""The later set without slip and lags: the published controller's own model."""

PAPERS = replace(PAPER, delay=Delay(LATE, LATE))
"""The paper's tyres, which hold 1.4 m/s in these bends, without its delay of 0.15 s: that is longer
than the 0.1 s for which ``Loop`` predicts."""


@dataclass(frozen=True)
class Case:
    """A car, what the controller knows of it, how late it acts [s], the set speed [m/s]."""

    true: Vehicle
    model: Vehicle
    late: float
    speed: float


CASES = {
    "kinematic car, its model": Case(KINEMATIC, KINEMATIC, 0.0, 2.0),
    "later set with lags, kinematic model": Case(UPSTREAM_2024, KINEMATIC, 0.0, 2.0),
    "later set with lags, 40 ms late, its model": Case(P, P, LATE, 2.0),
    "paper's set, 40 ms late, kinematic model": Case(
        PAPERS, replace(PAPERS, kind="kinematic"), 0.0, 1.3),
    "paper's set, 40 ms late, its model": Case(PAPERS, PAPERS, LATE, 1.3),
}


@dataclass(frozen=True)
class Found:
    """plan_end, plan: rms of the progress error [m]; rms, most: error of the car [m]; left: how
    often it left the lane; lap [s] at the mean speed behind the first 3 m, nan where it was
    lost; driven [m]."""

    plan_end: float
    plan: float
    rms: float
    most: float
    left: int
    lap: float
    driven: float

    def __str__(self) -> str:
        return (f"plan {100 * self.plan_end:5.2f} cm at its end, {100 * self.plan:5.2f} all; "
                f"car {100 * self.rms:5.2f} / {100 * self.most:5.1f} cm; left {self.left}; "
                f"lap {self.lap:5.2f} s; {self.driven:.1f} m")


def error_on_arc(law: Law, radius: float, inside: float, speed: float, kernel: bool = False
                 ) -> float:
    """m of progress too much after 1.5 s on an arc so far inside of a circle; kernel: its curvature
    from the published grid, which ends 1.2 V T ahead."""
    length = 1.2 * 1.5 * speed
    weights = fit_weights(np.full(len(GRID), 1.0 / radius))
    stage = make_stage(make_rates(law, speed, lambda s: curvature(np.asarray(s), weights, length)
                                  if kernel else 1.0 / radius), 0.1)
    state = (0.0, inside, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(15):
        state = stage(*state, speed / (radius - inside))
    return float(state[3]) - 1.5 * speed * radius / (radius - inside)


def controller(case: Case, law: Law, weights: PathWeights, make=TwoLayers) -> TwoLayers:
    return make(case.model, TRACK, lambda s: np.full(len(s), case.speed), limits_of(case.model),
                law=law, path_weights=weights)


class Rough(TwoLayers):
    """One whose curvature is not smoothed."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.reference.curvatures = TRACK.curvatures


class Finer(TwoLayers):
    """One by the curvature of its path, ``own``, or by the published kernel; a stage in substeps;
    ``rounded``: its path is the track with its bends drawn out over 0.2 m."""

    def __init__(self, model, path, *args, own=False, substeps=1, rounded=False, **options):
        super().__init__(model, round_track() if rounded else path, *args, **options)
        self.generator.stage, self._own, self._substeps = self._stage, own, substeps

    def _stage(self, s, speed, mean=None):
        path, n = self.reference.path, self._substeps
        length = (
            LOOKAHEAD_FACTOR * PATH_STAGES * 0.1 * (float(np.mean(speed)) if mean is None else mean)
        )
        weights = fit_weights(self.reference.curvatures(s + length * GRID))

        def curve(at):
            if self._own:
                return np.interp(s + at, path.s, path.curvature, period=path.length)
            return curvature(at, weights, length)

        part = make_stage(make_rates(self.generator.law, speed, curve), 0.1 / n)

        def stage(*at):
            state, turn = at[:-1], at[-1]
            for _ in range(n):
                state = part(*state, turn)
            return state

        return stage


@cache
def round_track() -> Path:
    """The track with a curvature that does not step: its mean over 0.2 m, integrated."""
    k, d = PathReference(TRACK)._curvature, TRACK.spacing
    yaw = TRACK.heading[0] + np.cumsum(k * d) - 0.5 * k * d
    at = np.cumsum(d * np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)
    at -= np.outer(np.arange(1.0, len(k) + 1.0) / len(k), at[-1])  # 5 cm are missing at its end
    return Path.through(np.vstack([(0.0, 0.0), at[:-1]])[::3], closed=True)


def left_lane(error: np.ndarray) -> int:
    """How often."""
    return int(np.sum(np.diff((np.abs(error) > LANE).astype(int), prepend=0) > 0))


def drive(case: Case, law: Law, weights: PathWeights, laps: float = 2.0, make=TwoLayers,
          noise: np.random.Generator | None = None) -> Found:
    """From rest, until so many laps are driven or the car is 1 m off."""
    layers = controller(case, law, weights, make)
    loop, errors = Loop(layers, case.true, case.late, noise=noise, learns=False), []
    length = TRACK.length
    while loop.s < laps * length and loop.car.t < 30.0 * laps:
        plan = loop.step()
        errors.append(plan.way.error(layers.reference, plan.s[0]))
        if abs(loop.rows[-1][2]) > 1.0:
            break
    rows, plans = np.array(loop.rows), np.array(errors)
    counted = rows[rows[:, 1] > BEHIND]
    whole = loop.s >= laps * length
    pace = (counted[-1, 0] - counted[0, 0]) / (counted[-1, 1] - counted[0, 1])
    return Found(float(np.sqrt(np.mean(plans[:, -1] ** 2))), float(np.sqrt(np.mean(plans**2))),
                 *figures(rows), left_lane(counted[:, 2]),
                 float(pace) * length if whole else np.nan, loop.s)


def passed(seed: int, law: Law = Law.CA, weights: PathWeights = TUNED, beside: float = 0.15,
           case: Case = CASES["later set with lags, 40 ms late, its model"]
           ) -> tuple[float, float]:
    """(least distance [m] of the body to a disc of 0.15 m at +-``beside`` m that moves on at
    0.5 m/s, largest error across [m]): one encounter somewhere on the track, with noise."""
    rng = np.random.default_rng([seed, 11])
    layers = controller(case, law, weights)
    o = Obstacle(float(rng.uniform(4.0, 12.0)), float(rng.choice((-beside, beside))), 0.15, 0.5)
    layers.obstacles = (o,)
    rows = Loop(layers, case.true, case.late, noise=rng, learns=False).drive(1.0)
    least = min(clearance(x, y, yaw, o, TRACK, t) for t, _, _, _, x, y, yaw in rows)
    return least, float(np.abs(rows[:, 2]).max())


def arcs() -> None:
    for radius, inside, speed in ((0.75, 0.15, 1.0), (0.75, 0.15, 2.0), (0.75, 0.25, 1.0),
                                  (0.75, 0.25, 2.0), (0.5, 0.15, 2.0), (0.5, 0.25, 1.0),
                                  (0.5, 0.25, 2.0)):
        found = [f"{error_on_arc(law, radius, inside, speed, kernel):+.4f}"
                 for law, kernel in ((Law.MPCC, False), (Law.CA, False), (Law.CA, True))]
        print(f"R {radius}, {inside} m inside, {speed} m/s: MPCC {found[0]}, CA {found[1]}, CA on "
              f"the published grid {found[2]} m")


def causes() -> None:
    """What keeps the end of a CA-MPCC plan from where it says that it is: the kinematic car."""
    case = CASES["kinematic car, its model"]
    for rounded in (False, True):
        for own in (False, True):
            for substeps in (1, 4):
                make = partial(Finer, own=own, substeps=substeps, rounded=rounded)
                ends = [100.0 * drive(case, Law.CA, weights, 1.0, make).plan_end
                        for weights in WEIGHTS.values()]
                print(f"{'rounded' if rounded else 'stepping'} bends, "
                      f"{'their curvature' if own else 'the kernel'}, {substeps} steps a stage: "
                      f"published {ends[0]:.2f}, tuned {ends[1]:.2f} cm", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laps", type=float, default=3.0)
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--rough", action="store_true")
    parser.add_argument("--obstacles", type=int, default=0)
    parser.add_argument("--arcs", action="store_true")
    parser.add_argument("--causes", action="store_true")
    given = parser.parse_args()
    if given.arcs:
        arcs()
        return
    if given.causes:
        causes()
        return
    if given.obstacles:
        for law in Law:
            for name, weights in WEIGHTS.items():
                found = np.array([passed(k, law, weights) for k in range(given.obstacles)])
                print(f"{law} {name}: {np.sum(found[:, 0] >= 0.05)} of {len(found)} with 5 cm or "
                      f"more, {np.sum(found[:, 0] <= 0.0)} touched; least "
                      f"{100.0 * found[:, 0].min():.1f} cm; largest error "
                      f"{100.0 * found[:, 1].max():.1f} cm", flush=True)
        return
    for title, case in CASES.items():
        print(f"{title}, {case.speed:g} m/s, {given.laps:g} laps")
        for name, weights in WEIGHTS.items():
            for law in Law:
                rng = np.random.default_rng(3) if given.noise else None
                found = drive(case, law, weights, given.laps, Rough if given.rough else TwoLayers,
                              noise=rng)
                print(f"  {name:9s} {law.value:7s} {found}", flush=True)


if __name__ == "__main__":
    main()
