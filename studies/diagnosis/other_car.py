"""Effects injected into real recordings of another car: are they found, and is their size right?

    python -m studies.diagnosis.other_car [--only NAME ...] [--out FILE]    about 20 s of CPU a case

A model of sizes alone is fitted to the recording (data/other/zheng2022/day1, 1:10 car with motion
capture) as it is. Each effect is injected into the log, which is then diagnosed with that model:
the first 60 % trains, the rest tests. Found is an effect that is accepted, or a parameter finding
of the same quantity. Its size is right if it is within 2.6 of its standard errors (99 %) of what
was injected, in addition to its size in the log as it is.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dart_hal.car.runs import read_any
from dart_hal.core.config import ModelFile
from dart_hal.core.config.model import EffectEntry
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.imported import write_imported
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering, make_steering_inverse
from dart_lab import catalogue, diagnose, identify
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.identification.write import build_model
from dart_lab.importing import Table, convert_tables, load_map, read_tables

HOME = Path(__file__).parents[2]
DATA = Path(os.environ.get("OTHER_CARS_DATA", HOME.parent / "shared" / "data" / "other"))
# Sizes of the car: wheelbase and mass as published, the rest by `dart-hal car new`.
BODY = {"wheelbase": 0.325, "l_f": 0.1625, "l_r": 0.1625, "mass": 3.5, "yaw_inertia": 0.0638}
# Standard errors within which a size is right: 99 % of a normal distribution.
MAX_DEVIATION = 2.6
# Share of the recording that trains; the rest tests.
TRAIN_SHARE = 0.6
Columns = dict[str, FloatArray]


@dataclass(frozen=True)
class Injection:
    """change: of the columns of the log. truth: size by name of an effect or quantity that is
    right to name; several are equivalent in these data."""

    change: Callable[[Columns, Vehicle], Columns]
    truth: Callable[[Columns, Columns, Vehicle], Mapping[str, float]]


def shift_time(columns: Columns, names: tuple[str, ...], seconds: float) -> Columns:
    """Return columns with some that are later by ``seconds``; the ends repeat."""
    t = columns["vicon time"]
    out = dict(columns)
    for name in names:
        if name == "vicon yaw":
            out[name] = np.interp(t - seconds, t, np.unwrap(columns[name]))
        elif name.startswith("vicon"):
            out[name] = np.interp(t - seconds, t, columns[name])
        else:  # commands are held
            out[name] = columns[name][np.maximum(np.searchsorted(t, t - seconds, "right") - 1, 0)]
    return out


def move_marker(columns: Columns, ahead: float, left: float, yaw: float) -> Columns:
    """Return columns of a marker that sits elsewhere on the car, and is turned."""
    c = np.cos(columns["vicon yaw"])
    s = np.sin(columns["vicon yaw"])
    return {**columns, "vicon x": columns["vicon x"] + ahead * c - left * s,
            "vicon y": columns["vicon y"] + ahead * s + left * c,
            "vicon yaw": columns["vicon yaw"] + yaw}


def angles(columns: Columns, p: Vehicle) -> FloatArray:
    """Return the steering angles (n,) [rad] of the commands, by the model."""
    steer = make_steering(p.steering)
    return np.array([steer(float(s)) for s in columns["steering"]])


def trim_of(before: Columns, after: Columns, p: Vehicle) -> Mapping[str, float]:
    """Return the mean difference [rad] between the angles of the car and those of the log."""
    k = float((angles(before, p) - angles(after, p)).mean())
    return {"steering_trim": k, "steering map: angle straight on": k}


def gain_of(before: Columns, after: Columns, p: Vehicle) -> Mapping[str, float]:
    """Return the relative gain between the angles of the log and those of the car."""
    log = angles(after, p)
    k = float(log @ angles(before, p) / (log @ log)) - 1.0
    steer = make_steering(p.steering)
    lock = float(steer(1.25) - steer(1.0))
    return {"steering_gain": k, "steering map: angle at full lock left": lock}


def delay_of(channel: str, seconds: float
             ) -> Callable[[Columns, Columns, Vehicle], Mapping[str, float]]:
    """Return a function that gives the delay, as an effect and as a parameter finding."""
    return lambda before, after, p: {f"{channel}_delay": seconds,
                                     f"{channel} timing: delay and lag": seconds}


def latency_of(seconds: float) -> Callable[[Columns, Columns, Vehicle], Mapping[str, float]]:
    """Return a function that gives late poses: both commands then seem to act later."""
    names = ("mocap_latency", "clock_offset", "steering timing: delay and lag",
             "throttle timing: delay and lag")
    return lambda before, after, p: dict.fromkeys(names, seconds)


def pull_of(effect: str, size: float, gain: float, band: float
            ) -> Callable[[Columns, Columns, Vehicle], Mapping[str, float]]:
    """Return a function that gives a change of the motor, also as the pull at throttle 0.25."""
    def truth(before: Columns, after: Columns, p: Vehicle) -> Mapping[str, float]:
        pull = p.motor.d * (0.25 + p.motor.g)
        return {effect: size,
                "motor: pull at throttle 0.25, standing": gain * pull - band * p.motor.d,
                "drive force: pull at throttle 0.25, standing": gain * pull - band * p.motor.d}
    return truth


def fixed(**sizes: float) -> Callable[[Columns, Columns, Vehicle], Mapping[str, float]]:
    """Return a function that gives these sizes."""
    return lambda before, after, p: sizes


def change_column(name: str, change: Callable[[FloatArray], FloatArray]
                  ) -> Callable[[Columns, Vehicle], Columns]:
    """Return a function that changes one column."""
    return lambda columns, p: {**columns, name: change(columns[name])}


def widen_dead_zone(columns: Columns, p: Vehicle, width: float) -> Columns:
    """Return commands that ask for ``width / 2`` [rad] more, which the car did not steer."""
    to_command = make_steering_inverse(p.steering)
    asked = angles(columns, p) + 0.5 * width * np.sign(columns["steering"])
    return {**columns, "steering": np.array([to_command(float(a)) for a in asked])}


def hold_commands(columns: Columns, share: float) -> Columns:
    """Return commands as they are sent, of which the car misses some: the log has the sent ones.

    The car did what is in the recording, so the log gets commands that the car did not follow.
    """
    rng = np.random.default_rng(7)
    sent = dict(columns)
    n = len(columns["steering"])
    lost = np.flatnonzero(rng.random(n // 10) < share) * 10
    for start in lost:
        sent["steering"] = sent["steering"].copy()
        sent["steering"][start:start + 10] = sent["steering"][min(start + 25, n - 1)]
    return sent


def change_nothing(columns: Columns, p: Vehicle) -> Columns:
    """Return the log as it is."""
    return columns


INJECTIONS: dict[str, Injection] = {
    "nothing": Injection(change_nothing, fixed()),
    "steering delay 0.06 s": Injection(
        lambda c, p: shift_time(c, ("steering",), -0.06), delay_of("steering", 0.06)),
    "steering delay 0.12 s": Injection(
        lambda c, p: shift_time(c, ("steering",), -0.12), delay_of("steering", 0.12)),
    "throttle delay 0.15 s": Injection(
        lambda c, p: shift_time(c, ("throttle",), -0.15), delay_of("throttle", 0.15)),
    "throttle delay 0.30 s": Injection(
        lambda c, p: shift_time(c, ("throttle",), -0.3), delay_of("throttle", 0.3)),
    "steering trim": Injection(change_column("steering", lambda s: np.clip(s - 0.1, -1.0, 1.0)),
                               trim_of),
    "steering gain": Injection(change_column("steering", lambda s: s / 1.25), gain_of),
    "pose latency 0.05 s": Injection(
        lambda c, p: shift_time(c, ("vicon x", "vicon y", "vicon yaw"), 0.05),
        latency_of(0.05)),
    "yaw offset 0.05 rad": Injection(lambda c, p: move_marker(c, 0.0, 0.0, 0.05),
                                     fixed(mocap_yaw=0.05)),
    "yaw offset -0.10 rad": Injection(lambda c, p: move_marker(c, 0.0, 0.0, -0.1),
                                      fixed(mocap_yaw=-0.1)),
    "marker 0.06 m ahead": Injection(lambda c, p: move_marker(c, 0.06, 0.0, 0.0),
                                     fixed(mocap_offset_x=0.06)),
    "marker 0.05 m left": Injection(lambda c, p: move_marker(c, 0.0, 0.05, 0.0),
                                    fixed(mocap_offset_y=0.05)),
    "marker 0.10 m left": Injection(lambda c, p: move_marker(c, 0.0, 0.1, 0.0),
                                    fixed(mocap_offset_y=0.1)),
    "motor 30 % stronger": Injection(
        lambda c, p: {**c, "throttle": np.where(
            c["throttle"] > 0.0, (c["throttle"] + p.motor.g) / 1.3 - p.motor.g, 0.0)},
        pull_of("motor_gain", 0.3, 0.3, 0.0)),
    "dead band 0.03": Injection(
        lambda c, p: {**c, "throttle": np.where(c["throttle"] > 0.0, c["throttle"] + 0.03, 0.0)},
        pull_of("motor_deadband", 0.03, 0.0, 0.03)),
    "dead band 0.08": Injection(
        lambda c, p: {**c, "throttle": np.where(c["throttle"] > 0.0, c["throttle"] + 0.08, 0.0)},
        pull_of("motor_deadband", 0.08, 0.0, 0.08)),
    "steering dead zone 0.08 rad": Injection(
        lambda c, p: widen_dead_zone(c, p, 0.08), fixed(steering_dead_zone=0.08)),
    "30 % of the commands dropped": Injection(lambda c, p: hold_commands(c, 0.3),
                                              fixed(late_commands=np.nan)),
}


@dataclass(frozen=True)
class Outcome:
    """found: size and standard error of each accepted effect and parameter finding. named: one of
    the right ones is among them. size_right: None without a size. wrong: other accepted effects.
    """

    injection: str
    truth: Mapping[str, float]
    found: Mapping[str, tuple[float, float]]
    named: bool
    size_right: bool | None
    wrong: tuple[str, ...]
    flagged: bool
    verdict: str


def write_log(columns: Columns, path: Path) -> Path:
    """Write a log as an imported recording."""
    mapping, text = load_map("dart-mocap")
    write_imported(convert_tables([Table("day1", columns)], mapping, text), path)
    return path


def fit_model(recording: Recording) -> ModelFile:
    """Fit a model of sizes alone to the recording as it is."""
    start, _ = find_model("paper")
    start = msgspec.structs.replace(start, body=BODY)
    outcome = identify([recording], start, joint=True)
    model = build_model(outcome.fits, outcome.over(start), outcome.source,
                        joint=outcome.joint).model
    if model is None:
        raise SystemExit("the recording cannot be fitted")
    return model


def diagnose_log(columns: Columns, model: ModelFile, frame: Reference, folder: Path) -> Diagnosis:
    """Diagnose a log: the first part of it trains, the rest tests."""
    cut = round(TRAIN_SHARE * len(columns["steering"]))
    parts = [write_log({key: values[rows] for key, values in columns.items()}, folder / file)
             for file, rows in (("train.mcap", slice(0, cut)), ("test.mcap", slice(cut, None)))]
    (train, test), _ = read_any(parts, reference=frame)
    vehicle = vehicle_of(model)
    inputs = check_inputs([train], [test], vehicle)
    return diagnose(model, vehicle, inputs.train, inputs.test)


def size_in_the_car(effect: str, log: Columns, model: ModelFile, frame: Reference, folder: Path
                    ) -> tuple[float, float]:
    """Return size and standard error of an effect in the log as it is, accepted or not."""
    start = catalogue()[effect].parameters[0].sizes[0]
    extended = msgspec.structs.replace(model, effects=(EffectEntry(effect, {"k": start}),))
    change = diagnose_log(log, extended, frame, folder).refitted[f"{effect}.k"]
    return change.after, change.std


def judge(name: str, before: Columns, after: Columns, model: ModelFile, frame: Reference,
          folder: Path, own: dict[str, tuple[float, float]], accepted: Collection[str]
          ) -> Outcome:
    """Diagnose one injected log, and compare with what was injected.

    own: size and standard error of effects and quantities in the log as it is; those that are
    needed are added. accepted: effects that are found there.
    """
    vehicle = vehicle_of(model)
    d = diagnose_log(after, model, frame, folder)
    found = {c.effect: (c.parameters["k"].value, c.parameters["k"].std)
             for c in d.causes if "k" in c.parameters}
    for claim in d.claims:
        for what, q in claim.quantities.items():
            scale = {"deg": np.pi / 180.0, "ms": 1e-3}.get(q.unit, 1.0)
            found[f"{claim.group}: {what}"] = ((q.after - q.before) * scale, q.std * scale)
    truth = INJECTIONS[name].truth(before, after, vehicle)
    hits = [key for key in truth if key in found]
    sizes = []
    for key in hits:
        value, std = found[key]
        if key in catalogue() and key not in own:
            own[key] = size_in_the_car(key, before, model, frame, folder)
        without, without_std = own.get(key, (0.0, 0.0))
        error = np.hypot(std, without_std)
        sizes.append(abs(value - without - truth[key]) <= MAX_DEVIATION * error)
    flagged = d.late_commands is not None or bool(d.outliers)
    wrong = tuple(c.effect for c in d.causes if c.effect not in truth
                  and c.effect not in accepted)
    named = bool(hits) or ("late_commands" in truth and flagged)
    return Outcome(name, dict(truth), found, named, any(sizes) if sizes else None, wrong, flagged,
                   d.verdict)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], choices=list(INJECTIONS))
    parser.add_argument("--out", type=Path, default=None, help="one JSON object per line")
    options = parser.parse_args()
    path = DATA / "zheng2022" / "day1.csv.gz"
    if not path.is_file():
        print(f"{path} is absent: $OTHER_CARS_DATA is the folder of the other cars")
        return 2
    (table,) = read_tables([path])
    log = dict(table.columns)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (recording,), _ = read_any([write_log(log, folder / "log.mcap")])
        model = fit_model(recording)
        if recording.marker is None:
            print("the marker frame cannot be fitted to the recording")
            return 2
        # Stated, as with --reference: where the marker sits is known before the injection.
        frame = replace(recording.marker, source="stated", std=None)
        own: dict[str, tuple[float, float]] = {}
        accepted: Collection[str] = ()
        outcomes = []
        for name in ("nothing", *(options.only or [n for n in INJECTIONS if n != "nothing"])):
            after = INJECTIONS[name].change(log, vehicle_of(model))
            outcome = judge(name, log, after, model, frame, folder, own, accepted)
            if name == "nothing":
                own = dict(outcome.found)
                accepted = outcome.wrong
            outcomes.append(outcome)
            print(describe(outcome), flush=True)
            if options.out is not None:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(outcome)) + "\n")
    hidden = [o for o in outcomes if o.truth]
    sized = [o.size_right for o in hidden if o.size_right is not None]
    print(f"{sum(o.named for o in hidden)} of {len(hidden)} named, sizes right in {sum(sized)} of "
          f"{len(sized)}, {sum(len(o.wrong) for o in hidden)} wrong names")
    return 0


def describe(o: Outcome) -> str:
    """Return one line for an outcome."""
    truth = ", ".join(f"{k} {v:+.3f}" for k, v in o.truth.items())
    found = ", ".join(f"{k} {v:+.3f} +- {s:.3f}" for k, (v, s) in o.found.items())
    mark = "named" if o.named else "nothing hidden" if not o.truth else "MISSED"
    size: Any = {None: "", True: ", size right", False: ", SIZE WRONG"}[o.size_right]
    return f"{o.injection}: {mark}{size}; hidden {truth or 'nothing'}; found {found or 'nothing'}"


if __name__ == "__main__":
    sys.exit(main())
