"""``calibrate esc``: what the speed controller makes of pulses, with the wheels off the ground.

Forward, at the brake, in reverse, at full throttle and without any pulse. The wheels are light
and answer at once, so nothing needs room; ``esc_fit`` makes numbers of how they speed up and
slow down. Which way they turn is asked: one ring of marks has no direction.
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

from .by_hand import turn_by_hand
from .clock import UNKNOWN
from .esc_fit import Force, knee, pull_begins
from .measured import Measured
from .procedure import Bench, Condition, Procedure, ProcedurePlan, Progress
from .sensor_log import SensorLog
from .spin import Spin, Spinner, spinning

LEVELS = (12.0, 25.0, 40.0, 60.0)
"""us beyond the first motion: 1 to 3 m/s of the tread."""
ORDER = (3, 2, 0, 3, None, 1, 2, 3, None, 2, 1, 3, None, 0, 3, None)
"""Levels one after the other, from above and from below; None: neutral.

Neutral follows the highest level: only wheels that roll out from there roll long enough to tell the
friction, without which the begin of the pull is not known. After a low level they stop within the
time that SETTLE leaves out."""
HELD = 0.6
"""s of each; the wheels go half of the way in 0.15 s."""
QUICK = 1
"""Index of the level from which is braked."""
BRAKES, RESTED = 0.6, 1.0
"""s of a pull below neutral; s of neutral after which every ESC reverses that does so at all."""
TURNING = 0.15
"""m/s of wheels that turn at the end of a stretch."""
FULL, STEP, FULL_HELD = (300.0, 500.0), 10.0, 0.3
"""us from neutral through which the end of the throttle is looked for, up and down again, so that
wheels which follow late do so both ways; and s of each."""
LOSSES, LONGEST_LOSS = 3, 3.0
"""Times without pulses, and s after which it is said that the ESC goes on pulling."""
FADES = 0.1
"""Share of the motor's lag, one sigma, by which its pull without pulses depends on the pull before:
1 - ln(1 + b) / b of the lag, 0.16 after b = 0.4 dead bands, 0.36 after 1.3."""
LOST_STD = PWM_WAIT_STD
"""s: when before the write the last pulse ended; half a frame in the mean less the pulse itself, as
the write lets one that is under way end (cut short it would be the same to 0.1 ms)."""
WRITTEN = 0.002
"""s from the State to the write that answers it: 44 bytes on the line, and the bus."""
APART = 4
"""Frames between the two edges of a speed: over 40 ms the places of the marks count little."""
TIMED = 0.01
"""Share of the friction that the timing of one roll leaves: 2 ms of 0.2 s."""
DRAG = 0.05
"""Share of the friction from which a brake at neutral is believed."""
HARD = 0.6
"""Share of the time of coasting in which wheels that are braked are at rest."""


@dataclass
class Found:
    """What came out so far: the forces either way, the end of the throttle [us], what of the
    friction is a brake at neutral [m/s2]."""

    forward: Force
    backward: Force | None = None
    end: Estimate | None = None
    drag: Estimate | None = None
    reverse: str = "never"
    quantities: dict[str, Quantity] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def plan(files: CarFiles) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    return ProcedurePlan(
        "spins the wheels in the air, forward, at the brake, in reverse and for 13 s up to "
        "full throttle, then leaves the ESC without pulses, to measure neutral, dead band, end "
        "of the throttle, brake and signal loss: about 80 s, a bench; a stand under the "
        "chassis, all four wheels free, fingers and cables away", 80.0)


def measure(bench: Bench) -> Measured:
    """Measure the ESC; the workshop lifts the car, turns a wheel and says which way they turned.

    The car is left stopped and on the floor, also on Ctrl-C. Errors: CalibrationFailed (with the
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
        turn_by_hand(car, workshop)
        forward, first = _forward(car, workshop, log, progress)
        found = Found(forward)
        found.reverse = _brake(car, workshop, log, progress, first, forward, found.notes)
        _backward(car, workshop, log, progress, first, found)
        with spinning(car, workshop, log) as spin:
            progress(0.75, "up to full throttle")
            _full(spin, first, found)
        with spinning(car, workshop, log) as spin:
            progress(0.92, "without pulses")
            _lost(spin, first, found)
    finally:
        car.stop()
        workshop.set_down()
    _conclude(found, files)
    if forward.lag:
        found.notes.append(f"the motor follows its pulses by a lag of {forward.lag:.3f} s, "
                           "fitted with the rest")
    return Measured(
        files.config.name, bench.source, "esc",
        {f"throttle.{name}": q for name, q in found.quantities.items()},
        f"the wheels keep to their law within {1e3 * forward.rms:.2f} mm rms",
        next(iter(car.states())).t - start, tuple(found.notes),
        others={"throttle.reverse": found.reverse})


# -- forward ---------------------------------------------------------------------


def _forward(car: Car, workshop: Workshop, log: SensorLog, progress: Progress
             ) -> tuple[Force, float]:
    """(force ahead, pulse of the first motion [us])."""
    with spinning(car, workshop, log) as spin:
        progress(0.05, "looking for the first motion")
        first = spin.first_motion(1.0)
        spin.hold(HELD, first + LEVELS[QUICK], turns=True)
    turned = workshop.wheels_turned()
    if turned == 0:
        raise CalibrationFailed(
            "the encoder counts wheels that stand", found=f"edges at {first:.0f} us",
            expected="none", likely="a loose cable, light or a magnet at the sensor",
            remedy="shade the sensor, shorten its wires; dart-hal doctor")
    if turned < 0:
        raise CalibrationFailed(
            "a pulse above neutral turns the wheels backward",
            found=f"backward at {first:.0f} us", expected="forward",
            likely="the motor's leads are swapped, or the ESC is set to the other direction",
            remedy="swap the two leads of the motor; run it again")
    with spinning(car, workshop, log) as spin:
        progress(0.15, "forward")
        return pull_begins(_levels(spin, first, 1.0), spin.neutral), first


def _levels(spin: Spinner, first: float, sign: float) -> list[Spin]:
    pulses = [spin.whole(first + sign * level) for level in LEVELS]
    return [spin.hold(HELD, spin.neutral if k is None else pulses[k], turns=k is not None)
            for k in ORDER]


# -- brake and reverse -------------------------------------------------------------


def _brake(car: Car, workshop: Workshop, log: SensorLog, progress: Progress, first: float,
           forward: Force, notes: list[str]) -> str:
    """What pulls below neutral do after a drive forward."""
    with spinning(car, workshop, log) as spin:
        progress(0.35, "brake and reverse")
        fast, back = spin.whole(first + LEVELS[QUICK]), _mirrored(spin, first)
        before = spin.hold(HELD, fast, turns=True).speed(0.1)
        braked = spin.hold(2.0 * BRAKES, back)
        took = float(braked.t[-1]) if len(braked.t) else 0.0
        if braked.speed(0.1) > TURNING:
            reverse = "at_once"
        else:
            spin.hold(RESTED, spin.neutral)
            again = spin.hold(2.0 * BRAKES, back).speed(0.1)
            reverse = "after_brake" if again > TURNING else "never"
            hard = took < HARD * forward.coasting(before, 0.05)
            notes.append(f"the first pull below neutral {'brakes' if hard else 'only coasts'}: "
                         f"from {before:.1f} m/s of the tread to rest in {took:.2f} s")
    if reverse != "never" and workshop.wheels_turned() > 0:
        raise CalibrationFailed("the wheels never turn backward",
                                found="forward, below neutral too",
                                expected="backward after the brake",
                                likely="pulses above and below neutral act alike: the ESC is set "
                                       "to one direction, or to a boat's or a plane's mode",
                                remedy="set the ESC to forward, brake, reverse")
    if reverse == "never":
        notes.append(f"caution: no reverse, even {RESTED:.0f} s after the brake; neutral and what "
                     "is measured from it are not known without it")
    return reverse


def _mirrored(spin: Spinner, first: float) -> float:
    return spin.whole(2.0 * spin.neutral - first - LEVELS[-1])


def _backward(car: Car, workshop: Workshop, log: SensorLog, progress: Progress,
              first: float, found: Found) -> None:
    """The rest before reverse, and the force behind."""
    if found.reverse == "never":
        return
    with spinning(car, workshop, log) as spin:
        if found.reverse == "after_brake":
            progress(0.42, "how long a rest before reverse")
            found.quantities["reverse_rest"] = _rest(spin, first)
        spin.hold(RESTED, spin.neutral)
        progress(0.58, "in reverse")
        behind = spin.first_motion(-1.0)
        found.backward = pull_begins(_levels(spin, behind, -1.0), spin.neutral)


def _rest(spin: Spinner, first: float) -> Quantity:
    """How long the ESC needs neutral between brake and reverse, by halving [s].

    m frames of neutral hold m - 1 periods between their first pulse and their last. What is found
    lies between two counts of them, anywhere: one sigma is a frame over the root of 12.
    """
    fast, back = spin.whole(first + LEVELS[QUICK]), _mirrored(spin, first)
    short, long = 0, round(RESTED / PWM_FRAME)
    while long - short > 1:
        frames = (short + long) // 2
        spin.hold(0.5 * HELD, fast)
        spin.hold(BRAKES, back)
        spin.hold((frames - 0.75) * PWM_FRAME, spin.neutral)
        if spin.hold(BRAKES, back).speed(0.1) > TURNING:
            long = frames
        else:
            short = frames
    seconds = max(long - 1.5, 0.5) * PWM_FRAME
    return Quantity(seconds, PWM_WAIT_STD, "reverse after the brake, by halving")


# -- full throttle, no pulse -------------------------------------------------------


def _full(spin: Spinner, first: float, found: Found) -> None:
    """Where more pulse gives no more speed."""
    low = spin.neutral + FULL[0]
    high = min(spin.neutral + FULL[1], RAW_HIGH_US - spin.count)
    pulses = [spin.whole(p) for p in np.arange(low, high, STEP)]
    spin.hold(HELD, first + LEVELS[-1], turns=True)
    spin.hold(HELD, pulses[0], turns=True)
    up, down = ([spin.hold(FULL_HELD, p, turns=True).speed(0.5 * FULL_HELD) for p in way]
                for way in (pulses, pulses[::-1]))
    found.end = knee(np.array(pulses), 0.5 * (np.array(up) + np.array(down[::-1])))
    if found.end is None:
        found.notes.append(f"caution: the wheels still speed up at {pulses[-1]:.0f} us; the end of "
                           "the throttle is not measured")


def _lost(spin: Spinner, first: float, found: Found) -> None:
    """How long the motor pulls on when the pulses end, and how the wheels roll out then."""
    seconds, drags, pulse = [], [], first + LEVELS[QUICK]
    for _ in range(LOSSES):
        before = spin.hold(2.0 * HELD, pulse, turns=True).speed(0.2)
        gone = spin.hold(0.5 * LONGEST_LOSS, None)
        if gone.speed(0.1) > 0.9 * before:
            gone = spin.hold(0.5 * LONGEST_LOSS, None)
            if gone.speed(0.1) > 0.9 * before:
                found.notes.append(f"caution: {LONGEST_LOSS:.0f} s after the last pulse the ESC "
                                   "still pulls: a broken wire does not stop this car")
                return
            seconds.append(0.5 * LONGEST_LOSS)
        else:
            seconds.append(0.0)
        after, drag = _let_go(gone, found.forward)
        seconds[-1] += after - WRITTEN + 0.5 * PWM_FRAME - 1e-6 * pulse
        drags.append(drag)
        spin.hold(RESTED, spin.neutral)
    found.quantities["signal_loss"] = Quantity(
        float(np.mean(seconds)),
        math.hypot(max(LOST_STD, float(np.ptp(seconds)) / 2.0) / math.sqrt(LOSSES),
                   FADES * found.forward.lag),
        f"{LOSSES} times without pulses, wheels lifted")
    rolls = [drag for drag in drags if drag is not None]
    found.notes.append(f"without pulses the ESC {'lets the car roll' if rolls else 'brakes'}")
    if len(rolls) == LOSSES:
        found.drag = Estimate(float(np.mean(rolls)), max(
            float(np.std(rolls, ddof=1)), TIMED * found.forward.a) / math.sqrt(LOSSES), "m/s2")


def _let_go(gone: Spin, forward: Force) -> tuple[float, float | None]:
    """(s from the order to where the wheels begin to slow down, what of the friction at neutral
    is gone then [m/s2], None: they are braked)."""
    x, t = gone.x, gone.t
    speeds = (x[APART:] - x[:-APART]) / (t[APART:] - t[:-APART])
    middles, before = 0.5 * (t[APART:] + t[:-APART]), float(np.max(speeds))
    fast, slow = 0.75 * before, 0.35 * before
    begin, end = (_crossing(middles, speeds, level) for level in (fast, slow))
    if end - begin < HARD * forward.coasting(fast, slow):
        return begin - (end - begin) * (before - fast) / (fast - slow), None
    drag = forward.drag(fast, slow, end - begin)
    return begin - forward.coasting(before, fast, drag), drag


def _crossing(t: np.ndarray, speeds: np.ndarray, level: float) -> float:
    """When the speed falls through a level for good."""
    last = int(np.flatnonzero(speeds > level)[-1])
    if last + 1 == len(t):
        return float(t[-1])
    share = (speeds[last] - level) / (speeds[last] - speeds[last + 1])
    return float(t[last] + share * (t[last + 1] - t[last]))


def _conclude(found: Found, files: CarFiles) -> None:
    """Neutral and what is measured from it; a brake at neutral is taken off."""
    forward, backward, drag = found.forward, found.backward, found.drag
    if backward is None:
        return
    ahead, back = forward.begin, backward.begin
    if drag and drag.value > max(3.0 * drag.std, DRAG * forward.a):
        ahead, back = forward.without(drag), backward.without(drag)
        found.notes.append(f"the ESC brakes at neutral, {drag.value:.1f} of {forward.a:.1f} m/s2: "
                           "taken off by how the wheels roll without pulses")
    middle, half = 0.5 * (ahead.value + back.value), 0.5 * (ahead.value - back.value)
    spread = 0.5 * math.hypot(ahead.std, back.std)
    clock = _clock(files)
    neutral = Quantity(middle, math.hypot(spread, middle * clock),
                       f"{len(ORDER)} stretches each way, wheels lifted")
    band = structs.replace(neutral, value=half, std=math.hypot(spread, half * clock))
    found.quantities |= {"neutral_us": neutral, "deadband_forward_us": band,
                         "deadband_reverse_us": band}
    found.notes.append("neutral is the middle between where the motor begins to pull either way")
    if found.end is not None:
        found.quantities["saturation_us"] = Quantity(
            found.end.value - middle, math.hypot(found.end.std, spread),
            "pulses up to 500 us from neutral, wheels lifted")


def _clock(files: CarFiles) -> float:
    """Relative standard error of every pulse."""
    known = files.oscillator_hz
    return known.std / known.value if known else UNKNOWN



calibrate_esc = Procedure(
    name="esc",
    help="""Neutral, dead band, brake, reverse and end of the throttle; wheels lifted.

    The car stands on a stand and spins its wheels, up to full throttle; you turn
    a wheel by hand and say which way they turned. Measure the clock first.
    """,
    plan=plan, measure=measure, condition=Condition.LIFTED,
    keys=("throttle.neutral_us", "throttle.deadband_forward_us"), after=("clock",))
