"""``calibrate esc``: response of the speed controller to pulses, with the wheels off the ground.

Forward, brake, reverse, full throttle, and no pulses at all. The wheels are light and respond at
once, so no floor is needed. ``esc_fit`` fits their acceleration and coasting. The operator states
the direction in which they turn, because one ring of marks has no direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from msgspec import structs

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop
from dart_hal.core.timing import PWM_FRAME, PWM_WAIT_STD
from dart_hal.core.types import Estimate
from dart_hal.devices.actuation.limits import RAW_HIGH_US

from .by_hand import check_wheels_by_hand
from .clock import UNMEASURED_CLOCK_STD
from .esc_fit import DriveForce, find_knee, fit_force, graph_forces
from .measured import Measured
from .procedure import Bench, Condition, Procedure, ProcedurePlan, Progress
from .sensor_log import SensorLog
from .spin import PulseSpan, Spinner, spinning

# us beyond the first motion: 1 to 3 m/s at the tread.
PULSE_LEVELS = (12.0, 25.0, 40.0, 60.0)
# Indices of the levels in order, each reached from above and from below; None: neutral.
# Neutral follows the highest level: only wheels that coast from there coast long enough to show the
# friction, and without the friction the begin of the drive is not known. After a low level they
# stop within the time that PULSE_SETTLING omits.
LEVEL_ORDER = (3, 2, 0, 3, None, 1, 2, 3, None, 2, 1, 3, None, 0, 3, None)
# s of each level; the wheels reach half of the speed in 0.15 s.
LEVEL_DURATION = 0.6
# Index of the level from which the car brakes.
BRAKE_LEVEL = 1
# s below neutral for a brake; s of neutral after which every ESC reverses that can.
BRAKE_DURATION = 0.6
NEUTRAL_DURATION = 1.0
# m/s above which the wheels turn at the end of a span.
MIN_TURNING_SPEED = 0.15
# us from neutral between which the end of the throttle is searched, up and down again, so that a
# lag of the wheels cancels; step [us] and s of each pulse.
FULL_RANGE = (300.0, 500.0)
FULL_STEP = 10.0
FULL_DURATION = 0.3
# Times without pulses, and s after which the ESC counts as one that never stops.
LOSS_REPEATS = 3
MAX_LOSS_DURATION = 3.0
# Share of the motor's lag, one sigma, by which the time of its drive without pulses depends on the
# drive before: 1 - ln(1 + b) / b of the lag, 0.16 after b = 0.4 dead bands, 0.36 after 1.3.
LOSS_LAG_STD = 0.1
# s: end of the last pulse before the write. Half a frame on average, minus the pulse itself,
# because the write lets a started pulse end (cut short it would be the same to 0.1 ms).
LOSS_START_STD = PWM_WAIT_STD
# s from the State to the write that answers it: 44 bytes on the line, and the bus.
WRITE_DELAY = 0.002
# Frames between the two edges of a speed: over 40 ms the places of the marks matter little.
SPEED_EDGES = 4
# Share of the friction that the timing of one coasting leaves: 2 ms of 0.2 s.
COAST_TIMING_STD = 0.01
# Share of the friction from which a brake at neutral is significant.
MIN_NEUTRAL_BRAKE = 0.05
# Share of the coasting time within which braked wheels come to rest.
MAX_BRAKE_TIME = 0.6


@dataclass
class EscFindings:
    """Results so far.

    forward, backward: forces in both directions. end [us]: end of the throttle. drag [m/s2]: part
    of the friction that is a brake at neutral.
    """

    forward: DriveForce
    backward: DriveForce | None = None
    end: Estimate | None = None
    drag: Estimate | None = None
    reverse: str = "never"
    quantities: dict[str, Quantity] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def plan(files: CarFiles) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    return ProcedurePlan(
        "spins the wheels in the air, forward, at the brake, in reverse and for 13 s up to "
        "full throttle, then leaves the ESC without pulses, to measure neutral, dead band, end "
        "of the throttle, brake and signal loss: about 80 s, a bench; a stand under the "
        "chassis, all four wheels free, fingers and cables away", 80.0)


def measure(bench: Bench) -> Measured:
    """Measure the ESC; the operator lifts the car, turns a wheel and states directions.

    The car ends stopped and on the floor, also on Ctrl-C. Raises CalibrationFailed (with the
    likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    workshop = bench.workshop
    progress = bench.progress
    log = SensorLog(car)
    start = next(iter(car.states())).t
    workshop.lift()
    try:
        progress(0.0, "turning a wheel by hand")
        check_wheels_by_hand(car, workshop)
        forward, first = _measure_forward(car, workshop, log, progress)
        found = EscFindings(forward)
        found.reverse = _measure_brake(car, workshop, log, progress, first, forward, found.notes)
        _measure_backward(car, workshop, log, progress, first, found)
        with spinning(car, workshop, log) as spin:
            progress(0.75, "up to full throttle")
            _measure_full(spin, first, found)
        with spinning(car, workshop, log) as spin:
            progress(0.92, "without pulses")
            _measure_loss(spin, first, found)
    finally:
        car.stop()
        workshop.set_down()
    _conclude(found, files)
    if forward.lag:
        found.notes.append(f"the motor follows its pulses with a lag of {forward.lag:.3f} s, "
                           "included in the fit")
    return Measured(
        files.config.name, bench.source, "esc",
        {f"throttle.{name}": q for name, q in found.quantities.items()},
        f"residual of the travel of the wheels: {1e3 * forward.rms:.2f} mm rms",
        next(iter(car.states())).t - start, tuple(found.notes),
        others={"throttle.reverse": found.reverse},
        graph=graph_forces([forward] if found.backward is None else [forward, found.backward]))


# -- forward ---------------------------------------------------------------------


def _measure_forward(car: Car, workshop: Workshop, log: SensorLog, progress: Progress
                     ) -> tuple[DriveForce, float]:
    """Return (forward force, pulse of the first motion [us])."""
    with spinning(car, workshop, log) as spin:
        progress(0.05, "looking for the first motion")
        first = spin.first_motion(1.0)
        spin.hold(LEVEL_DURATION, first + PULSE_LEVELS[BRAKE_LEVEL], turns=True)
    turned = workshop.wheels_turned()
    if turned == 0:
        raise CalibrationFailed(
            "the encoder counts although the wheels are at rest", found=f"edges at {first:.0f} us",
            expected="no edges", likely="a loose cable, light or a magnet at the sensor",
            remedy="shade the sensor, shorten its wires; dart-hal doctor")
    if turned < 0:
        raise CalibrationFailed(
            "a pulse above neutral turns the wheels backward",
            found=f"backward at {first:.0f} us", expected="forward",
            likely="the motor's leads are swapped, or the ESC is set to the other direction",
            remedy="swap the two leads of the motor; run it again")
    with spinning(car, workshop, log) as spin:
        progress(0.15, "forward")
        return fit_force(_drive_levels(spin, first, 1.0), spin.neutral), first


def _drive_levels(spin: Spinner, first: float, sign: float) -> list[PulseSpan]:
    pulses = [spin.round_to_count(first + sign * level) for level in PULSE_LEVELS]
    return [spin.hold(LEVEL_DURATION, spin.neutral if k is None else pulses[k],
                      turns=k is not None) for k in LEVEL_ORDER]


# -- brake and reverse -------------------------------------------------------------


def _measure_brake(car: Car, workshop: Workshop, log: SensorLog, progress: Progress, first: float,
                   forward: DriveForce, notes: list[str]) -> str:
    """Measure what pulses below neutral do after a drive forward; return the kind of reverse."""
    with spinning(car, workshop, log) as spin:
        progress(0.35, "brake and reverse")
        fast = spin.round_to_count(first + PULSE_LEVELS[BRAKE_LEVEL])
        back = _mirror_pulse(spin, first)
        before = spin.hold(LEVEL_DURATION, fast, turns=True).speed(0.1)
        braked = spin.hold(2.0 * BRAKE_DURATION, back)
        took = float(braked.t[-1]) if len(braked.t) else 0.0
        if braked.speed(0.1) > MIN_TURNING_SPEED:
            reverse = "at_once"
        else:
            spin.hold(NEUTRAL_DURATION, spin.neutral)
            again = spin.hold(2.0 * BRAKE_DURATION, back).speed(0.1)
            reverse = "after_brake" if again > MIN_TURNING_SPEED else "never"
            brakes = took < MAX_BRAKE_TIME * forward.coasting_time(before, 0.05)
            notes.append(f"the first pulse below neutral {'brakes' if brakes else 'only coasts'}: "
                         f"from {before:.1f} m/s at the tread to rest in {took:.2f} s")
    if reverse != "never" and workshop.wheels_turned() > 0:
        raise CalibrationFailed("the wheels never turn backward",
                                found="forward, below neutral too",
                                expected="backward after the brake",
                                likely="pulses above and below neutral do the same: the ESC is set "
                                       "to one direction, or to the mode of a boat or a plane",
                                remedy="set the ESC to forward, brake, reverse")
    if reverse == "never":
        notes.append(f"caution: no reverse, even after {NEUTRAL_DURATION:.0f} s of neutral after "
                     "the brake; neutral, and what is measured from it, cannot be measured without "
                     "reverse")
    return reverse


def _mirror_pulse(spin: Spinner, first: float) -> float:
    """Return the pulse of the highest level, mirrored at neutral [us]."""
    return spin.round_to_count(2.0 * spin.neutral - first - PULSE_LEVELS[-1])


def _measure_backward(car: Car, workshop: Workshop, log: SensorLog, progress: Progress,
                      first: float, found: EscFindings) -> None:
    """Measure the neutral time before reverse, and the backward force."""
    if found.reverse == "never":
        return
    with spinning(car, workshop, log) as spin:
        if found.reverse == "after_brake":
            progress(0.42, "neutral time before reverse")
            found.quantities["reverse_rest"] = _measure_reverse_rest(spin, first)
        spin.hold(NEUTRAL_DURATION, spin.neutral)
        progress(0.58, "in reverse")
        first_back = spin.first_motion(-1.0)
        found.backward = fit_force(_drive_levels(spin, first_back, -1.0), spin.neutral)


def _measure_reverse_rest(spin: Spinner, first: float) -> Quantity:
    """Find by bisection how long the ESC needs neutral between brake and reverse [s].

    m frames of neutral have m - 1 periods between their first pulse and their last. The result lies
    anywhere between two counts of them: one sigma is a frame over the root of 12.
    """
    fast = spin.round_to_count(first + PULSE_LEVELS[BRAKE_LEVEL])
    back = _mirror_pulse(spin, first)
    short = 0
    long = round(NEUTRAL_DURATION / PWM_FRAME)
    while long - short > 1:
        frames = (short + long) // 2
        spin.hold(0.5 * LEVEL_DURATION, fast)
        spin.hold(BRAKE_DURATION, back)
        spin.hold((frames - 0.75) * PWM_FRAME, spin.neutral)
        if spin.hold(BRAKE_DURATION, back).speed(0.1) > MIN_TURNING_SPEED:
            long = frames
        else:
            short = frames
    seconds = max(long - 1.5, 0.5) * PWM_FRAME
    return Quantity(seconds, PWM_WAIT_STD, "reverse after the brake, by bisection")


# -- full throttle, no pulse -------------------------------------------------------


def _measure_full(spin: Spinner, first: float, found: EscFindings) -> None:
    """Find the pulse beyond which the speed no longer increases."""
    low = spin.neutral + FULL_RANGE[0]
    high = min(spin.neutral + FULL_RANGE[1], RAW_HIGH_US - spin.count)
    pulses = [spin.round_to_count(p) for p in np.arange(low, high, FULL_STEP)]
    spin.hold(LEVEL_DURATION, first + PULSE_LEVELS[-1], turns=True)
    spin.hold(LEVEL_DURATION, pulses[0], turns=True)
    up, down = ([spin.hold(FULL_DURATION, p, turns=True).speed(0.5 * FULL_DURATION)
                 for p in sweep] for sweep in (pulses, pulses[::-1]))
    found.end = find_knee(np.array(pulses), 0.5 * (np.array(up) + np.array(down[::-1])))
    if found.end is None:
        found.notes.append(f"caution: the wheels still accelerate at {pulses[-1]:.0f} us; the end "
                           "of the throttle is not measured")


def _measure_loss(spin: Spinner, first: float, found: EscFindings) -> None:
    """Measure how long the motor drives on without pulses, and how the wheels slow down then."""
    seconds = []
    drags = []
    pulse = first + PULSE_LEVELS[BRAKE_LEVEL]
    for _ in range(LOSS_REPEATS):
        before = spin.hold(2.0 * LEVEL_DURATION, pulse, turns=True).speed(0.2)
        silent = spin.hold(0.5 * MAX_LOSS_DURATION, None)
        if silent.speed(0.1) > 0.9 * before:
            silent = spin.hold(0.5 * MAX_LOSS_DURATION, None)
            if silent.speed(0.1) > 0.9 * before:
                found.notes.append(f"caution: the ESC still drives {MAX_LOSS_DURATION:.0f} s after "
                                   "the last pulse: a broken wire does not stop this car")
                return
            seconds.append(0.5 * MAX_LOSS_DURATION)
        else:
            seconds.append(0.0)
        after, drag = _find_slowdown(silent, found.forward)
        seconds[-1] += after - WRITE_DELAY + 0.5 * PWM_FRAME - 1e-6 * pulse
        drags.append(drag)
        spin.hold(NEUTRAL_DURATION, spin.neutral)
    found.quantities["signal_loss"] = Quantity(
        float(np.mean(seconds)),
        math.hypot(max(LOSS_START_STD, float(np.ptp(seconds)) / 2.0) / math.sqrt(LOSS_REPEATS),
                   LOSS_LAG_STD * found.forward.lag),
        f"{LOSS_REPEATS} times without pulses, wheels lifted")
    coasts = [drag for drag in drags if drag is not None]
    found.notes.append(f"without pulses the ESC {'lets the car coast' if coasts else 'brakes'}")
    if len(coasts) == LOSS_REPEATS:
        found.drag = Estimate(float(np.mean(coasts)), max(
            float(np.std(coasts, ddof=1)),
            COAST_TIMING_STD * found.forward.a) / math.sqrt(LOSS_REPEATS), "m/s2")


def _find_slowdown(silent: PulseSpan, forward: DriveForce) -> tuple[float, float | None]:
    """Find when the wheels begin to slow down without pulses.

    Returns (s since the order, friction [m/s2] that neutral has in addition; None: they brake).
    The time between two speeds shows whether the wheels brake or coast. The curve is then continued
    back to the speed before.
    """
    x = silent.x
    t = silent.t
    speeds = (x[SPEED_EDGES:] - x[:-SPEED_EDGES]) / (t[SPEED_EDGES:] - t[:-SPEED_EDGES])
    middles = 0.5 * (t[SPEED_EDGES:] + t[:-SPEED_EDGES])
    before = float(np.max(speeds))
    fast = 0.75 * before
    slow = 0.35 * before
    begin, end = (_crossing_time(middles, speeds, level) for level in (fast, slow))
    if end - begin < MAX_BRAKE_TIME * forward.coasting_time(fast, slow):
        return begin - (end - begin) * (before - fast) / (fast - slow), None
    drag = forward.missing_friction(fast, slow, end - begin)
    return begin - forward.coasting_time(before, fast, drag), drag


def _crossing_time(t: np.ndarray, speeds: np.ndarray, level: float) -> float:
    """Time [s] at which the speed falls below a level for the last time."""
    last = int(np.flatnonzero(speeds > level)[-1])
    if last + 1 == len(t):
        return float(t[-1])
    share = (speeds[last] - level) / (speeds[last] - speeds[last + 1])
    return float(t[last] + share * (t[last + 1] - t[last]))


def _conclude(found: EscFindings, files: CarFiles) -> None:
    """Compute neutral, dead band and end of the throttle; subtract a brake at neutral."""
    forward = found.forward
    backward = found.backward
    drag = found.drag
    if backward is None:
        return
    ahead = forward.begin
    back = backward.begin
    if drag and drag.value > max(3.0 * drag.std, MIN_NEUTRAL_BRAKE * forward.a):
        ahead = forward.begin_without_brake(drag)
        back = backward.begin_without_brake(drag)
        found.notes.append(f"the ESC brakes at neutral, {drag.value:.1f} of {forward.a:.1f} m/s2: "
                           "subtracted, as measured by coasting without pulses")
    middle = 0.5 * (ahead.value + back.value)
    half = 0.5 * (ahead.value - back.value)
    spread = 0.5 * math.hypot(ahead.std, back.std)
    clock = _clock_std(files)
    neutral = Quantity(middle, math.hypot(spread, middle * clock),
                       f"{len(LEVEL_ORDER)} segments in each direction, wheels lifted")
    band = structs.replace(neutral, value=half, std=math.hypot(spread, half * clock))
    found.quantities |= {"neutral_us": neutral, "deadband_forward_us": band,
                         "deadband_reverse_us": band}
    found.notes.append("neutral is the middle of the pulses at which the motor begins to drive "
                       "forward and backward")
    if found.end is not None:
        found.quantities["saturation_us"] = Quantity(
            found.end.value - middle, math.hypot(found.end.std, spread),
            "pulses up to 500 us from neutral, wheels lifted")


def _clock_std(files: CarFiles) -> float:
    """Relative standard error of every pulse."""
    known = files.oscillator_hz
    return known.std / known.value if known else UNMEASURED_CLOCK_STD


calibrate_esc = Procedure(
    name="esc",
    help="""Neutral, dead band, brake, reverse and end of the throttle; wheels lifted.

    The car is on a stand and spins its wheels, up to full throttle; you turn a wheel by hand and
    state the direction. Measure the clock first.
    """,
    plan=plan, measure=measure, condition=Condition.LIFTED,
    keys=("throttle.neutral_us", "throttle.deadband_forward_us"), after=("clock",))
