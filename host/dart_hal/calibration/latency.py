"""``calibrate latency``: how late each part of the loop answers, in seconds of the car's clock.

Standing, the Nano times pulses of the spare channel: command to pulse. In a circle the throttle
steps up and down: pulse to the force of the wheels. Slowly, the steering goes in stairs and back on
the left: pulse to the road wheels, and the servo's slew. All the while, how old a State is when it
arrives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.quantity import Quantities
from dart_hal.core.types import FloatArray, State
from dart_hal.devices.actuation.quantiser import counter_of

from .by_hand import naming
from .latency_fit import HIDDEN_SERVO_LAG, Pull, Turning, fit_wheel, fit_yaw, linkage_of
from .latency_log import CAPTURE_WAIT, TRIALS, Grid, Traffic, TrafficLog, measured_grid
from .measured import Measured
from .procedure import Bench, Procedure, ProcedurePlan
from .runner import Runner, check_turning, doubted, driving
from .steering import standing_bias

REPEATS = 12
"""Steps up and down of the throttle: twice the fewest from which their spread can be told."""
STANDING = 3.0
"""s at rest, in which the gyro shows its bias: 300 frames."""
RADIUS, CRUISE = 1.1, 0.9
"""m of the circle, m/s in it."""
UP, DOWN = 0.12, 0.04
"""Of throttle above and below what holds the speed: 1.8 m/s2 and half of rolling out."""
UP_FOR, DOWN_FOR = 0.25, 0.55
SLOWLY, ROUNDS = 0.5, 3
"""m/s in the turns of the steering, and how often all of ``STAIRS`` are turned."""
STAIRS = (0.7, 0.5, 0.3, 0.1, -0.1, 0.9, -0.1, 0.1, 0.3, 0.5, 0.7, 0.9, -0.1, 0.9)
"""Steering commands one after the other, from the last on: bends to the left inside that circle.
Eight steps that go on in the direction of the one before, four large ones back."""
LARGE, LARGE_FOR, SMALL_FOR = 0.5, 0.5, 0.3
"""A larger step is held longer [s]: servo, tyres and gyro come to rest."""
FLOOR = (4.0, 4.0)
"""m: the circle, what slip and a map that nobody measured widen it by, and the car."""
VARIED = (0.0, 0.02, 0.01, 0.03)
"""s by which the steps of a repetition last longer, so that they meet all phases of the frames."""
KNOWN, LONGEST_WAIT, AT_ONCE = 1.0e-3, 60.0, 1.0
"""s, one sigma of the age of the gyro's samples that is waited for, and for how long at most: in a
minute clocks that differ by 0.01 % come by one of the two ages at which it shows."""
IN_STEP = 1.5e-3
"""s, one sigma of the delay of the steering: twice that of an age that shows."""
LOST = 0.3e-3
"""s, a floor of the arrival's sigma: what no ping can see."""


def plan(files: CarFiles) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    still = TRIALS * (CAPTURE_WAIT + 0.2)
    seconds = still + REPEATS * (UP_FOR + DOWN_FOR) + ROUNDS * 5.5 + 12.0
    return ProcedurePlan(
        f"stands {still:.0f} s, then circles to the left on {RADIUS:g} m with "
        f"{REPEATS} steps of the throttle (0.5 to 1.5 m/s) and slowly with "
        f"{ROUNDS * len(STAIRS)} steps of the steering, to measure how late the car answers: "
        f"about {seconds:.0f} s, or a minute more at rest in between, a floor of "
        f"{FLOOR[0]:g} m x {FLOOR[1]:g} m, mostly to its left, no tools; a wire from channel "
        f"{files.config.pwm.clock_channel} to the Nano's D8 shows the pulses", seconds, FLOOR)


def measure(bench: Bench) -> Measured:
    """Measure delays and lags [s]; the workshop turns a wheel where no motion is seen.

    Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    progress = bench.progress
    log = TrafficLog(car)
    edges, metres = files.config.encoder.edges_per_rev, files.metres_per_edge.value
    with naming(car, bench.workshop), driving(car):
        progress(0.0, "timing pulses")
        grid = measured_grid(car, log)
        standing = log.take()
        progress(0.2, "steps of the throttle")
        bias = standing_bias(Runner(car).hold(STANDING, _circle(files), 0.0)).value
        pulled, at = _pull(car, log, bias)
        progress(0.6, "the gyro's clock")
        _await_gyro(car, log)
        progress(0.7, "steps of the steering")
        turned = _turn(car, log)
    progress(0.95, "fitting")
    throttle = files.neutral_us, files.config.throttle.span_us
    pull = fit_wheel(grid, pulled, at, throttle, metres, edges)
    turning = fit_yaw(grid, turned, linkage_of(files), SLOWLY, metres, edges)
    seconds = turned.column("t")[-1] - standing.column("t")[0]
    return Measured(files.config.name, bench.source, "latency",
                    _quantities(grid, pull, turning, standing),
                    f"edges {1e3 * pull.left:.2f} mm and yaw rate {turning.left:.4f} rad/s off the "
                    "fit", float(seconds), _notes(files, grid, turning))


def _quantities(grid: Grid, pull: Pull, turning: Turning, standing: Traffic
                ) -> dict[str, Quantity | Quantities]:
    blind = 0.0 if grid.seen else grid.phase_std
    unseen = "" if grid.seen else ", the PWM frames not seen"
    how, turns = (f"{n} steps{unseen}" for n in (REPEATS, ROUNDS * len(STAIRS)))
    found = {
        "latency.command_to_pulse": (*grid.to_pulse, f"{TRIALS} pulses at D8" if grid.seen else
                                     "derived: half a PWM frame, the bus and a pulse"),
        "latency.pulse_to_wheel": (pull.delay[0], math.hypot(pull.delay[1], blind), how),
        "latency.pulse_to_wheel_lag": (*pull.lag, how),
        "latency.pulse_to_yaw": (turning.delay[0], math.hypot(turning.delay[1], blind), turns),
        "latency.sensor_to_host": (*_arrival(standing), "arrivals by the clock fit"),
        "steering.slew_us_s": (*turning.slew, turns),
    }
    if turning.lag is not None:
        found["latency.pulse_to_yaw_lag"] = (*turning.lag, turns)
    return {name: Quantity(float(value), float(std), method)
            for name, (value, std, method) in found.items()}


def _notes(files: CarFiles, grid: Grid, turning: Turning) -> tuple[str, ...]:
    notes = []
    if not grid.seen:
        notes.append("caution: no pulse was seen at D8, so when a pulse begins is known to half a "
                     "PWM frame alone: fit the wire from the spare channel and run it again")
    if files.calibration is None or files.calibration.steering.map is None:
        notes.append("caution: the map of the steering is not known, and the slew to some percent: "
                     "dart-hal calibrate steering, then this again")
    if turning.delay[1] > IN_STEP:
        notes.append("caution: how old the samples of the gyro are did not show (its clock and the "
                     "Nano's ran in step: run it again; or its firmware does not look at them: "
                     "dart-hal flash): pulse_to_yaw is known to some ms")
    if turning.lag is None:
        notes.append(f"a lag of the servo below {HIDDEN_SERVO_LAG} s does not show behind its slew")
    return (*notes, "drive_speed is tuned by these from the next start on")


def _arrival(traffic: Traffic) -> tuple[float, float]:
    """(median, one sigma) [s] from the latch of a State to its arrival."""
    late = traffic.column("arrival") - traffic.column("t")
    spread = float(np.std(late) / math.sqrt(len(late)))
    return float(np.median(late)), math.hypot(spread, float(np.median(traffic.column("t_std"))),
                                              LOST)


def _pulse(files: CarFiles, command: float) -> float:
    """Steering pulse [us] of a command, a whole number of counts: no rounding to be made up for."""
    steering = files.config.steering
    return _whole(files, steering.center_us + steering.span_us * steering.direction * command)


def _circle(files: CarFiles) -> float:
    """Steering pulse [us] of the circle to the left, by the car's map."""
    return _whole(files, linkage_of(files).map.pulse(
        math.atan(files.config.geometry.wheelbase / RADIUS)))


def _whole(files: CarFiles, pulse_us: float) -> float:
    count = counter_of(files)[1]
    return round(pulse_us / count) * count


def _pull(car: Car, log: TrafficLog, bias: float) -> tuple[Traffic, FloatArray]:
    """Steps of the throttle in a circle; when each began [s]."""
    files, runner = car.files, Runner(car)
    bend = _circle(files)
    runner.start_moving(bend, CRUISE, bias, True)
    runner.hold(1.0, bend, CRUISE)
    log.take()
    runner.hold(1.0, bend, CRUISE)
    holds = float(np.mean(log.take().written[:, 2]))
    span, starts = files.config.throttle.span_us, []
    up, down = (_whole(files, holds + span * part) for part in (UP, -DOWN))
    states = iter(car.states())
    t = _held(car, states, bend, down, 2 * DOWN_FOR)
    for k in range(REPEATS + 1):
        starts.append(t)
        t = _held(car, states, bend, up, UP_FOR + VARIED[k % 4])
        t = _held(car, states, bend, down, DOWN_FOR + VARIED[(k + k // 4) % 4])
    return log.take(), np.array(starts)


def _held(car: Car, states: Iterator[State], steering_us: float, throttle_us: float,
          seconds: float) -> float:
    """Both pulses for a while; returns the time [s]. Errors: CalibrationFailed at a doubt."""
    start: float | None = None
    for state in states:
        start = state.t if start is None else start
        if state.health.speed_doubted:
            raise doubted(state)
        car.pulses(steering_us=steering_us, throttle_us=throttle_us)
        if state.t - start >= seconds:
            return state.t
    raise AssertionError("states() ended by itself")


def _await_gyro(car: Car, log: TrafficLog) -> None:
    """At rest until it is known when the gyro's samples are taken, where its looks tell it."""
    runner, waited = Runner(car), 0.0
    while (log.age_std or 0.0) > KNOWN and waited < LONGEST_WAIT:
        runner.hold(AT_ONCE, _circle(car.files), 0.0)
        waited += AT_ONCE


def _turn(car: Car, log: TrafficLog) -> Traffic:
    """Stairs of the steering at a steady speed, and back."""
    runner, files = Runner(car), car.files
    last = STAIRS[-1]
    seen = runner.hold(2.5, _pulse(files, last), SLOWLY)
    check_turning(seen[-40:], 0.0, True)
    log.take()
    for k, command in enumerate((*STAIRS * ROUNDS, STAIRS[0])):
        held = LARGE_FOR if abs(command - last) > LARGE else SMALL_FOR
        runner.hold(held + VARIED[(k + k // 4) % 4], _pulse(files, command), SLOWLY)
        last = command
    return log.take()


calibrate_latency = Procedure(
    name="latency",
    help="""How late the car answers: command to pulse, pulse to wheels, sensor to host.

    The car stands while the Nano times pulses (by the wire to its D8), then circles
    to the left with steps of the throttle, and of the steering. drive_speed is tuned by
    what comes out. Measure clock, encoder and steering first.
    """,
    plan=plan, measure=measure,
    keys=("latency.pulse_to_wheel", "latency.pulse_to_yaw", "latency.sensor_to_host"),
    after=("clock", "esc", "encoder", "imu", "steering"))
