"""Recordings before they are diagnosed: what cannot be used is refused or said, and why.

A wrong unit, a dead sensor or a test recording that was trained on looks like
a physical cause, or like a success. So it is looked for first.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dart_hal.car.runs import read_run
from dart_hal.compat import load_moved_name
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.recording.dart import RUN, Recording
from dart_hal.vehicle.effects import catalogue, effect
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.report.numbers import some

from .evidence.agreement import check_model, check_units, drop_dead_gyro
from .evidence.motion import driving_seconds, has_sensors
from .evidence.split import hold_out
from .policy import USUAL, InputPolicy

NEVER_SEEN = ("position, side slip, the mocap's own errors and whatever shows in them "
              "cannot be known")


@dataclass(frozen=True, slots=True)
class Inputs:
    """train, test: recordings of one kind, with or without mocap; notes: what must be said."""

    train: tuple[Recording, ...]
    test: tuple[Recording, ...]
    notes: tuple[str, ...]


def effects_named(only: Sequence[str], exclude: Sequence[str]) -> tuple[str, ...]:
    """Effects of the catalogue that may be named.

    Errors: UsageError for an unknown effect, with the nearest ones, and when none is left.
    """
    asked = [effect(name).name for name in only] or list(catalogue())
    left = tuple(name for name in asked if name not in {effect(e).name for e in exclude})
    if not left:
        raise UsageError("no effect is left to look for", found="--only without --exclude is empty",
                         expected="at least one effect of the catalogue",
                         remedy="leave out --exclude")
    return left


def check_inputs(train: Sequence[Recording], test: Sequence[Recording], p: Vehicle,
            fitted_to: Collection[str] = (), policy: InputPolicy = USUAL.inputs) -> Inputs:
    """Recordings that a diagnosis of the model p may use.

    test empty: stretches of each training recording are held out, ``test_share`` of it. fitted_to:
    SHA-256 of the files that the model was fitted to. Errors: UsageError for
    recordings on both sides, RecordingError where nothing can be diagnosed,
    OtherCar for a model that steers the other way.
    """
    refuse_overlap(train, test)
    notes: list[str] = []
    sides = [_once(side, notes) for side in (train, test)]
    for r in (*sides[0], *sides[1]):
        check_units(r, policy)
    sides = [[drop_dead_gyro(r, notes, policy) for r in side] for side in sides]
    sides = _of_one_kind(sides, notes)
    sides = [_that_drive(side, notes) for side in sides]
    _long_enough(sides[0], policy.train_s, "train")
    if test:
        _long_enough(sides[1], policy.test_s, "test")
    else:
        sides = list(hold_out(sides[0], policy.test_share))
        notes.append(f"no test recordings: about {100 * policy.test_share:.0f} % of each training "
                     "recording is held out, in stretches between those that train, and only used "
                     "to measure the gain; other days would tell more")
    notes += about_frames([*sides[0], *sides[1]])
    notes += check_model(sides[0], p, policy)
    seconds = sum(map(driving_seconds, sides[0]))
    if seconds < policy.small_train_s:
        notes.append(f"only {seconds:.0f} s of driving to train on: small effects cannot be seen. "
                     "Record a minute or more")
    notes += fitted_before(sides[1], fitted_to)
    return Inputs(tuple(sides[0]), tuple(sides[1]), tuple(notes))


def about_frames(recordings: Sequence[Recording]) -> list[str]:
    """Cautions of the reader, and the marker frames that the recordings were given."""
    kinds = ("steering_reversed", "marker", "marker_differs", "reference_unknown", "car_files")
    found: dict[str, list[str]] = {}
    for r in recordings:
        for note in r.notes:
            if note.kind in kinds:
                found.setdefault(str(note), []).append(r.name)
    return [f"{some(list(dict.fromkeys(names)))}: {note}" for note, names in found.items()]


def fitted_before(test: Sequence[Recording], fitted_to: Collection[str]) -> list[str]:
    """What must be said of a model that has seen the test recordings before."""
    known = [r.name for r in test if r.sha256 in fitted_to]
    return [f"the model was fitted to {len(known)} of the test recordings ({some(known)}): its "
            "errors there are not those of a prediction"] if known else []


def refuse_overlap(train: Sequence[Recording], test: Sequence[Recording]) -> None:
    """Errors: UsageError for a file, by its content, on both sides."""
    seen = {r.sha256: r.name for r in train}
    both = [r.name for r in test if r.sha256 in seen]
    if not both:
        return
    same = {r.sha256 for r in test} == set(seen)
    raise UsageError(
        "the test recordings are the training recordings" if same else
        f"{len(both)} recording(s) to train on are test recordings as well",
        found=some(both), expected="recordings that the fit has not seen",
        likely="one folder named twice, or a copy of a file under another name",
        remedy="leave them out on one side, or leave out --test: then stretches of each training "
               "recording are held out")


def _once(side: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Each content once: a copy would count twice."""
    kept = {r.sha256: r for r in reversed(side)}
    copies = [r.name for r in side if kept[r.sha256] is not r]
    if copies:
        notes.append(f"{some(copies)}: a copy of another recording, left out")
    return [r for r in side if kept[r.sha256] is r]


def _of_one_kind(sides: list[list[Recording]], notes: list[str]) -> list[list[Recording]]:
    """With motion capture where both sides have it, else all by their own sensors alone."""
    seen = [[r for r in side if r.mocap is not None] for side in sides]
    if seen[0] and (seen[1] or not sides[1]):
        left = [r.name for side in sides for r in side if r.mocap is None]
        if left:
            notes.append(f"{some(left)}: no motion capture, left out beside those that have it")
        dead = [r.name for side in seen for r in side if r.encoder == "dead"]
        if dead:
            notes.append(f"{some(dead)}: the encoder is dead, so the encoder is not judged there. "
                         "Check its plug, ring and distance, and record again")
        if not any(has_sensors(r) for r in seen[0]):
            notes.append("no on-board sensors in the training recordings: encoder, gyro and "
                         "accelerometer cannot be judged")
        return seen
    onboard = [[_unseen(r) for r in side if has_sensors(r)] for side in sides]
    lost = [r.name for side in sides for r in side if not has_sensors(r)]
    if not onboard[0] or (sides[1] and not onboard[1]):
        raise RecordingError(
            "neither motion capture nor a working encoder: nothing tells how the car moved",
            found=some(lost), expected="motion capture, or an encoder that counts",
            read=some(lost), remedy="dart-hal doctor finds a dead encoder; then record again")
    if lost:
        notes.append(f"{some(lost)}: no motion capture and no working encoder, left out")
    where = "" if not seen[0] and not seen[1] else " on both sides"
    notes.append(f"no motion capture{where}: judged by the car's own sensors alone; {NEVER_SEEN}")
    return onboard


def _unseen(r: Recording) -> Recording:
    """The recording as if no motion capture had been there."""
    if r.mocap is None:
        return r
    return read_run(r.path, poses=False) if r.schema == RUN else replace(r, mocap=None)


def _that_drive(side: list[Recording], notes: list[str]) -> list[Recording]:
    still = [r for r in side if driving_seconds(r) <= 0.0]
    if side and len(still) == len(side):
        raise RecordingError(
            "the car does not drive in these recordings, so nothing shows what its model gets "
            "wrong", found=f"{len(side)} recording(s), none above 0.3 m/s",
            expected="driving with steering and throttle that change", read=still[0].name,
            remedy="dart-hal experiment drives and records")
    kept = [r for r in side if r not in still or r.mocap is None]
    if len(kept) < len(side):
        notes.append(f"{some([r.name for r in still])}: the car stands still, left out")
    return kept


def _long_enough(side: Sequence[Recording], least: float, which: str) -> None:
    seconds = sum(map(driving_seconds, side))
    if seconds < least:
        raise RecordingError(
            f"too little driving to {which}" + (" on" if which == "train" else ""),
            found=f"{seconds:.1f} s above 0.3 m/s in {len(side)} recording(s)",
            expected=f"at least {least:g} s, better a minute", read=some([r.name for r in side]),
            likely="cut-off recordings, or the car hardly moved",
            remedy="give more recordings; dart-hal data check says how long each one drives")


def __getattr__(name: str) -> Any:
    """Names that were here in version 0.1."""
    return load_moved_name(__name__, name)
