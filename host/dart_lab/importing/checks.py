"""Compare the streams of a recording with each other: wrong signs, units, axes and clocks.

Every quantity is compared with another source of the same quantity. A contradiction that no car
can have is an error with the change of the map that removes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart.ranges import LIMITS, YAW_RATE_COLUMN
from dart_hal.recording.imported import ImportedData, Stream

# s: grid of the comparison, and width of the means that precede a derivative.
GRID_STEP = 0.02
SMOOTHING_TIME = 0.2
# s without a sample from which on a stream has a gap.
MAX_SAMPLE_GAP = 0.5
# Share of rows that repeat the value of the row before, from which on a noisy sensor is repeated.
MAX_REPEATED_SHARE = 0.5
# Samples of steady driving without which no scale of a commanded speed is stated: 1 s.
MIN_STEADY_SAMPLES = 50
# Shares of the 90 % quantile of a speed or yaw rate above which the car drives, or turns.
DRIVING_SHARE = 0.3
TURNING_SHARE = 0.3
# Samples of the grid without which nothing is compared: 2 s.
MIN_SAMPLES = 100
# Correlation above which two sources measure the same quantity.
MIN_CORRELATION = 0.6
# Ratios within which two sources agree; a scale outside is stated.
MAX_SCALE_ERROR = 1.25
# Ratio of speed and commanded speed above which the command is no speed in that unit.
MAX_COMMAND_RATIO = 3.0
# s between rows above which a fit sees little of delays and lags, which are 0.05 to 0.2 s. Rows of
# the F1TENTH logs have 0.042 to 0.054 s.
MAX_ROW_TIME = 0.06
MIN_ADVISED_RATE = 25.0
# Ratios by which a mistaken unit is recognised, by the compared column, with a tolerance of 20 %.
UNIT_RATIOS = {
    "yaw": {57.29578: "deg", 0.01745329: "rad"},
    "yaw_rate": {57.29578: "deg/s", 9.549297: "rpm"},
    "speed": {3.6: "km/h", 100.0: "cm/s", 1000.0: "mm/s"},
    "pose_speed": {100.0: "cm", 1000.0: "mm"},
    "accel_y": {0.1019716: "g", 101.9716: "mg"},
}
UNIT_TOLERANCE = 1.2
# m/s: 90 % quantile of a speed above which no car drives; a racing car of 1:1 reaches 80.
MAX_POSE_SPEED = 100.0
# Largest value of a sensor, and its unit.
SENSOR_LIMITS = {"encoder": (MAX_POSE_SPEED, "m/s")} | {
    name: (limit.most, limit.unit) for name, column in (
        ("gyro", YAW_RATE_COLUMN), ("accelerometer", "acc x (IMU)"))
    for limit in LIMITS if limit.column == column}
# Share of the values beyond which they are of another unit, and no single wrong ones.
MAX_OUTLIER_SHARE = 0.001
# s: offsets between two clocks that are tried, and from which on they are reported.
MAX_CLOCK_OFFSET = 2.0
MIN_CLOCK_OFFSET = 0.06
# s by which a car may follow its steering or throttle.
MAX_RESPONSE_TIME = 0.6
# Correlation of a horizontal axis of the accelerometer with the lateral acceleration from which on
# it is the lateral axis, if the other one is below MIN_CORRELATION.
MIN_TURNED_CORRELATION = 0.8
# s of steady driving with a speed loop, and relative changes of command and speed in that time.
STEADY_TIME = 0.3
MAX_COMMAND_CHANGE = 0.15
MAX_SPEED_CHANGE = 0.2
# Relative distance from the highest steady speed within which speeds are that one, and ratio of the
# 90 % and 10 % quantiles of its commands above which the controller limits the speed.
MAX_TOP_CHANGE = 0.03
MIN_COMMANDED_RATIO = 1.15
# Length of the mean direction of an angle (1: all equal), above which it is a constant.
MIN_CONCENTRATION = 0.8
# rad: a larger constant angle between yaw and direction of travel is a turned axis.
MAX_YAW_OFFSET = 0.6


Change = tuple[str, str, str, float | str]


@dataclass(frozen=True, slots=True)
class ImportFinding:
    """Result of one comparison.

    what: the compared stream. text: what was found. remedy: change of the map that removes a
    contradiction; empty if the sources agree. severe: no car can have it. change: the remedy as
    (stream, key, attribute, value); attribute "exchange" swaps two keys, "turn" as well and
    reverses ``key``.
    """

    what: str
    text: str
    remedy: str = ""
    severe: bool = False
    change: Change | None = None

    def __str__(self) -> str:
        return f"{self.what}: {self.text}" + (f"; {self.remedy}" if self.remedy else "")


@dataclass(frozen=True, slots=True)
class GridData:
    """Streams on a common grid of GRID_STEP, (n,) each; NaN where a stream is absent."""

    t: FloatArray
    values: Mapping[str, FloatArray]

    def __getitem__(self, name: str) -> FloatArray:
        return self.values.get(name, np.full(len(self.t), np.nan))

    def has(self, *names: str) -> bool:
        """Return whether all these columns were measured."""
        return all(name in self.values for name in names)


def check_data(data: ImportedData) -> list[ImportFinding]:
    """Compare the streams with each other; see ``ImportFinding``.

    1. The poses alone: a speed that no car has; the yaw angle with the direction of travel: axes,
       sign, unit, offset.
    2. The gyro with the yaw rate of the poses, the encoder with their speed, the accelerometer
       with yaw rate times speed: sign, unit, scale, clock.
    3. The steering with the curvature of the path, the throttle with the speed: sign; of a speed
       loop, scale and limit, too.

    Poses that contradict themselves are reported alone: nothing can be compared with them.
    """
    g = resample(data)
    ranges = _check_ranges(data)
    if len(g.t) < MIN_SAMPLES:
        return [*ranges, *_find_repeated_rows(data), *_find_slow_rows(data)]
    findings = _check_pose_speed(g) + _check_yaw(g)
    if any(f.severe for f in findings):
        return findings
    findings += _compare(g, "gyro", "yaw_rate", "pose_yaw_rate", "the yaw rate of the poses")
    findings += _compare(g, "encoder", "speed", "pose_speed", "the speed of the poses")
    if any(f.what == "poses" for f in findings):
        return findings
    rate = "pose_yaw_rate" if g.has("pose_yaw_rate") else "yaw_rate"
    speed = "pose_speed" if g.has("pose_speed") else "speed"
    if g.has(rate, speed, "accel_y"):
        lateral = GridData(g.t, {**g.values, "lateral": g[rate] * g[speed]})
        findings += _check_axes(lateral) or _compare(lateral, "accelerometer", "accel_y", "lateral",
                                                     "yaw rate times speed", key="y")
    findings += _check_commands(g, rate, speed)
    findings += _find_repeated_rows(data) + _find_slow_rows(data)
    if data.drive == "speed":
        findings += _check_speed_command(g)
    # A comparison names the unit.
    compared = {f.what for f in findings if f.severe}
    return findings + [f for f in ranges if f.what not in compared]


def resample(data: ImportedData) -> GridData:
    """Put all streams on one grid, and differentiate the poses.

    Columns: those of the streams, and pose_speed, pose_yaw_rate and course, the direction of
    travel [rad] of the poses.
    """
    # The battery may be read once a second, and no other stream is compared with it.
    streams = {name: s for name, s in data.streams.items() if name != "battery"}
    start = max(float(s.t[0]) for s in streams.values())
    end = min(float(s.t[-1]) for s in streams.values())
    t = np.arange(start, end, GRID_STEP)
    values: dict[str, FloatArray] = {}
    for name, columns in (("encoder", ("speed",)), ("gyro", ("yaw_rate",)),
                          ("accelerometer", ("accel_x", "accel_y"))):
        for k, column in enumerate(columns) if name in streams else ():
            values[column] = _smooth(np.interp(t, streams[name].t, streams[name].values[:, k]))
    commands = streams["commands"]
    row = np.maximum(np.searchsorted(commands.t, t, side="right") - 1, 0)
    values["steering"], values["throttle"] = commands.values[row].T
    if "poses" in streams:
        values |= _differentiate_poses(t, streams["poses"])
    # A derivative across a gap is none.
    measured = np.logical_and.reduce([_is_covered(t, s.t) for name, s in streams.items()
                                      if name != "commands"])
    return GridData(t[measured], {name: column[measured] for name, column in values.items()})


def _is_covered(t: FloatArray, stamps: FloatArray) -> BoolArray:
    """Return which times (n,) are further than SMOOTHING_TIME from a gap and end of a stream."""
    gaps = np.nonzero(np.diff(stamps) > MAX_SAMPLE_GAP)[0]
    # At the ends a mean is that of one side, so the derivative of a position ends too slow.
    covered: BoolArray = (t > stamps[0] + SMOOTHING_TIME) & (t < stamps[-1] - SMOOTHING_TIME)
    for k in gaps:
        covered &= (t < stamps[k] - SMOOTHING_TIME) | (t > stamps[k + 1] + SMOOTHING_TIME)
    return covered


def _differentiate_poses(t: FloatArray, poses: Stream) -> dict[str, FloatArray]:
    x, y, yaw = (np.interp(t, poses.t, column) for column in poses.values.T)
    u, v, rate = (np.gradient(_smooth(column), GRID_STEP) for column in (x, y, yaw))
    return {"yaw": yaw, "pose_speed": np.hypot(u, v), "pose_yaw_rate": rate,
            "course": np.unwrap(np.arctan2(v, u))}


def _smooth(values: FloatArray) -> FloatArray:
    """Return the mean (n,) over SMOOTHING_TIME around each sample."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(values, round(SMOOTHING_TIME / GRID_STEP)))


def _is_large(values: FloatArray, share: float) -> BoolArray:
    """Return which samples (n,) exceed a share of the 90 % quantile of the magnitude."""
    size = np.abs(np.nan_to_num(values))
    return np.asarray(size > max(share * float(np.quantile(size, 0.9)), 1e-9))


def _check_pose_speed(g: GridData) -> list[ImportFinding]:
    """Refuse positions by which a car would be faster than any, as millimetres taken for metres."""
    speed = float(np.quantile(g["pose_speed"], 0.9)) if g.has("pose_speed") else 0.0
    if speed <= MAX_POSE_SPEED:
        return []
    units = '"mm" or "cm"'
    if g.has("speed") and np.any(g["speed"]):
        ratio = abs(_slope(np.abs(g["speed"]), g["pose_speed"]))
        both = _find_units_of_both(ratio)
        units = f'"{both[0]}"' if both else units
    return [ImportFinding("poses", f"the car would drive at {speed:.0f} m/s",
                          f"x and y of [poses] need unit = {units}", severe=True)]


def _check_ranges(data: ImportedData) -> list[ImportFinding]:
    """Refuse sensors whose values no car can have, as degrees taken for radians."""
    findings = []
    for name, (limit, unit) in SENSOR_LIMITS.items():
        if name not in data.streams:
            continue
        size = np.abs(data.streams[name].values)
        beyond = size > limit
        if not beyond.any():
            continue
        is_unit = float(beyond.mean()) > MAX_OUTLIER_SHARE
        findings.append(ImportFinding(
            name, f"{int(beyond.sum())} of {beyond.size} values are beyond {limit:g} {unit}, up to "
                  f"{float(size.max()):.4g}",
            f"state the unit of the column in [{name}]" if is_unit else "remove these rows",
            severe=True))
    return findings


def _find_units_of_both(ratio: float) -> tuple[str, str] | None:
    """Return the units of positions and encoder that a ratio of their speeds shows; "" = as is.

    An encoder in the length of the positions, as mm/s with mm, agrees with them.
    """
    found = [(abs(np.log(ratio * length / speed)), (unit, other))
             for length, unit in UNIT_RATIOS["pose_speed"].items()
             for speed, other in ((1.0, ""), (3.6, "km/h"))]
    distance, units = min(found)
    return units if distance < np.log(UNIT_TOLERANCE) else None


def _check_yaw(g: GridData) -> list[ImportFinding]:
    """Compare yaw and direction of travel of the poses.

    The angle between them is about 0 forwards. A constant other angle is a turned axis. Where only
    their sum is constant, one of them turns the other way.
    """
    if not g.has("pose_speed"):
        return []
    use = _is_large(g["pose_speed"], DRIVING_SHARE)
    if use.sum() < MIN_SAMPLES:
        return []
    difference = np.exp(1j * (g["course"] - g["yaw"])[use]).mean()
    total = np.exp(1j * (g["course"] + g["yaw"])[use]).mean()
    if abs(difference) >= MIN_CONCENTRATION:
        angle = float(np.angle(difference))
        found = f"the car travels {np.rad2deg(angle):+.0f} deg from its yaw"
        if abs(angle) < MAX_YAW_OFFSET:
            return [ImportFinding("yaw", found + " on average")]
        backwards = abs(abs(angle) - np.pi) < MAX_YAW_OFFSET
        zero = f"yaw needs zero = {-angle:.3f} (in rad; {-np.rad2deg(angle):.1f} in deg)"
        remedy = ("the car drives backwards, or " if backwards else "") + zero
        return [ImportFinding("yaw", found, remedy, severe=True,
                              change=("poses", "yaw", "zero", -angle))]
    spread = float(np.ptp(np.unwrap(g["course"][use])))
    if abs(total) >= MIN_CONCENTRATION and abs(total) > abs(difference) and spread > 1.0:
        if abs(abs(float(np.angle(total))) - 0.5 * np.pi) < MAX_YAW_OFFSET:
            return [ImportFinding("yaw", "the path turns the other way than the yaw, mirrored at "
                            "the diagonal", "exchange the columns x and y of [poses]", severe=True,
                            change=("poses", "x", "exchange", "y"))]
        other = _vote(g)
        key = "y" if other > 0.0 else "yaw"
        basis = ("" if other == 0.0 else
                 ", because gyro and steering agree with the " + ("yaw" if other > 0.0 else "path"))
        return [ImportFinding("yaw", "the path turns the other way than the yaw",
                        f"{key} of [poses] needs sign = -1{basis}", severe=True,
                        change=("poses", key, "sign", -1))]
    rate = np.gradient(_smooth(g["course"]), GRID_STEP)
    turning = use & _is_large(rate, TURNING_SHARE)
    ratio = _slope(g["pose_yaw_rate"][turning], rate[turning])
    unit = _find_unit("yaw", ratio)
    if unit:
        return [ImportFinding("yaw", f"turns {ratio:.1f} times as fast as the path",
                        f'yaw of [poses] needs unit = "{unit}"', severe=True,
                        change=("poses", "yaw", "unit", unit))]
    return [ImportFinding("yaw", "the direction of travel does not follow the yaw",
                          "check x, y, yaw and their units in [poses]", severe=True)]


def _vote(g: GridData) -> float:
    """Return +1 where gyro or steering agree with the sign of the yaw rate, -1 where not, else 0.
    """
    for name in ("yaw_rate", "steering"):
        if g.has(name):
            found = _correlation(g[name], g["pose_yaw_rate"])
            if abs(found) >= MIN_CORRELATION:
                return float(np.sign(found))
    return 0.0


def _compare(g: GridData, table: str, name: str, reference: str, words: str,
             key: str = "") -> list[ImportFinding]:
    """Compare a sensor with another source: sign, unit, scale, clock."""
    if not g.has(name, reference):
        return []
    key = key or name
    measured = g[name]
    expected = g[reference]
    if not np.any(measured) or _is_large(expected, TURNING_SHARE).sum() < MIN_SAMPLES:
        return [ImportFinding(table, "is 0 throughout" if not np.any(measured) else
                        "the car does not move enough to compare it")]
    if name == "speed":  # an encoder may or may not have a sign
        measured = np.abs(measured)
    offset, found = _best_offset(measured, expected, MAX_CLOCK_OFFSET)
    if abs(found) < MIN_CORRELATION:
        return [ImportFinding(table, f"{key} does not follow {words} (correlation {found:.2f})",
                        f"check {key} of [{table}], its unit and its clock")]
    if found < 0.0:
        return [ImportFinding(table, f"{key} has the other sign than {words}",
                        f"{key} of [{table}] needs sign = -1", severe=True,
                        change=(table, key, "sign", -1))]
    moved = np.interp(g.t, g.t - offset, measured)
    ratio = _slope(moved, expected)
    findings = []
    unit = _find_unit(name, ratio)
    both = _find_units_of_both(ratio) if name == "speed" and ratio > 0.0 and not unit else None
    if both:
        own = f', and {key} of [{table}] needs unit = "{both[1]}"' if both[1] else ""
        return [ImportFinding("poses", f"{key} of [{table}] is {ratio:.4g} times {words}",
                              f'x and y of [poses] need unit = "{both[0]}"{own}', severe=True)]
    if unit:
        findings.append(ImportFinding(table, f"{key} is {ratio:.4g} times {words}",
                                f'{key} of [{table}] needs unit = "{unit}"', severe=True,
                                change=(table, key, "unit", unit)))
    elif not 1.0 / MAX_SCALE_ERROR < ratio < MAX_SCALE_ERROR:
        findings.append(ImportFinding(table, f"{key} is {ratio:.3g} times {words}",
                                f"{key} of [{table}] needs scale = {1.0 / ratio:.4g}, if it is "
                                "no tyre that slips"))
    if abs(offset) >= MIN_CLOCK_OFFSET:
        findings.append(ImportFinding(table, f"{key} is {abs(offset):.2f} s "
                                f"{'later' if offset > 0.0 else 'earlier'} than {words}",
                                f"[{table}] needs delay = {offset:.2f}, if it is the clock"))
    when = f"{1e3 * abs(offset):.0f} ms {'later' if offset >= 0.0 else 'earlier'}"
    return findings or [ImportFinding(table, f"{key} is {ratio:.2f} times {words}, {when} "
                                             f"(correlation {found:.2f})")]


def _find_repeated_rows(data: ImportedData) -> list[ImportFinding]:
    """Find logs that repeat a message: the noise of gyro and accelerometer never repeats."""
    findings = []
    for name in ("gyro", "accelerometer"):
        if name not in data.streams or not np.any(data.streams[name].values):
            continue
        share = float(np.all(np.diff(data.streams[name].values, axis=0) == 0.0, axis=1).mean())
        if share > MAX_REPEATED_SHARE:
            findings.append(ImportFinding(
                name, f"{share:.0%} of the rows repeat the row before",
                f'write changes = "..." into [{name}], a column that changes with each message of '
                "it; so for the encoder"))
    return findings


def _find_slow_rows(data: ImportedData) -> list[ImportFinding]:
    """Find measurements that are too rare for delays and lags."""
    return [ImportFinding(name, f"{1.0 / stream.period:.0f} rows a second",
                          f"record at {MIN_ADVISED_RATE:.0f} Hz or more: a fit sees little of "
                          "delays, lags and short turns")
            for name, stream in data.streams.items()
            if name not in ("commands", "battery") and stream.period > MAX_ROW_TIME]


def _check_axes(g: GridData) -> list[ImportFinding]:
    """Find an accelerometer that is mounted a quarter turn away, z up."""
    if not np.any(g["accel_x"]) or not np.any(g["accel_y"]):
        return []
    forward, left = (_best_offset(g[name], g["lateral"], MAX_CLOCK_OFFSET)[1]
                     for name in ("accel_x", "accel_y"))
    if abs(forward) < MIN_TURNED_CORRELATION or abs(left) >= MIN_CORRELATION:
        return []
    # x to the left has y to the rear; x to the right has y forward.
    reversed_key = "x" if forward > 0.0 else "y"
    return [ImportFinding(
        "accelerometer", f"x follows yaw rate times speed (correlation {forward:.2f}), y does not "
        f"({left:.2f})", f"exchange the columns x and y of [accelerometer]; {reversed_key} then "
        "needs sign = -1", severe=True, change=("accelerometer", reversed_key, "turn", 0.0))]


def _check_speed_command(g: GridData) -> list[ImportFinding]:
    """Compare a commanded speed with the speed of steady driving: scale, and limit."""
    speed = next((g[name] for name in ("pose_speed", "speed") if np.any(np.nan_to_num(g[name]))),
                 None)
    if speed is None:
        return []
    command = np.abs(g["throttle"])
    speed = np.abs(speed)
    use = (command > 0.0) & (speed > 0.0) & _is_large(speed, DRIVING_SHARE)
    use &= _range(command) < MAX_COMMAND_CHANGE * command
    use &= _range(speed) < MAX_SPEED_CHANGE * speed
    if use.sum() < MIN_STEADY_SAMPLES:
        return [ImportFinding("throttle", "no steady driving to compare speed and command")]
    top = float(np.quantile(speed[use], 0.9))
    at_top = use & (np.abs(speed / top - 1.0) < MAX_TOP_CHANGE)
    low, high = np.quantile(command[at_top], (0.1, 0.9))
    if high > MIN_COMMANDED_RATIO * low:
        return [ImportFinding(
            "throttle", f"the speed is {top:.2f} m/s for commands of {low:.2f} to {high:.2f} m/s",
            f"[throttle] needs limit = {top:.2f}, if the controller limits the speed; commands "
            "below the limit, or another recording, show the scale")]
    ratio = float(np.median(speed[use] / command[use]))
    text = f"in steady driving the speed is {ratio:.3g} times the command"
    unit = _find_unit("speed", 1.0 / ratio)
    if unit:
        return [ImportFinding("throttle", text, f'value of [throttle] needs unit = "{unit}"',
                              severe=True, change=("throttle", "value", "unit", unit))]
    if 1.0 / MAX_SCALE_ERROR < ratio < MAX_SCALE_ERROR:
        return [ImportFinding("throttle", text)]
    return [ImportFinding("throttle", text, "multiply the scale of value of [throttle] by "
                          f"{ratio:.3g}, if it is no tyre that slips",
                          severe=not 1.0 / MAX_COMMAND_RATIO < ratio < MAX_COMMAND_RATIO)]


def _range(values: FloatArray) -> FloatArray:
    """Return largest minus smallest value (n,) of the STEADY_TIME up to each sample."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    size = round(STEADY_TIME / GRID_STEP)
    origin = (size - 1) // 2
    return np.asarray(maximum_filter1d(values, size, origin=origin)
                      - minimum_filter1d(values, size, origin=origin))


def _check_commands(g: GridData, rate: str, speed: str) -> list[ImportFinding]:
    """Compare the steering with the curvature, and the throttle with speed and acceleration."""
    findings = []
    if g.has(rate, speed):
        drives = _is_large(g[speed], DRIVING_SHARE)
        curvature = np.where(drives, g[rate] / np.where(drives, np.abs(g[speed]), 1.0), 0.0)
        steering = np.where(drives, g["steering"], 0.0)
        found = _best_response(steering, curvature)
        findings.append(_judge_command("steering", found, "the curvature of the path"))
    if g.has(speed):
        forward = np.abs(g["throttle"]) if np.all(g[speed] >= 0.0) and not g.has("yaw") \
            else g["throttle"]
        signed = g[speed] * (np.sign(np.cos(g["course"] - g["yaw"])) if g.has("course")
                             and speed == "pose_speed" else 1.0)
        found = _best_response(forward, signed)
        findings.append(_judge_command("throttle", found, "the speed"))
    return findings


def _judge_command(name: str, found: float, words: str) -> ImportFinding:
    if found <= -MIN_CORRELATION:
        return ImportFinding(name, f"has the other sign than {words} (correlation {found:.2f})",
                       f"value of [{name}] needs sign = -1", severe=True,
                       change=(name, "value", "sign", -1))
    if found < MIN_CORRELATION:
        return ImportFinding(name, f"{words} follows it weakly (correlation {found:.2f})")
    return ImportFinding(name, f"{words} follows it (correlation {found:.2f})")


def _best_response(command: FloatArray, motion: FloatArray) -> float:
    """Return the correlation, about 0, of largest magnitude within MAX_RESPONSE_TIME."""
    best = 0.0
    for shift in range(round(MAX_RESPONSE_TIME / GRID_STEP)):
        x = command[:len(command) - shift]
        y = motion[shift:]
        size = float(np.sqrt((x @ x) * (y @ y)))
        found = float(x @ y) / size if size > 0.0 else 0.0
        best = found if abs(found) > abs(best) else best
    return best


def _best_offset(measured: FloatArray, expected: FloatArray, limit: float) -> tuple[float, float]:
    """Return (time [s] by which ``measured`` is later, correlation there)."""
    steps = min(round(limit / GRID_STEP), len(measured) // 4)
    best = (0.0, _correlation(measured, expected))
    for shift in range(-steps, steps + 1):
        x = measured[max(shift, 0):len(measured) + min(shift, 0)]
        y = expected[max(-shift, 0):len(expected) + min(-shift, 0)]
        found = _correlation(x, y)
        if abs(found) > abs(best[1]):
            best = shift * GRID_STEP, found
    return best


def _correlation(x: FloatArray, y: FloatArray) -> float:
    x = x - x.mean()
    y = y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else 0.0


def _slope(y: FloatArray, x: FloatArray) -> float:
    """Return the median of y / x where x is large."""
    large = _is_large(x, TURNING_SHARE)
    return float(np.median(y[large] / x[large])) if large.any() else np.nan


def _find_unit(name: str, ratio: float) -> str:
    """Return the unit of a column that a ratio shows; empty if it shows none."""
    size = abs(ratio)
    return next((unit for factor, unit in UNIT_RATIOS[name].items()
                 if factor / UNIT_TOLERANCE < size < factor * UNIT_TOLERANCE), "")
