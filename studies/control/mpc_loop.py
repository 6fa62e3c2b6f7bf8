"""Contouring control on the light simulation, at its own commands: throttle and steering.

    python -m studies.control.mpc_loop [--laps 3] [--noise [--dull] [--exact] [--speed 2]]
        [--obstacles 50 [--first 100]]

Without options: rms and largest error of the true rear axle on the 22.92 m track by the exact
model, and what becomes of it without lags or delay in the model. --noise: cars whose model is 5 %
off, poses with 1 cm of noise; --dull: and nothing is learnt of them; --exact: a car that is as its
model. 2.5 m/s is by a profile of at most 5.5 m/s2 across.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import cache
from math import cos, exp, sin

import numpy as np

from dart_hal.control.mpc.disturbance import SteeringDisturbance
from dart_hal.control.mpc.iteration import Mpcc
from dart_hal.control.mpc.model import STAGE_PERIOD, make_stage
from dart_hal.control.mpc.obstacles import Obstacle, clearance
from dart_hal.control.mpc.planner import MpcPlan
from dart_hal.control.mpc.problem import MpcLimits
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant, SteeringDelay
from dart_hal.control.tracks import track_named
from dart_hal.vehicle.parameters import Delay, Vehicle
from dart_hal.vehicle.sets import UPSTREAM_2024
from dart_hal.vehicle.steering import make_steering
from dart_lab.sim.light import LightCar

LATE = 0.04
"""s from a command to the actuators."""
P = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=LATE, throttle_s=LATE))
"""The later published set, late."""
NO_LAGS = replace(P, delay=Delay())


ACROSS, ALONG = 5.5, 2.0
"""m/s2 of the profile."""


@cache
def known(p: Vehicle) -> Plant:
    """What is known of a car by its model."""
    curve = make_steering(p.steering)
    return Plant(p, SteeringDelay(LATE, p.delay.steering_lag_s), (curve(-1.0), curve(1.0)))


def limits_of(p: Vehicle) -> MpcLimits:
    """Throttle from the dead band on, up to 0.6."""
    return MpcLimits(tau=(-p.motor.g, 0.6))


def controller(p: Vehicle, path: Path, speed: float, **options) -> Mpcc:
    """One that wants the same speed [m/s] everywhere."""
    return Mpcc(p, path, lambda s: np.full(len(s), speed), limits_of(p), **options)


def by_profile(p: Vehicle, path: Path, speed: float, **options) -> Mpcc:
    """One that wants a speed [m/s], less in bends and before them."""
    v = np.minimum(speed, np.sqrt(ACROSS / np.maximum(np.abs(path.curvature), 1e-6)))
    for _ in range(2):  # a lap on from its own end
        for k, step in ((range(len(v)), -1), (range(len(v) - 1, -1, -1), 1)):
            for i in k:
                v[i] = min(v[i], np.sqrt(v[(i + step) % len(v)] ** 2 + 2 * ALONG * path.spacing))
    return Mpcc(p, path, lambda s: np.interp(s, path.s, v, period=path.length), limits_of(p),
                **options)


@dataclass
class Loop:
    """A light car and its controller, ``step`` by step of 0.1 s. rows: t, s, error of the rear
    axle [m], v_x, middle x, y, yaw. start: offset [m] and heading beside the path; learns: what the
    steering does beside the model, which then says where the servo is, too, as nobody measures it;
    stale [s]: the pose is one of before, and taken for that of now."""

    mpc: Mpcc
    true: Vehicle = P
    late: float = LATE
    start: tuple[float, float] = (0.0, 0.0)
    noise: np.random.Generator | None = None
    learns: bool = True
    stale: float = 0.0

    def __post_init__(self) -> None:
        path, l_r = self.mpc.reference.path, self.true.body.l_r
        spot, (offset, turn) = path.interpolate(0.0), self.start
        yaw = spot.heading + turn
        self.car, self.s, self.rows = LightCar(self.true), 0.0, []
        self.car.reset(
            spot.x - offset * sin(spot.heading) + l_r * cos(yaw),
            spot.y + offset * cos(spot.heading) + l_r * sin(yaw),
            yaw,
        )
        self.sent, self._servo = (self.mpc.limits.tau[0], 0.0), 0.0
        self.disturbance = SteeringDisturbance(known(self.mpc.vehicle))
        self._ahead = make_stage(self.mpc.vehicle, np, self.late) if self.late else None

    def seen(self) -> np.ndarray:
        """The state with its rear axle, as it is measured."""
        x, y, yaw, *rest = self.car.state
        if self.stale and self.rows:
            ago = round(self.stale / self.car.config.step)
            x, y, yaw = self.rows[-1 - min(ago, len(self.rows) - 1)][4:]
        l_r = self.true.body.l_r
        z = np.array([x - l_r * cos(yaw), y - l_r * sin(yaw), yaw, *rest])
        if self.noise is not None:
            z[:6] += self.noise.normal(size=6) * (0.01, 0.01, 0.005, 0.02, 0.01, 0.02)
        return z

    def planned(self) -> MpcPlan:
        """The plan; what is to be sent of it is in ``sent``."""
        z, acts, before = self.seen(), self.disturbance.effective, self.sent
        if self.learns:
            if self.rows:
                self.disturbance.update(self._servo, z[3], z[5], STAGE_PERIOD)
            z[7] = acts(self._servo)
            self.mpc.problem.set_steering_range(acts(-1.0), acts(1.0))
        known = before[0], acts(before[1])
        z = np.array(self._ahead(*z, *known)) if self._ahead else z
        plan = self.mpc.plan(
            self.car.t + self.late,
            z,
            self.mpc.reference.path.closest(z[0], z[1], self.s),
            known,
        )
        self.sent = float(plan.inputs[0, 0]), self.disturbance.command(float(plan.inputs[1, 0]))
        lag = self.mpc.vehicle.delay.steering_lag_s
        for (_, st), dt in ((before, self.late), (self.sent, STAGE_PERIOD - self.late)):
            self._servo = st + (self._servo - st) * (exp(-dt / lag) if lag else 0.0)
        return plan

    def step(self) -> MpcPlan:
        plan = self.planned()
        self.move()
        return plan

    def move(self) -> None:
        """A stage on, by what was sent."""
        path = self.mpc.reference.path
        l_r = self.true.body.l_r
        for _ in range(round(STAGE_PERIOD / self.car.config.step)):
            self.car.advance(*self.sent)
            x, y, yaw, v = self.car.state[:4]
            xr, yr = x - l_r * cos(yaw), y - l_r * sin(yaw)
            self.s = path.closest(xr, yr, self.s)
            self.rows.append((self.car.t, self.s, path.offset(xr, yr, self.s), v, x, y, yaw))

    def drive(self, laps: float, seconds: float = 90.0, lost: float = 1.0) -> np.ndarray:
        """Rows until so many laps are driven, the time is over or the car is lost."""
        length = self.mpc.reference.path.length
        while self.s < laps * length and self.car.t < seconds:
            self.step()
            if abs(self.rows[-1][2]) > lost:
                break
        return np.array(self.rows)


def figures(rows: np.ndarray, after: float = 3.0) -> tuple[float, float]:
    """(rms, largest) error [m] behind ``after`` m."""
    error = rows[rows[:, 1] > after, 2]
    return float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())


def lap(
    speed: float = 2.0,
    model: Vehicle = P,
    laps: float = 1.0,
    late: float = LATE,
    true: Vehicle = P,
    seed: int | None = None,
    make=controller,
    **options,
) -> tuple[float, float, float]:
    """(rms, largest) error [m] on the 22.92 m track, s of a lap at the mean speed behind 3 m."""
    noise = None if seed is None else np.random.default_rng(seed)
    path = track_named("racetrack_vicon_2")
    rows = Loop(make(model, path, speed), true, late, noise=noise, **options).drive(laps)
    (t0, s0), (t1, s1) = rows[rows[:, 1] > 3.0][[0, -1], :2]
    return *figures(rows), float((t1 - t0) / (s1 - s0) * path.length)


def around(seed: int, part: float = 0.05) -> Vehicle:
    """A car whose parameters are ``part`` off, of random sign."""
    rng = np.random.default_rng([seed, 5])

    def off(of, *names):
        return replace(
            of, **{n: getattr(of, n) * (1.0 + part * rng.choice((-1.0, 1.0))) for n in names}
        )

    return replace(
        P,
        body=off(P.body, "mass", "yaw_inertia"),
        friction=off(P.friction, "a", "c"),
        motor=off(P.motor, "d", "e", "g"),
        steering=off(P.steering, "k_left", "a_left_rad", "a_right_rad", "k_right"),
        tyres=off(P.tyres, "front_D", "front_C", "front_B", "rear_D", "rear_C", "rear_B"),
        delay=off(P.delay, "steering_lag_s", "throttle_lag_s"),
    )


def margin(seed: int, speed: float = 2.0, radius: float = 0.15) -> tuple[float, float]:
    """(least distance [m] of the body to a disc at +-0.15 m that moves at 0.5 m/s, largest error
    across): one encounter somewhere on the track, the car with noise."""
    rng = np.random.default_rng([seed, 9])
    path = track_named("racetrack_vicon_2")
    mpc = controller(P, path, speed)
    o = Obstacle(float(rng.uniform(4.0, 12.0)), float(rng.choice((-0.15, 0.15))), radius, 0.5)
    mpc.obstacles = (o,)
    loop = Loop(mpc, noise=rng)
    rows = loop.drive(1.0)
    least = min(clearance(x, y, yaw, o, path, t) for t, _, _, _, x, y, yaw in rows)
    return least, float(np.abs(rows[:, 2]).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laps", type=float, default=3.0)
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--dull", action="store_true")
    parser.add_argument("--speed", type=float, nargs="*", default=(1.0, 1.5, 2.0, 2.5))
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--obstacles", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    if given.obstacles:
        found = np.array([margin(given.first + k) for k in range(given.obstacles)])
        print(
            f"obstacles: {np.sum(found[:, 0] >= 0.05)} of {len(found)} with 5 cm or more; least "
            f"{100.0 * found[:, 0].min():.1f} cm; largest error {100.0 * found[:, 1].max():.1f}"
        )
    elif given.noise:
        for speed in given.speed:
            make = by_profile if speed > 2.0 else controller
            rms, most, laps = np.array(
                [
                    lap(speed, laps=given.laps, true=P if given.exact else around(k), seed=k,
                        learns=not given.dull, make=make)
                    for k in range(10)
                ]
            ).T
            print(
                f"{speed} m/s, {'the exact model' if given.exact else 'model 5 % off'}, noise: rms "
                f"mean {100.0 * rms.mean():.2f}, worst {100.0 * rms.max():.2f}, max "
                f"{100.0 * most.max():.1f} cm; lap mean {laps.mean():.2f}, worst {laps.max():.2f} "
                f"s", flush=True,
            )
    else:
        cases = [(f"{v} m/s", {"speed": v}) for v in (1.0, 1.5, 2.0)]
        cases += [("2.5 m/s by profile", {"speed": 2.5, "make": by_profile})]
        cases += [
            ("2 m/s, no lags in the model", {"model": NO_LAGS}),
            ("2 m/s, delay not predicted", {"late": 0.0}),
            ("2 m/s, poses 80 ms old, not said", {"stale": 0.08}),
            ("2 m/s, kinematic model", {"model": replace(P, kind="kinematic")}),
        ]
        for name, options in cases:
            rms, most, time = lap(laps=given.laps, **options)
            print(f"{name}: {100.0 * rms:.2f} / {100.0 * most:.2f} cm, lap {time:.2f} s",
                  flush=True)


if __name__ == "__main__":
    main()
