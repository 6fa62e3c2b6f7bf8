"""``calibrate steering`` on a Car: slow arcs over the whole range, from both sides.

1. At rest: the gyro bias.
2. From full right to full left slowly, and back faster. Each command is a whole number of PCA9685
   counts and is kept while the ring turns whole revolutions.
3. The angle is atan(l omega/v). Least squares removes backlash and tyre slip (``loop``).

Works on every backend, in the car's own time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dart_hal.calibration.samples import Samples
from dart_hal.calibration.steering_map import fit_map
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.types import Estimate, FloatArray, State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.vehicle.fitting.batches import standard_error

from .loop import LoopFit, Systematic, Window, fit_loop, resample
from .measured import write
from .procedure import Ask, Bench, Option, Procedure, ProcedurePlan, Progress, agree, silent
from .result import SteeringResult
from .runner import CalibrationRunner, DrivableCar, driving, yaw_rates
from .schedule import (
    BIAS_TIME,
    LEVEL_COUNT,
    MEASURE_TIME,
    SETTLE_TIME,
    SWEEP_SPEEDS,
    Leg,
    Spot,
    SteeringPlan,
    SteeringStep,
    make_legs,
    make_plan,
    make_steps,
    possible_cars,
    return_futures,
    waiting_time,
)

if TYPE_CHECKING:
    from dart_hal.car import Car

# Relative, one sigma of an uncalibrated BNO055 (data sheet: 1 % typical).
UNCALIBRATED_GYRO_STD = 0.006
# m, one sigma of a ruler on the axles.
WHEELBASE_STD = 0.0003
# rad/s, largest plausible bias.
MAX_GYRO_BIAS = 0.15
# Batches of a window for its standard error.
WINDOW_BATCHES = 5
# m/s; closer speeds do not show the slip of the tyres.
MIN_SPEED_DIFFERENCE = 0.1
WAIVED_BY_RAW = {
    "PWM_CLOCK_UNCALIBRATED": "the PWM clock of this car was never measured; the map includes its "
                              "error as long as the clock stays (after another PCA9685 or an "
                              "entry [pwm] oscillator_hz calibrate again)",
    "CALIBRATION_MISSING": "this car had no calibration.toml",
}


def plan(files: CarFiles, *, levels: int = LEVEL_COUNT,
         speeds: tuple[float, float] = SWEEP_SPEEDS) -> SteeringPlan:
    """Plan ``calibrate_steering`` for this car: time, floor, speed."""
    steering = files.config.steering
    count = counter_of(files)[1]
    steps = make_steps(center_us=steering.center_us, span_us=steering.span_us,
                       direction=steering.direction, count=count, levels=levels, speeds=speeds)
    return make_plan(steps, files.config.geometry.wheelbase)


def calibrate_steering(car: Car, *, progress: Progress = silent, ask: Ask = agree,
                       dry_run: bool = False, source: str = "", levels: int = LEVEL_COUNT,
                       speeds: tuple[float, float] = SWEEP_SPEEDS) -> SteeringResult:
    """Measure the steering map and write it to the car's calibration.toml.

    ``car`` is open. It is armed here if necessary, and always left stopped, also on Ctrl-C. ``ask``
    is called before the car moves; False ends the procedure. Nothing is written with ``dry_run``.
    Car time: about 55 s. Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    result = STEERING_PROCEDURE(car, progress=progress, ask=ask, source=source, levels=levels,
                                speeds=speeds)
    return result if dry_run else write(car.files, result)


def measure_map(bench: Bench, levels: int = LEVEL_COUNT, speeds: tuple[float, float] = SWEEP_SPEEDS
                ) -> SteeringResult:
    """Measure the steering map. Raises as ``calibrate_steering``."""
    car = bench.car
    files = bench.files
    waived = _waived_refusals(car)
    with driving(car):
        windows, bias = drive(car, plan(files, levels=levels, speeds=speeds), bench.progress)
    bench.progress(0.97, "fitting")
    fit = fit_loop(windows, files.config.geometry.wheelbase, _systematic(files, bias))
    return _result(files, bench.source, windows, fit, bias, waived)


def drive(car: DrivableCar, route: SteeringPlan, progress: Progress
          ) -> tuple[list[Window], Estimate]:
    """Drive the plan; return the windows in order and the gyro bias [rad/s]."""
    runner = CalibrationRunner(car)
    forth = route.forth
    back = route.back
    progress(0.0, "at rest for the gyro")
    still = runner.hold(BIAS_TIME, forth[0].pulse_us, 0.0)
    bias = estimate_bias(still)
    progress(0.05, "starting")
    runner.start_moving(forth[0].pulse_us, forth[0].speed, bias.value, forth[0].command > 0.0)
    windows: list[Window] = []
    done = 0
    for sweep in (forth, back):
        if sweep is forth:
            futures = [make_legs(forth, route.wheelbase, other) for other in possible_cars()]
        else:
            futures = return_futures(back, [w.yaw_rate / w.speed for w in windows[::-1]],
                                     route.wheelbase)
        progress(0.08 + 0.88 * done / len(route.steps), "turning towards the free floor")
        _turn_home(runner, sweep[0], futures, still[-1])
        for step in sweep:
            progress(0.08 + 0.88 * done / len(route.steps),
                     f"command {step.command:+.2f} at {step.speed:.2f} m/s")
            runner.hold(SETTLE_TIME, step.pulse_us, step.speed)
            states = runner.hold(MEASURE_TIME, step.pulse_us, step.speed)
            windows.append(measure(states, step, bias.value, car.files))
            done += 1
    runner.hold(0.3, back[-1].pulse_us, 0.0)
    return windows, bias


def _turn_home(runner: CalibrationRunner, first: SteeringStep, futures: list[list[Leg]],
               start: State) -> None:
    """Circle at the lock of ``first`` until the next sweep will stay near the start."""
    states = runner.hold(SETTLE_TIME, first.pulse_us, first.speed)
    pose = states[-1].pose
    rate = (pose.yaw - states[0].pose.yaw) / (states[-1].t - states[0].t)
    seconds = waiting_time(Spot(pose.x, pose.y, pose.yaw), first.speed, rate, futures,
                           (start.pose.x, start.pose.y))
    runner.hold(seconds, first.pulse_us, first.speed)


def measure(states: list[State], step: SteeringStep, bias: float, files: CarFiles) -> Window:
    """Make a window of its frames, cut to whole revolutions of the ring.

    Raises CalibrationFailed for too few valid frames, or if the car stopped.
    """
    edges = files.config.encoder.edges_per_rev
    valid = [s for s in states if s.yaw_rate is not None and s.health.imu_age < 0.1]
    if len(valid) < 0.7 * len(states) or len(valid) < 20:
        raise CalibrationFailed("the IMU dropped out while measuring",
                                found=f"{len(valid)} of {len(states)} frames with a fresh yaw rate",
                                expected="at least 70 %", remedy="dart-hal doctor")
    turned = abs(valid[-1].ticks - valid[0].ticks)
    revolutions = turned // edges
    if revolutions < 1:
        raise CalibrationFailed("the car stopped while measuring",
                                found=f"{turned} edges in {valid[-1].t - valid[0].t:.1f} s",
                                expected=f"at least {edges}", likely="an obstacle",
                                remedy="free the car and run it again")
    target = revolutions * edges
    end = next(i for i, s in enumerate(valid) if abs(s.ticks - valid[0].ticks) >= target)
    used = valid[:max(end, 10)]
    speed = np.array([s.speed for s in used])
    rate = np.array(yaw_rates(used)) - bias
    wheelbase = files.config.geometry.wheelbase
    angle = math.atan2(wheelbase * float(rate.mean()), float(speed.mean()))
    return Window(step.command, step.pulse_us, angle, _std(speed, rate, wheelbase),
                  float(speed.mean()), float(rate.mean()), float(step.direction), len(used),
                  used[-1].t - used[0].t)


def _std(speed: FloatArray, rate: FloatArray, wheelbase: float) -> float:
    """One sigma of the angle [rad] by batch means, which include slow drift within the window."""
    means = [math.atan2(wheelbase * float(r.mean()), float(v.mean()))
             for v, r in zip(np.array_split(speed, WINDOW_BATCHES),
                             np.array_split(rate, WINDOW_BATCHES), strict=True)]
    return float(np.std(means, ddof=1) / math.sqrt(WINDOW_BATCHES))


def estimate_bias(states: list[State]) -> Estimate:
    """Estimate the gyro bias [rad/s] from States at rest, without the first quarter of them.

    Raises CalibrationFailed if yaw rates are missing, the car moves, or the bias is implausible.
    """
    rates = np.array(yaw_rates(states[len(states) // 4:]))
    if len(rates) < 50:
        raise CalibrationFailed("no yaw rate at standstill",
                                found=f"{len(rates)} valid samples",
                                expected="at least 50 (100 per second)",
                                likely="IMU unplugged, or still starting",
                                remedy="dart-hal doctor")
    if states[-1].ticks != states[len(states) // 4].ticks:
        raise CalibrationFailed(
            "the car rolls at a neutral throttle",
            found=f"{abs(states[-1].ticks - states[len(states) // 4].ticks)} edges at neutral",
            expected="standstill", likely="neutral of the ESC is off, or the floor slopes",
            remedy="level the floor; or [throttle] neutral_us in car.toml")
    bias = float(rates.mean())
    if abs(bias) > MAX_GYRO_BIAS:
        raise CalibrationFailed("the gyro turns while the car is at rest",
                                found=f"{bias:+.3f} rad/s", expected=f"below {MAX_GYRO_BIAS} rad/s",
                                likely="the car was moved by hand, or the IMU is still starting",
                                remedy="leave the car alone and run it again")
    batches = [part.mean() for part in np.array_split(rates, 10)]
    return Estimate(bias, float(standard_error(batches)), "rad/s")


def _systematic(files: CarFiles, bias: Estimate) -> Systematic:
    metres = files.metres_per_edge
    imu = files.calibration.imu if files.calibration else None
    known = imu.gyro_scale if imu else None
    gyro = known.std / known.value if known else UNCALIBRATED_GYRO_STD
    wheelbase = WHEELBASE_STD / files.config.geometry.wheelbase
    return Systematic(math.sqrt((metres.std / metres.value) ** 2 + gyro**2 + wheelbase**2),
                      bias.std)


def _result(files: CarFiles, source: str, windows: list[Window], fit: LoopFit, bias: Estimate,
            waived: tuple[str, ...]) -> SteeringResult:
    command = np.linspace(-1.0, 1.0, len(fit.command))
    pulse, angle, covariance = resample(fit, command)
    std = np.sqrt(np.diag(covariance))
    form = fit_map(Samples(command, angle, np.zeros_like(angle), np.ones_like(angle),
                           np.ones_like(angle), np.arange(len(angle))))
    metres = files.metres_per_edge
    notes = (
        f"tyre slip: understeer {fit.kappa.value:.4f} +- {fit.kappa.std:.4f} s2/m2, removed",
        f"the servo rests within {fit.rest_us:.1f} us (one sigma) of its target",
        f"gyro bias at standstill {bias.value:+.5f} rad/s, removed",
        f"of angle_std_rad the wheel travel per edge (+-{metres.std / metres.value:.1%}) is common "
        "to all points; a taped distance entered as [encoder] metres_per_edge reduces it",
        *waived,
    )
    return SteeringResult(
        car=files.config.name, source=source, n=sum(w.n for w in windows),
        duration=float(sum(w.duration for w in windows)), command=command, angle=angle,
        angle_std=std, pulse_us=pulse, paper_form=form.as_dict(),
        residual_rms=float(np.sqrt(np.mean(fit.residual**2))), backlash=fit.backlash,
        notes=notes, covariance=covariance,
        samples=(np.array([w.command for w in windows]), _without_slip(windows, fit),
                 np.array([w.direction for w in windows])),
        extra={"understeer": {"value": fit.kappa.value, "std": fit.kappa.std, "unit": "s2/m2"},
               "speeds_m_s": sorted({round(w.speed, 2) for w in windows})})


def _waived_refusals(car: DrivableCar) -> tuple[str, ...]:
    """Describe refusals of arm() that raw() ignores, and their effect on the map."""
    return tuple(f"{name} waived by raw mode: {text}" for name, text in WAIVED_BY_RAW.items()
                 if name in car.refusals())


def _without_slip(windows: list[Window], fit: LoopFit) -> FloatArray:
    angle = np.array([w.angle for w in windows])
    speed = np.array([w.speed for w in windows])
    return np.asarray(angle + 0.5 * np.sin(2.0 * angle) * fit.kappa.value * speed**2)


def _plan(files: CarFiles, levels: int = LEVEL_COUNT, speeds: tuple[float, float] = SWEEP_SPEEDS
          ) -> ProcedurePlan:
    route = plan(files, levels=levels, speeds=speeds)
    return ProcedurePlan(str(route), route.time, (2.0 * route.radius, 2.0 * route.radius))


def _check_speeds(speeds: tuple[float, float] = SWEEP_SPEEDS) -> None:
    if abs(speeds[1] - speeds[0]) < MIN_SPEED_DIFFERENCE:
        raise UsageError("the two speeds must differ: their difference shows the slip of the tyres",
                         found="--speeds {} {}".format(*speeds),
                         expected=f"a difference of at least {MIN_SPEED_DIFFERENCE} m/s")


def _plot(result: SteeringResult, files: CarFiles, path: Path) -> None:
    from .plot import plot_steering

    plot_steering(result, path)


def _fit(paths: Sequence[Path], car: str) -> SteeringResult:
    from .from_recordings import steering_from

    return steering_from(paths, car=car)


STEERING_PROCEDURE = Procedure(
    name="steering",
    help="""The map from steering command to road-wheel angle, with its standard errors.

    On a car: slow circles over the whole range, from both sides, about one minute. With --from:
    recordings, MCAP or the DART CSV files. Their map from commands (-1..1) is never written.
    """,
    plan=_plan, measure=measure_map, check=_check_speeds,
    options=(Option("speeds", "m/s there and back; slower needs less floor, and both must differ",
                    SWEEP_SPEEDS, "m/s", 0.15, 0.8, metavar="SLOW FAST"),),
    plot=_plot, plot_help="map, data and residuals",
    fit=_fit, fit_help="fit recordings (files or folders) instead of driving; to "
    "compare, and for the paper's form: nothing is written to calibration.toml",
    keys=("steering.map",), after=("clock", "encoder", "imu"), confirm=False)
