"""Rows of IMU and encoder as the user sees them: no wrong number is called good."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import State
from dart_hal.estimation.frames import Sample
from fault_table.bench import Bench
from fault_table.drive import Drive, forward
from fault_table.row import NEVER, Case, Measured, Row, case
from fault_table.rows_pins import MS, PULSE, alone

FAR_OFF = 1.0
"""rad/s by which no yaw rate that is called valid may be wrong."""
GYRO_Z = 11
"""Place of the yaw rate in a STATE frame."""


def circle(throttle: float = 0.3) -> Callable[[Car, State], object]:
    return lambda car, state: car.drive(steering=0.15, throttle=throttle, valid_for=0.5)


def turning(bench: Bench, nano: str) -> Drive:
    """On a circle, long enough that nothing settles any more."""
    drive = bench.drive(nano=nano).arm()
    drive.run(1.5, circle())
    return drive


def count_wrong_samples(nano: str, text: str) -> Callable[[Bench], Measured]:
    """States marked valid whose yaw rate is far off, or whose yaw is off by > 3 stated sigma."""
    def measure(bench: Bench) -> Measured:
        drive = turning(bench, nano)
        before = drive.states[-1]
        start = drive.world.truth(before.t).yaw
        drive.fail(text)
        states = drive.run(2.0, circle())
        wrong = 0
        worst = 0.0
        valid = 0
        for state in states:
            if state.yaw_rate is None:
                continue
            valid += 1
            truth = drive.world.truth(state.t)
            error = abs(state.pose.yaw - before.pose.yaw - (truth.yaw - start))
            sigma = math.sqrt(state.pose.cov[2, 2]) + 1e-3
            off = abs(state.yaw_rate - truth.yaw_rate)
            worst = max(worst, off)
            wrong += off > FAR_OFF or error > 3 * sigma
        return Measured(wrong, f"{valid} of {len(states)} valid, worst {worst:.2f} rad/s")
    return measure


def wrong_bit(every: int, run: int) -> Callable[[Bench], Measured]:
    """Error of the yaw in stated deviations: one bit is wrong in ``run`` of ``every`` samples."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(brief=False).arm()  # the stated deviation shrinks while it is at rest
        frames = drive.car._engine.telemetry._frames
        read = frames.read
        count = 0

        def flip_sample(values: Sequence[int], t_arrival: float) -> Sample:
            nonlocal count
            count += 1
            words = list(values)
            words[GYRO_Z] ^= (count % every < run) << 10
            return read(words, t_arrival)

        drive.run(0.5, cruise)
        before = drive.states[-1]
        start = drive.world.truth(before.t).yaw
        frames.read = flip_sample  # type: ignore[method-assign]
        last = drive.run(6.0, cruise)[-1]
        error = last.pose.yaw - before.pose.yaw - (drive.world.truth(last.t).yaw - start)
        sigma = math.sqrt(last.pose.cov[2, 2])
        return Measured(abs(error) / sigma, f"{math.degrees(error):.2f} deg, stated "
                        f"{math.degrees(sigma):.2f}, {last.health.jumped} jumps")
    return measure


def zeros(nano: str, moving: bool) -> Callable[[Bench], Measured]:
    """States marked valid whose sample is all zeros, after a silent fall to CONFIG."""
    def measure(bench: Bench) -> Measured:
        drive = turning(bench, nano) if moving else bench.drive(nano=nano)
        if not moving:
            drive.run(2.0)
        wrong = lost = 0

        def look(car: Car, state: State) -> None:
            nonlocal wrong, lost
            wrong += state.yaw_rate is not None and not any(drive.sample)
            lost += state.yaw_rate is None
            if moving:
                circle()(car, state)

        drive.fail("imu:config")
        drive.run(2.0, look)
        return Measured(wrong, f"{lost} not valid")
    return measure


def time_to_recover(text: str) -> Callable[[Bench], Measured]:
    """s until samples are valid again, and stay so."""
    def measure(bench: Bench) -> Measured:
        drive = turning(bench, "avr")
        at = drive.fail(text)
        states = drive.run(3.5, circle())
        bad = [state.t for state in states if state.yaw_rate is None]
        still = states[-1].yaw_rate is None
        return Measured(NEVER if still else max(bad, default=at) - at, f"{len(bad)} not valid")
    return measure


def time_to_withhold(text: str) -> Callable[[Bench], Measured]:
    """ms until the yaw rate is no longer given out, on a circle at 0.6 m/s."""
    def measure(bench: Bench) -> Measured:
        def slowly(car: Car, state: State) -> None:
            car.drive_speed(steering=0.15, speed=0.6)

        drive = bench.drive().arm()
        drive.run(3.0, slowly)
        at = drive.fail(text)
        gone = [state.t for state in drive.run(3.0, slowly) if state.yaw_rate is None]
        return Measured(1e3 * (gone[0] - at) if gone else NEVER, _doubts(drive.states))
    return measure


def time_to_doubt(text: str, doubt: str, seconds: float = 3.0) -> Callable[[Bench], Measured]:
    """ms until the State reports the doubt, at 1 m/s held by the built-in loop."""
    def measure(bench: Bench) -> Measured:
        drive = cruising(bench)
        at = drive.fail(text)
        states = drive.run(seconds, cruise)
        times = [state.t for state in states
                if any(name.startswith(doubt) for name in state.health.doubts)]
        return Measured(1e3 * (times[0] - at) if times else NEVER, _doubts(states))
    return measure


def fastest(text: str, bench: Bench) -> Measured:
    """Highest true speed [m/s] after the fault with ``drive_speed(1.0)``."""
    drive = cruising(bench)
    top = 0.0

    def go(car: Car, state: State) -> None:
        nonlocal top
        cruise(car, state)
        top = max(top, drive.world.truth().v_x)

    drive.fail(text)
    states = drive.run(4.0, go)
    return Measured(top, _doubts(states))


def reverse(bench: Bench) -> Measured:
    """Fastest backwards [m/s] when the encoder dies and the target is -0.5 m/s."""
    drive = bench.drive().arm()
    top = 0.0

    def back(car: Car, state: State) -> None:
        nonlocal top
        car.drive_speed(steering=0.0, speed=-0.5, valid_for=0.5)
        top = max(top, -drive.world.truth().v_x)

    drive.run(2.0, back)
    drive.fail("enc:off")
    states = drive.run(3.0, back)
    return Measured(top, _doubts(states))


def cruise(car: Car, state: State) -> None:
    car.drive_speed(steering=0.0, speed=1.0, valid_for=0.5)


def cruising(bench: Bench) -> Drive:
    drive = bench.drive().arm()
    drive.run(3.0, cruise)
    return drive


def _doubts(states: list[State]) -> str:
    return ", ".join(sorted(set().union(*(s.health.doubts for s in states)))) or "no doubt"


def dead_encoder(bench: Bench) -> Measured:
    """ms until the throttle is capped when no edge comes any more."""
    drive = bench.drive().driving()
    at = drive.fail("enc:off")
    drive.run(2.0, forward(0.4, 0.5))
    return Measured(drive.last_wrong(at), _doubts(drive.states))


def dead_backward(bench: Bench) -> Measured:
    """ms until the throttle is capped when the encoder dies while the car is driven backward."""
    drive = bench.drive().arm()
    drive.run(1.0, forward(-0.3, 0.5))
    assert drive.off(drive.pulses[-1]), "it does not drive"
    start = drive.fail("enc:off")
    drive.run(2.0, forward(-0.3, 0.5))
    return Measured(drive.last_off(start), _doubts(drive.states))


def false_alarm(bench: Bench) -> Measured:
    """Doubts of a car at rest in its dead band, and of one that drives well."""
    drive = bench.drive().arm()
    states = drive.run(2.0, forward(0.05)) + drive.run(2.0, cruise)
    alarms = [name for s in states for name in s.health.doubts if name.startswith("ENCODER")]
    return Measured(len(alarms), _doubts(states))


def noise(bench: Bench) -> Measured:
    """States whose speed is off by > 5 % and by > 3 stated sigma; 50 ms of 10 k edges/s."""
    drive = cruising(bench)
    drive.fail("enc:garbage=10000", 0.05)
    states = drive.run(1.0, cruise)
    wrong = 0
    for state in states:
        true = drive.world.truth(state.t).v_x
        wrong += abs(state.speed - true) > max(0.05 * true, 3 * state.speed_std)
    return Measured(wrong, _doubts(states))


def calibrating(bench: Bench) -> Measured:
    """ms from the death of the encoder in a steering calibration to the last driving pulse."""
    from dart_hal.calibration.runner import CalibrationRunner

    drive = bench.drive()
    drive.run(1.0)
    with drive.car.raw():
        runner = CalibrationRunner(drive.car)
        runner.hold(3.0, 1700.0, 0.5)
        assert drive.wrong(drive.pulses[-1]), "it does not drive"
        at = drive.fail("enc:off")
        times = "no error"
        try:
            runner.hold(4.0, 1700.0, 0.5)
        except CalibrationFailed as error:
            times = error.found
    drive.run(0.5)
    return Measured(drive.last_wrong(at), times)


def missing_mark(bench: Bench) -> Measured:
    """rms error [m/s] at a constant 1 m/s on a ring of marks 12 % wide, its table known."""
    from dart_hal.estimation import WheelSpeed

    fractions = [1.12 if n % 2 else 0.88 for n in range(10)]
    metres = 0.00412918
    edges = []
    position = 0.0
    for n in range(6000):
        position += metres * fractions[n % 10]
        edges.append(position)
    estimator = WheelSpeed(metres, 10, learnt(fractions))
    errors = []
    k = 0
    for frame in range(1, 1000):
        now = frame * 0.01
        while edges[k] < now:
            k += 1
        gap = edges[k - 1] - edges[k - 2] if k > 1 else 0.0
        speed, _ = estimator.update(k, edges[k - 1], gap, now, 1.0, 1)
        errors.append(speed - 1.0)
    late = errors[500:]
    return Measured(math.sqrt(sum(e * e for e in late) / len(late)))


def learnt(fractions: list[float]) -> list[float] | None:
    """What a calibration leaves of a ring."""
    return fractions


def _same(name: str, measure: Callable[[str], Callable[[Bench], Measured]], limit: float,
          unit: str, *control: str) -> tuple[Case, ...]:
    return tuple(case(world, name, measure(nano), limit, unit, *control, fast=world == "mock")
                 for world, nano in (("mock", "mock"), ("elf", "avr")))


ROWS = (
    Row(14, "BNO055 silently back in CONFIG", "no sample of zeros, offsets restored", (
        case("elf", "standing, host alone", alone("imu_zeros", zeros("avr", False)), 0, "States",
             "imu_check"),
        case("elf", "moving, firmware alone", alone("imu_check", zeros("avr", True)), 0, "States",
             "imu_zeros"),
        case("elf", "standing", zeros("avr", False), 0, "States", "imu_zeros", "imu_check"),
        case("elf", "recovery", time_to_recover("imu:config"), 1.2, "s", "imu_mode", fast=True),
    )),
    Row(15, "IMU stuck, garbage, wrong, absent", "not valid, encoder only", (
        *_same("garbage", lambda nano: count_wrong_samples(nano, "imu:garbage"), 0, "States",
               "imu_check"),
        case("mock", "gain 3 on a slow circle", time_to_withhold("imu:wrong=3"), 600, MS,
             "imu_check"),
    )),
    Row(17, "encoder noise, phantom edges", "slots refused, speed held, its std covers it", (
        case("mock", "10 k edges/s for 50 ms", alone("encoder_check", noise), 0, "States",
             "edge_gate"),
        case("mock", "2600 phantom edges/s told", time_to_doubt("enc:garbage=2600", "ENCODER_"),
             500, MS,
             "encoder_check"),
    )),
    Row(18, "encoder dead while throttle is on", "throttle capped, no false alarm", (
        case("mock", "dead", dead_encoder, 300 + PULSE, MS, "encoder_check", fast=True),
        case("mock", "dead in reverse", reverse, 1.0, "m/s", "encoder_check"),
        case("mock", "dead, throttle -0.3", dead_backward, 300 + PULSE, MS, "encoder_check",
             fast=True),
        case("mock", "false alarms", false_alarm, 0, "States", "margins"),
    )),
    Row(19, "ring with uneven marks", "learnt, taken out", (
        case("wire", "rms at 1 m/s", missing_mark, 0.02, "m/s", "ring_table", fast=True),
    )),
    Row(38, "half of the encoder's edges at 1 m/s", "told, the speed loop lets go", (
        case("mock", "true speed", lambda b: fastest("enc:wrong=0.5", b), 1.3, "m/s",
             "encoder_check", fast=True),
        case("mock", "told", time_to_doubt("enc:wrong=0.5", "ENCODER_LOW"), 500, MS,
             "encoder_check"),
    )),
    Row(57, "one bit of the yaw rate wrong in single samples", "left out or covered, counted", (
        case("mock", "1 of 100", wrong_bit(100, 1), 3.0, "sigma", "single_samples", fast=True),
        case("mock", "2 in a row of 100", wrong_bit(100, 2), 3.0, "sigma", "single_samples"),
    )),
    Row(39, "encoder dies in a calibration", "stopped", (
        case("mock", "calibrate steering", calibrating, 300, MS, "encoder_check",
             fast=True),
    )),
)
