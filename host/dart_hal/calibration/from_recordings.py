"""``calibrate steering --from``: a steering map out of recordings of the car.

The angle is atan(l W/v) without slip correction, from rows with v > 0.8 m/s as
in the paper; where nothing is that fast v > 0.3 m/s, and the notes say so.
Our own runs: v > 0.3 m/s below 2 m/s2, where tyres hardly slip. What slip may
do to the angle is part of the standard error.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from dart_hal.calibration.groups import Group, cautions, groups_of
from dart_hal.calibration.samples import Samples, concatenate
from dart_hal.car.runs import read_any
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.sets import PAPER

from .loop import KAPPA_PRIOR
from .notes import FileNote, grouped
from .result import SteeringResult
from .run_pulses import servo_of
from .steering_fit import SteeringFit, fit_steering
from .steering_rows import (
    MAX_LATERAL,
    MAX_LATERAL_RUN,
    SLIPPING,
    SLOW,
    STANDING,
    samples_of,
)

# kinds of notes that the sentence on dropped samples sums up
COUNTED = (STANDING, SLIPPING.format(MAX_LATERAL), SLIPPING.format(MAX_LATERAL_RUN))
PURPOSE = ("the map is for comparing cars, days and floors, and for the paper's form; "
           "`dart-hal calibrate steering` on the car measures and writes")
WITHOUT_PULSES = ("nothing written to a car's calibration.toml: recordings hold commands (-1..1), "
                  f"not pulses; {PURPOSE}")
WITH_PULSES = ("nothing written to a car's calibration.toml: these runs hold pulses, but neither "
               f"tyre slip nor backlash is taken out of the map; {PURPOSE}")


def steering_from(paths: Iterable[str | Path], *, car: str = "dart-01",
                  wheelbase: float = PAPER.body.wheelbase) -> SteeringResult:
    """Read files or folders and fit. wheelbase [m].

    Errors: RecordingError for a file that cannot be read, CalibrationFailed
    when the commands cover too little.
    """
    recordings, skipped = read_any(paths)
    notes = [FileNote(file, f"skipped, {reason}", f"skipped: {reason}") for file, reason in skipped]
    return steering_from_recordings(recordings, car=car, wheelbase=wheelbase, notes=notes)


def steering_from_recordings(recordings: Sequence[Recording], *, car: str = "dart-01",
                             wheelbase: float = PAPER.body.wheelbase,
                             notes: Sequence[FileNote] = ()) -> SteeringResult:
    """The same from recordings that are already read. Runs of one car give its name and pulses."""
    parts: list[tuple[Recording, Samples]] = []
    said = list(notes)
    squares: list[FloatArray] = []
    servo = servo_of(recordings)
    for recording in recordings:
        samples, square, more = samples_of(recording, servo.wheelbase or wheelbase)
        squares.append(square)
        said += more
        said += [FileNote(recording.name, note.why, str(note), note.rows)
                 for note in recording.notes if note.rows]
        if len(samples):
            parts.append((recording, samples))
    if not parts:
        raise CalibrationFailed("no recording holds a sample that can be used",
                                found=f"{len(recordings)} recording(s), none above {SLOW} m/s",
                                expected="driving at more than 0.3 m/s",
                                remedy="give recordings in which the car drives and steers")
    samples = concatenate([part for _, part in parts])
    fitted = fit_steering(samples)
    slip = 0.5 * KAPPA_PRIOR[1] * float(np.concatenate(squares).mean())
    # atan(l W/v) = delta - kappa v^2 sin(2 delta)/2, with a kappa that nobody measured
    std = np.hypot(fitted.angle_std, slip * np.abs(np.sin(2.0 * fitted.angle)))
    general = [*_cautions(samples, fitted), *cautions(_groups(parts, fitted)), *servo.notes,
               f"tyre slip is not taken out: {np.degrees(slip):.1f} deg x sin(2 angle) (one sigma) "
               "at the speeds of these data, part of angle_std_rad"]
    unwritten = WITH_PULSES if servo.pulse is not None else WITHOUT_PULSES
    return SteeringResult(
        car=servo.car or car, source=tuple(str(r.path) for r, _ in parts), n=len(samples),
        duration=float(sum(r.duration for r in recordings)), command=fitted.command,
        angle=fitted.angle, angle_std=std,
        pulse_us=None if servo.pulse is None else servo.pulse(fitted.command),
        paper_form=fitted.form.as_dict(), residual_rms=fitted.residual_rms,
        backlash=fitted.backlash, notes=(*map(str, said), *general, unwritten),
        samples=(samples.command, samples.angle, samples.direction),
        brief=(*grouped([n for n in said if n.kind not in COUNTED]), *general),
        dropped=_dropped(said), unwritten=unwritten)


def _groups(parts: Sequence[tuple[Recording, Samples]], fitted: SteeringFit) -> list[Group]:
    ends = np.cumsum([len(samples) for _, samples in parts])[:-1]
    return groups_of([(recording, samples.command, residual) for (recording, samples), residual
                      in zip(parts, np.split(fitted.residual, ends), strict=True)])


def _dropped(notes: Sequence[FileNote]) -> str:
    """One sentence: how many samples were left out, and why."""
    count = {kind: sum(n.rows for n in notes if n.kind == kind) for kind in COUNTED}
    out = ", ".join(f"{n} {kind}" for kind, n in count.items() if n)
    return f"samples left out: {out}" if out else "no sample left out"


def _cautions(samples: Samples, fitted: SteeringFit) -> list[str]:
    said = []
    levels = np.unique(samples.command)
    wide = np.flatnonzero(np.diff(levels) > 0.2)
    said += [f"no data between commands {levels[i]:+.2f} and {levels[i + 1]:+.2f}: "
             "the form interpolates there" for i in wide]
    if fitted.misfit > 0.003:
        said.append(f"level means leave the five-parameter form by {fitted.misfit:.4f} rad rms; "
                    "this is part of angle_std_rad")
    if fitted.backlash is None:
        said.append("backlash: no level was held after reaching it from both sides, "
                    "so it cannot be told")
    elif fitted.backlash.value < 2.0 * fitted.backlash.std:
        said.append("backlash: few levels were reached from both sides; not different from zero")
    return said
