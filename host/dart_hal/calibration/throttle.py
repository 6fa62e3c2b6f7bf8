"""``calibrate throttle``: the pulse that holds a speed, straight ahead.

The car is brought to one speed after the other. Then its pulse is frozen, so that the unevenness
of the ring moves nothing, and what is left of an acceleration is taken off with the motor's pull.
Along a straight line as far as the floor allows; without one in a circle, where the tyres take
some of the pull, which is taken off too and makes the result less exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, DriveTable
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop
from dart_hal.core.types import INTERVAL_90, FloatArray, State
from dart_hal.vehicle.parameters import PaperTyres
from dart_hal.vehicle.sets import PAPER

from .by_hand import naming, turn_by_hand
from .clock import UNKNOWN
from .measured import Measured
from .procedure import Bench, Option, Procedure, ProcedurePlan, Progress
from .runner import NotSeen, Runner, driving, yaw_rates
from .sensor_log import SensorLog
from .spin import places
from .straight import Straight, rest

SPEEDS = (0.3, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5)
"""m/s, as many as there is room for."""
CIRCLE = (0.3, 0.5, 0.7, 0.9, 1.1)
"""m/s on a radius of 1 m: at most 1.2 m/s2 to the side."""
LEAN = 0.3
"""Of the steering command: 0.17 rad of road wheel by the paper's map, a radius of 1 m."""
ROOM, LEAST_ROOM = 4.0, 2.5
"""m of straight floor; with less than that a circle tells more."""
CIRCLE_FLOOR = (3.5, 3.5)
"""m: a circle of 1 m radius, car and margin included."""
CIRCLE_SETTLES = 2.5
"""s at a new speed of a circle, from above as well: a second of integral twice over."""
REPEATS = 2
PULLS_UP, SETTLE = (0.3, 0.35), 0.8
"""s, and s for each m/s, until a speed is reached; s until the loop is quiet."""
MEASURE, LONGEST, CIRCLING = 0.8, 2.0, 2.5
"""m (at least s) of a measurement, at most s; s of one in a circle."""
ROLLS_OUT, MARGIN = 1.05, 0.2
"""m/s2 of the friction, at least; m of floor behind it."""
NUDGE, NUDGED = 0.4, 4.0
"""m/s, and s at most, of the first pull, which shows which way the car goes."""
UNSETTLED = 0.8
"""m/s2 that no frozen pulse leaves of a settled speed: 25 us of it."""
FELT = 0.5
"""Share of the change of speed that the accelerometer must confirm: mount, tilt, filter."""
PULL_STD, TURN_STD = 0.1, 0.3
"""Relative errors of the paper's motor (of what takes off an acceleration) and of what its tyres
take in a circle."""
AVERAGED = 40
"""Frames of the settled loop of which the frozen pulse is the mean."""
TRIAL, FEW = 0.3, 8
"""s of a pulse that shows how much shorter or longer it has to be; edges of a stretch, at least."""
LATE = 0.08
"""s until a pulse acts: two PWM frames, and what the ESC takes to believe it."""

Keep = Callable[[float, float | None], list[State]]
"""Holds a speed, or a pulse [us] from there, for so many s more."""


@dataclass(frozen=True, slots=True)
class Held:
    """One speed held: mean speed [m/s], pulse [us] without acceleration and turning, one sigma
    of what was taken off for them [us]."""

    target: float
    speed: float
    pulse_us: float
    taken_us: float


def _pulls_up(speed: float) -> float:
    """s until it is reached."""
    return PULLS_UP[0] + PULLS_UP[1] * speed


def floor_for(speed: float) -> float:
    """m of straight floor for one speed [m/s], from rest to rest."""
    measured = min(max(MEASURE / speed, MEASURE), LONGEST)
    held = _pulls_up(speed) + SETTLE + TRIAL + 2.0 * LATE + measured
    return speed * held + speed**2 / (2.0 * ROLLS_OUT) + MARGIN


def speeds_in(room: float) -> tuple[float, ...]:
    """The speeds [m/s] that a straight floor of that length [m] has room for; () below 2.5 m."""
    return tuple(v for v in SPEEDS if floor_for(v) <= room) if room >= LEAST_ROOM else ()


def plan(files: CarFiles, room: float = ROOM) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    speeds = speeds_in(room)
    if not speeds:
        seconds = 2 * len(CIRCLE) * (CIRCLE_SETTLES + SETTLE + TRIAL + CIRCLING) + 15.0
        return ProcedurePlan(
            f"circles at {CIRCLE[0]} to {CIRCLE[-1]} m/s to measure which pulse holds which "
            f"speed: about {seconds:.0f} s, a level floor of {CIRCLE_FLOOR[0]:g} m x "
            f"{CIRCLE_FLOOR[1]:g} m; no tools", seconds, CIRCLE_FLOOR)
    seconds = REPEATS * sum(floor_for(v) / v + 3.0 for v in speeds) + 10.0
    return ProcedurePlan(
        f"drives straight {REPEATS * len(speeds)} times at {speeds[0]} to {speeds[-1]} m/s to "
        f"measure which pulse holds which speed: about {seconds:.0f} s without carrying it "
        f"back, a level floor of {room:.1f} m x 1 m; chalk for the start", seconds, (room, 1.0))


def measure(bench: Bench, room: float = ROOM) -> Measured:
    """Measure the pulse of each speed in ``room`` [m] of straight floor; below 2.5 the car circles.

    Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    workshop = bench.workshop
    progress = bench.progress
    log = SensorLog(car)
    start = next(iter(car.states())).t
    try:
        progress(0.0, "pushing the car by hand")
        turn_by_hand(car, workshop)
        with naming(car, workshop):
            progress(0.05, "which way it goes")
            _nudge(car)
            held = _straight(car, workshop, log, room, progress) if speeds_in(room) else _circle(
                car, log, progress)
    finally:
        car.stop()
    table, residual = table_of(held, files)
    where = f"{room:.1f} m straight" if speeds_in(room) else "circles of 1 m"
    return Measured(
        files.config.name, bench.source, "throttle", {}, residual,
        next(iter(car.states())).t - start,
        (f"measured with today's battery and on this floor, {where}",
         f"a pulse's 90 % interval is +- {INTERVAL_90 * max(table.std_us):.2f} us at most"),
        others={"throttle.drive": table})


# -- driving -----------------------------------------------------------------------


def _nudge(car: Car) -> None:
    """A short pull: does the car go forward? Errors: CalibrationFailed that says what else."""
    center = car.files.config.steering.center_us
    with driving(car) as runner:
        still = runner.hold(0.3, center, 0.0)
        offset = float(np.mean([s.accel_x or 0.0 for s in still]))
        felt, seen = 0.0, still[-1:]
        while seen[-1].t - seen[0].t < NUDGED and abs(seen[-1].speed) < NUDGE:
            seen += runner.hold(0.0, center, NUDGE)
            felt += 0.01 * ((seen[-1].accel_x or 0.0) - offset)
        if seen[-1].ticks == seen[0].ticks:
            raise NotSeen("the car does not move", found="0 edges of a throttle",
                          expected="motion")
    gained = abs(seen[-1].speed)
    if felt < -FELT * gained:
        raise CalibrationFailed(
            "a pulse above neutral drives the car backward",
            found=f"{felt:+.2f} m/s by the accelerometer, wheels at {gained:.2f} m/s",
            expected="a pull forward",
            likely="the motor's leads are swapped, or the IMU is turned by 180 degrees (push the "
                   "car forward by hand: accel_x must be positive)",
            remedy="swap the two leads of the motor, or mount_yaw = 3.1416 under [imu]")
    if felt < FELT * gained:
        raise CalibrationFailed(
            "the wheels turn but the car does not move",
            found=f"{felt:+.2f} m/s by the accelerometer, wheels at {gained:.2f} m/s",
            expected=f"at least {FELT * gained:.2f} m/s",
            likely="the wheels are off the ground or spin, or the accelerometer is stuck",
            remedy="put the car on the floor; dart-hal doctor")


def _straight(car: Car, workshop: Workshop, log: SensorLog, room: float,
              progress: Progress) -> list[Held]:
    held = []
    runs = [v for v in speeds_in(room) for _ in range(REPEATS)]
    for k, speed in enumerate(runs):
        progress(0.1 + 0.9 * k / len(runs), f"{speed} m/s, run {k + 1} of {len(runs)}")
        workshop.mark()
        with driving(car) as runner:
            here = rest(runner, car.files.config.steering.center_us)
            keep = _along(runner, Straight(car.files, here.pose), speed, here)
            keep(_pulls_up(speed), None)
            held.append(_measure(keep, log, speed, car.files,
                                 min(max(MEASURE / speed, MEASURE), LONGEST)))
    return held


def _along(runner: Runner, line: Straight, speed: float, here: State) -> Keep:
    """Holds a speed [m/s] along the line."""
    def keep(seconds: float, pulse_us: float | None) -> list[State]:
        nonlocal here
        seen: list[State] = []
        while not seen or here.t - seen[0].t < seconds:
            here = runner.hold(0.0, line.pulse(here), speed, pulse_us)[-1]
            seen.append(here)
        return seen

    return keep


def _circle(car: Car, log: SensorLog, progress: Progress) -> list[Held]:
    steering = car.files.config.steering
    pulse = steering.center_us + steering.direction * LEAN * steering.span_us
    held = []
    order = [*CIRCLE, *CIRCLE[::-1]]
    with driving(car) as runner:
        runner.start_moving(pulse, CIRCLE[0], 0.0, True)
        for k, speed in enumerate(order):
            progress(0.1 + 0.9 * k / len(order), f"{speed} m/s in a circle")
            runner.hold(CIRCLE_SETTLES, pulse, speed)
            held.append(_measure(_round(runner, pulse, speed), log, speed, car.files, CIRCLING))
    return held


def _round(runner: Runner, steering_us: float, speed: float) -> Keep:
    """Holds a speed [m/s] in a circle."""
    return lambda seconds, pulse_us: runner.hold(seconds, steering_us, speed, pulse_us)


def _measure(keep: Keep, log: SensorLog, target: float, files: CarFiles,
             seconds: float) -> Held:
    settled = keep(SETTLE, None)[-AVERAGED:]
    pulse = float(np.mean([s.applied.throttle_us for s in settled]))
    for stretch in (TRIAL, seconds):  # the second from where the first one had no acceleration
        frozen = pulse
        keep(LATE, frozen)
        log.pairs()
        states = keep(stretch, frozen)
        speed, acceleration = _moved(log, target, stretch, files)
        pull = (PAPER.motor.d - PAPER.motor.e * speed) / files.config.throttle.span_us
        gained = PAPER.body.mass * acceleration / pull
        pulse = frozen - gained
    turning = _taken_by_tyres(speed, float(np.mean(yaw_rates(states) or [0.0]))) / pull
    return Held(target, speed, pulse - turning,
                math.hypot(PULL_STD * gained, TURN_STD * turning))


def _moved(log: SensorLog, target: float, seconds: float, files: CarFiles) -> tuple[float, float]:
    """(mean speed [m/s], acceleration [m/s2]) of the last stretch. Errors: NotSeen."""
    t, x = places([sample for sample, _ in log.pairs()], files.metres_per_edge.value)
    if len(t) < FEW or x[-1] < 0.5 * target * seconds:
        raise NotSeen(f"the car does not reach {target} m/s",
                      found=f"{x[-1] if len(x) else 0.0:.2f} m in {seconds:.1f} s",
                      expected=f"{target * seconds:.2f} m",
                      likely="battery low, something in the way, or a loose wire",
                      remedy="charge the battery; dart-hal doctor")
    acceleration, speed, _ = np.polyfit(t - t.mean(), x, 2) * (2.0, 1.0, 1.0)
    if abs(acceleration) > UNSETTLED:
        raise CalibrationFailed(f"the car does not keep {target} m/s at a steady pulse",
                                found=f"{acceleration:+.2f} m/s2 at {speed:.2f} m/s",
                                expected=f"at most {UNSETTLED} m/s2",
                                likely="the floor slopes, a wheel spins, or edges are lost",
                                remedy="a level floor with grip; dart-hal doctor")
    return float(speed), float(acceleration)


def _taken_by_tyres(speed: float, rate: float) -> float:
    """What a steady turn takes from the pull [N]: the front tyres' side force along the car, and
    the slide of the body. By the paper's parameters."""
    body, tyres = PAPER.body, PAPER.tyres
    assert isinstance(tyres, PaperTyres)
    aside = speed * rate
    front, rear = (body.mass * aside * arm / body.wheelbase for arm in (body.l_r, body.l_f))
    slides = body.l_r * rate - speed * rear / tyres.rear_cornering_stiffness
    return front * body.wheelbase * rate / speed - body.mass * rate * slides


# -- the table -----------------------------------------------------------------------


def table_of(held: Sequence[Held], files: CarFiles) -> tuple[DriveTable, str]:
    """(speed and pulse with standard errors, how well they repeat).

    Errors: CalibrationFailed where a faster drive needed a shorter pulse.
    """
    targets = sorted({h.target for h in held})
    groups = [[h for h in held if h.target == v] for v in targets]
    speed = np.array([np.mean([h.speed for h in g]) for g in groups])
    pulse = np.array([np.mean([h.pulse_us for h in g]) for g in groups])
    if not (np.all(np.diff(pulse) > 0.0) and np.all(np.diff(speed) > 0.0)):
        raise CalibrationFailed(
            "a faster drive needed a shorter pulse",
            found=", ".join(f"{v:.2f} m/s {p:.1f} us" for v, p in zip(speed, pulse, strict=True)),
            expected="pulses that rise with the speed",
            likely="a sloping floor, or a battery that recovered between two runs",
            remedy="a level floor, a charged battery; run it again")
    slope = np.gradient(pulse, speed)
    apart = np.concatenate([
        [h.pulse_us - p - s * (h.speed - v) for h in g]
        for g, v, p, s in zip(groups, speed, pulse, slope, strict=True)])
    free = max(len(apart) - len(groups), 1)
    spread = math.sqrt(float(apart @ apart) / free / REPEATS)
    taken = np.array([np.mean([h.taken_us for h in g]) for g in groups])
    return _table(speed, pulse, slope, spread, taken, files), (
        f"a repeated speed needs the same pulse within {float(np.max(np.abs(apart))):.2f} us")


def _table(speed: FloatArray, pulse: FloatArray, slope: FloatArray, spread: float,
           taken: FloatArray, files: CarFiles) -> DriveTable:
    """With what the clock, the travel per edge and what was taken off may be wrong."""
    clock, metres = files.oscillator_hz, files.metres_per_edge
    rate = clock.std / clock.value if clock else UNKNOWN
    std = np.sqrt(spread**2 + taken**2 + (rate * pulse) ** 2
                  + (slope * speed * metres.std / metres.value) ** 2)
    return DriveTable(speed=tuple(round(float(v), 4) for v in speed),
                      pulse_us=tuple(round(float(p), 3) for p in pulse),
                      std_us=tuple(round(float(s), 3) for s in std))


def _plot(result: Measured, files: CarFiles, path: Path) -> None:
    from .plot import plot_throttle

    plot_throttle(result, files, path)


calibrate_throttle = Procedure(
    name="throttle",
    help="""Which pulse holds which speed, for drive_speed's feed-forward.

    The car drives from rest to rest at one speed after the other; you put it back
    to the start. Measure esc and encoder first.
    """,
    plan=plan, measure=measure, adapt=lambda floor: {"room": min(ROOM, max(floor))},
    options=(Option("room", "straight floor; more of it reaches faster speeds, below 2.5 m the "
                    "car circles on 3.5 m x 3.5 m", ROOM, "m", 0.0, 30.0, metavar="METRES"),),
    plot=_plot, plot_help="picture of the pulses beside the model's",
    keys=("throttle.drive",), after=("clock", "esc", "encoder"))
