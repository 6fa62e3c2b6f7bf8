"""Check recordings before a diagnosis: reject unusable ones, and warn of doubtful ones.

A wrong unit or a dead sensor looks like a physical cause. A test recording that was used for the
fit looks like a success.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dart_hal.car.runs import read_run
from dart_hal.compat import load_moved_name
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.recording.dart import RUN, Recording
from dart_hal.recording.dart.one_car import caution_several_cars, refuse_several_cars
from dart_hal.vehicle.effects import catalogue, find_effect, is_applicable
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.battery import state_fade_law
from dart_lab.identification.drive_form import check_drive
from dart_lab.identification.evaluation.cases import FRAME_NOTES
from dart_lab.identification.prediction.windows import MIN_FORWARD_THROTTLE, least_speed
from dart_lab.report.numbers import shorten_list

from .agreement import check_model, check_units, drop_dead_gyro
from .motion import driving_seconds, has_sensors
from .policy import USUAL, InputPolicy
from .split import hold_out

NOT_OBSERVED = ("position, side slip, the mocap's own errors and their consequences "
              "cannot be known")


# Channel of ``Messages`` by which a sensor is present.
SENSOR_CHANNELS = {"encoder": "speed", "gyro": "yaw_rate", "accelerometer": "accel_y"}
# Share of the messages of a test recording with stamp and readings of a training recording that
# make it a part of that. Simulated drives of one seed are the same until their commands differ.
MIN_SHARED_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Inputs:
    """Recordings of one kind, all with or all without mocap, and warnings."""

    train: tuple[Recording, ...]
    test: tuple[Recording, ...]
    notes: tuple[str, ...]


def select_effects(only: Sequence[str], exclude: Sequence[str]) -> tuple[str, ...]:
    """Return the effects of the catalogue that may be accepted.

    Errors: UsageError for an unknown effect, with the nearest ones, and when none remains.
    """
    requested = [find_effect(name).name for name in only] or list(catalogue())
    excluded = {find_effect(name).name for name in exclude}
    selected = tuple(name for name in requested if name not in excluded)
    if not selected:
        raise UsageError("no effect is left to look for", found="--only without --exclude is empty",
                         expected="at least one effect of the catalogue",
                         remedy="leave out --exclude")
    return selected


def check_inputs(train: Sequence[Recording], test: Sequence[Recording], p: Vehicle,
                 fitted_to: Collection[str] = (), policy: InputPolicy = USUAL.inputs) -> Inputs:
    """Return the recordings that a diagnosis of the model p may use, with warnings.

    test empty: stretches of each training recording are held out, ``test_share`` of it. fitted_to:
    SHA-256 of the files that the model was fitted to. Errors: UsageError for
    recordings in both sets or a motor of another form, RecordingError where nothing can be
    diagnosed, OtherCar for a model that steers the other way.
    """
    policy = policy.at_scale(find_scale(p.body))
    refuse_overlap(train, test)
    refuse_several_cars([*train, *test])
    check_drive([*train, *test], p)
    notes = list(caution_several_cars([*train, *test]))
    sets = [_drop_copies(part, notes) for part in (train, test)]
    for r in (*sets[0], *sets[1]):
        check_units(r, policy)
    sets = [[drop_dead_gyro(r, notes, policy) for r in part] for part in sets]
    sets = _select_kind(sets, notes)
    sets = [_drop_stationary(part, notes) for part in sets]
    sets = _battery_of_all(sets, notes)
    _check_duration(sets[0], policy.train_s, "train")
    if test:
        _check_duration(sets[1], policy.test_s, "test")
    else:
        sets = list(hold_out(sets[0], policy.test_share))
        notes.append(f"no test recordings: about {100 * policy.test_share:.0f} % of each training "
                     "recording is held out, in stretches between those that train, and only used "
                     "to measure the gain; recordings of other days are a stronger test")
    notes += list_frame_notes([*sets[0], *sets[1]])
    notes += check_model(sets[0], p, policy)
    seconds = sum(map(driving_seconds, sets[0]))
    if seconds < policy.small_train_s:
        more = "Record a minute or more" if test else "Record more, or another drive for --test"
        notes.append(f"only {seconds:.0f} s of driving to train on: small effects cannot be found. "
                     f"{more}")
    notes += list_braked(sets[0])
    notes += list_excluded_effects(p)
    notes += state_fade_law(p, [*sets[0], *sets[1]])
    notes += warn_fitted_before(sets[1], fitted_to)
    return Inputs(tuple(sets[0]), tuple(sets[1]), tuple(notes))


def list_braked(train: Sequence[Recording]) -> list[str]:
    """Return a note of the share of commands with which the ESC brakes."""
    braked = np.concatenate([r.messages.throttle for r in train]) < MIN_FORWARD_THROTTLE
    return [f"{braked.mean():.0%} of the commands are below 0: these stretches are left out, "
            "because no model describes the brake of an ESC"] if braked.any() else []


def list_excluded_effects(p: Vehicle) -> list[str]:
    """Return a note of the effects that are no candidates because the motor has a speed loop."""
    excluded = [name for name, one in catalogue().items() if not is_applicable(one, p)]
    return [f"not candidates, because the motor has a speed loop: {', '.join(excluded)}"
            ] if excluded else []


def list_frame_notes(recordings: Sequence[Recording]) -> list[str]:
    """Return warnings of the reader, and notes of the marker frames of the recordings."""
    kinds = (*FRAME_NOTES, "reference_unknown", "car_files")
    found: dict[str, list[str]] = {}
    for r in recordings:
        for note in r.notes:
            if note.kind in kinds:
                found.setdefault(str(note), []).append(r.name)
    return [f"{shorten_list(list(dict.fromkeys(names)))}: {note}" for note, names in found.items()]


def warn_fitted_before(test: Sequence[Recording], fitted_to: Collection[str]) -> list[str]:
    """Warn if the model was fitted to test recordings."""
    known = [r.name for r in test if r.sha256 in fitted_to]
    return [f"the model was fitted to {len(known)} of the test recordings "
            f"({shorten_list(known)}): its "
            "errors there are not those of a prediction"] if known else []


def refuse_overlap(train: Sequence[Recording], test: Sequence[Recording]) -> None:
    """Raise UsageError for a file, by its content or by a part of it, that is in both sets."""
    training = {r.sha256: r.name for r in train}
    moments = set().union(*map(_list_moments, train))
    shared = [len(own & moments) > MIN_SHARED_SHARE * len(own)
              for own in map(_list_moments, test)]
    both = [r.name for r, is_part in zip(test, shared, strict=True)
            if r.sha256 in training or is_part]
    if not both:
        return
    same = {r.sha256 for r in test} == set(training)
    raise UsageError(
        "the test recordings are the training recordings" if same else
        f"{len(both)} recording(s) to train on are test recordings as well",
        found=shorten_list(both), expected="recordings that the fit does not use",
        likely="one folder named twice, a copy of a file under another name, or parts of one file "
               "that overlap",
        remedy="leave them out on one side, or leave out --test: then stretches of each training "
               "recording are held out")


def _list_moments(r: Recording) -> set[tuple[float, ...]]:
    """Return the readings of a recording, each with its stamp, as far as it has a gyro."""
    m = r.messages
    turning = np.nan_to_num(m.yaw_rate) != 0.0
    rows = np.column_stack((m.t, m.yaw_rate, m.throttle_raw, m.steering))[turning]
    return set(map(tuple, rows.tolist()))


def _drop_copies(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Drop copies of a file, which would count twice."""
    first = {r.sha256: r for r in reversed(recordings)}
    copies = [r.name for r in recordings if first[r.sha256] is not r]
    if copies:
        notes.append(f"{shorten_list(copies)}: a copy of another recording, left out")
    return [r for r in recordings if first[r.sha256] is r]


def _select_kind(sets: list[list[Recording]], notes: list[str]) -> list[list[Recording]]:
    """Select recordings with motion capture if both sets have some, else use sensors alone."""
    with_mocap = [[r for r in part if r.mocap is not None] for part in sets]
    if with_mocap[0] and (with_mocap[1] or not sets[1]):
        others = [r.name for part in sets for r in part if r.mocap is None]
        if others:
            notes.append(f"{shorten_list(others)}: no motion capture, left out because others "
                         "have it")
        dead = [r.name for part in with_mocap for r in part if r.encoder == "dead"]
        if dead:
            notes.append(f"{shorten_list(dead)}: the encoder is dead, so the encoder is not "
                         "judged there. "
                         "Check its plug, ring and distance, and record again")
        missing = [name for name, channel in SENSOR_CHANNELS.items()
                   if not any(_measures(r, channel) for r in with_mocap[0])]
        if missing:
            notes.append(f"no {' and no '.join(missing)} in the training recordings, so "
                         "their errors cannot be judged")
        return with_mocap
    onboard = [[_remove_mocap(r) for r in part if has_sensors(r)] for part in sets]
    lost = [r.name for part in sets for r in part if not has_sensors(r)]
    if not onboard[0] or (sets[1] and not onboard[1]):
        raise RecordingError(
            "neither motion capture nor a working encoder: the motion of the car is unknown",
            found=shorten_list(lost), expected="motion capture, or an encoder that counts",
            read=shorten_list(lost), remedy="dart-hal doctor finds a dead encoder; then record "
                                            "again")
    if not all(_measures(r, "yaw_rate") for part in onboard for r in part):
        raise RecordingError(
            "neither motion capture nor a gyro: the turns of the car are unknown",
            found=shorten_list([r.name for part in onboard for r in part
                        if not _measures(r, "yaw_rate")]),
            expected="poses, or an encoder and a gyro",
            remedy="dart-hal identify friction FILES, and motor, need the encoder alone")
    if lost:
        notes.append(f"{shorten_list(lost)}: no motion capture and no working encoder, left out")
    where = "" if not with_mocap[0] and not with_mocap[1] else " on both sides"
    notes.append(f"no motion capture{where}: judged by the car's own sensors alone; {NOT_OBSERVED}")
    return onboard


def _measures(r: Recording, channel: str) -> bool:
    """Return whether a channel of the messages has a value."""
    return r.schema != "C" and bool(np.isfinite(getattr(r.messages, channel)).any())


def _remove_mocap(r: Recording) -> Recording:
    """Return the recording without its motion capture."""
    if r.mocap is None:
        return r
    return read_run(r.path, poses=False) if r.schema == RUN else replace(r, mocap=None)


def _drop_stationary(recordings: list[Recording], notes: list[str]) -> list[Recording]:
    """Drop recordings with motion capture in which the car does not drive.

    Raises RecordingError if it drives in no recording, with or without motion capture.
    """
    still = [r for r in recordings if driving_seconds(r) <= 0.0]
    if recordings and len(still) == len(recordings):
        raise RecordingError(
            "the car does not drive in these recordings, so they show no error of its model",
            found=f"{len(recordings)} recording(s), none above {least_speed(still[0]):.2g} m/s",
            expected="driving with steering and throttle that change", read=still[0].name,
            remedy="dart-hal experiment drives and records")
    driving = [r for r in recordings if r not in still or r.mocap is None]
    if len(driving) < len(recordings):
        notes.append(f"{shorten_list([r.name for r in still])}: the car is at rest, left out")
    return driving


def _battery_of_all(sets: list[list[Recording]], notes: list[str]) -> list[list[Recording]]:
    """Keep the voltage of the battery if all recordings have it, so that battery_fade is one law.
    """
    measured = [r.battery is not None for part in sets for r in part]
    if all(measured) or not any(measured):
        return sets
    notes.append(f"the voltage of the battery is not used: {measured.count(False)} of "
                 f"{len(measured)} recordings do not have it throughout")
    return [[replace(r, battery=None) for r in part] for part in sets]


def _check_duration(recordings: Sequence[Recording], min_s: float, which: str) -> None:
    """Raise RecordingError for less driving than ``min_s`` [s]."""
    seconds = sum(map(driving_seconds, recordings))
    if seconds < min_s:
        raise RecordingError(
            f"too little driving to {which}" + (" on" if which == "train" else ""),
            found=f"{seconds:.1f} s above {least_speed(recordings[0]):.2g} m/s in "
                  f"{len(recordings)} recording(s)",
            expected=f"at least {min_s:g} s, better a minute",
            read=shorten_list([r.name for r in recordings]),
            likely="cut-off recordings, or the car hardly moved",
            remedy="give more recordings; dart-hal data check lists how long each one drives")


def __getattr__(name: str) -> Any:
    """Names that were here in version 0.1."""
    return load_moved_name(__name__, name)
