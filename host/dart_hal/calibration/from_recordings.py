"""``calibrate steering --from``: fit a steering map to recordings of the car.

The angle is atan(l W/v) without slip correction, from rows with v > 0.8 m/s as in the paper. A
recording without such rows uses v > 0.3 m/s, and a note states it. Own runs use v > 0.3 m/s below
2 m/s2, where tyres hardly slip. The possible effect of slip is part of the standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.calibration.samples import Samples, concatenate, samples_of_turn, shift_command
from dart_hal.calibration.sessions import RecordingGroup, cautions, make_groups
from dart_hal.car.runs import read_any
from dart_hal.core.config import parse_config
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import RUN, Recording, grid, rolling_reference
from dart_hal.recording.run import RunReader
from dart_hal.vehicle.sets import PAPER

from .loop import KAPPA_PRIOR
from .result import SteeringResult
from .steering_fit import SteeringFit, fit_steering

PURPOSE = ("the map is for comparing cars, days and floors, and for the paper's form; "
           "`dart-hal calibrate steering` on the car measures and writes")
WITHOUT_PULSES = ("nothing written to a car's calibration.toml: recordings hold commands (-1..1), "
                  f"not pulses; {PURPOSE}")
WITH_PULSES = ("nothing written to a car's calibration.toml: these runs hold pulses, but neither "
               f"tyre slip nor backlash is removed from the map; {PURPOSE}")
# m/s: minimum of the paper, and minimum of slow recordings and own runs.
MIN_PAPER_SPEED = 0.8
MIN_RECORDED_SPEED = 0.3
# Share of the moving rows that has to be fast, else the recording counts as slow.
MIN_FAST_SHARE = 0.1
# m/s2; above it the tyres slip by degrees, and the angle is not a steering angle.
MAX_RECORDED_LATERAL = 4.0
# m/s2; for own runs, which need not be compared with published figures.
MAX_OWN_LATERAL = 2.0
NOT_MOVING = "at rest or slow"
SLIPPING = "above {} m/s2 of lateral acceleration (tyres slip)"
# Every tenth sample of the 100 Hz grid is used: the rate of the sensor messages.
GRID_STRIDE = 10
# Kinds of notes that are summed up in the sentence on excluded samples.
EXCLUDED = (NOT_MOVING, SLIPPING.format(MAX_RECORDED_LATERAL), SLIPPING.format(MAX_OWN_LATERAL))


def steering_from(paths: Iterable[str | Path], *, car: str = "dart-01",
                  wheelbase: float = PAPER.body.wheelbase) -> SteeringResult:
    """Read files or folders and fit a map. wheelbase [m].

    Raises RecordingError for a file that cannot be read, CalibrationFailed if the commands cover
    too little.
    """
    recordings, skipped = read_any(paths)
    notes = [FileNote(file, f"skipped, {reason}", f"skipped: {reason}") for file, reason in skipped]
    return steering_from_recordings(recordings, car=car, wheelbase=wheelbase, notes=notes)


def steering_from_recordings(recordings: Sequence[Recording], *, car: str = "dart-01",
                             wheelbase: float = PAPER.body.wheelbase,
                             notes: Sequence[FileNote] = ()) -> SteeringResult:
    """Fit a map to recordings that are already read; runs of one car give its name and pulses."""
    parts: list[tuple[Recording, Samples]] = []
    all_notes = list(notes)
    squares: list[FloatArray] = []
    servo = read_servo(recordings)
    for recording in recordings:
        samples, square, more = select_samples(recording, servo.wheelbase or wheelbase)
        squares.append(square)
        all_notes += more
        all_notes += [FileNote(recording.name, note.why, str(note), note.rows)
                      for note in recording.notes if note.rows]
        if len(samples):
            parts.append((recording, samples))
    if not parts:
        raise CalibrationFailed("no recording holds a sample that can be used",
                                found=f"{len(recordings)} recording(s), none above "
                                      f"{MIN_RECORDED_SPEED} m/s",
                                expected=f"driving at more than {MIN_RECORDED_SPEED} m/s",
                                remedy="give recordings in which the car drives and steers")
    samples = concatenate([part for _, part in parts])
    fitted = fit_steering(samples)
    slip = 0.5 * KAPPA_PRIOR[1] * float(np.concatenate(squares).mean())
    # atan(l W/v) = delta - kappa v^2 sin(2 delta)/2, with a kappa that is not measured
    std = np.hypot(fitted.angle_std, slip * np.abs(np.sin(2.0 * fitted.angle)))
    general = [*_cautions(samples, fitted), *cautions(_groups(parts, fitted)), *servo.notes,
               f"tyre slip is not removed: {np.degrees(slip):.1f} deg x sin(2 angle) (one sigma) "
               "at the speeds of these data, part of angle_std_rad"]
    unwritten = WITH_PULSES if servo.pulse is not None else WITHOUT_PULSES
    return SteeringResult(
        car=servo.car or car, source=tuple(str(r.path) for r, _ in parts), n=len(samples),
        duration=float(sum(r.duration for r in recordings)), command=fitted.command,
        angle=fitted.angle, angle_std=std,
        pulse_us=None if servo.pulse is None else servo.pulse(fitted.command),
        paper_form=fitted.form.as_dict(), residual_rms=fitted.residual_rms,
        backlash=fitted.backlash, notes=(*map(str, all_notes), *general, unwritten),
        samples=(samples.command, samples.angle, samples.direction),
        brief=(*merge_notes([n for n in all_notes if n.kind not in EXCLUDED]), *general),
        dropped=_describe_excluded(all_notes), unwritten=unwritten)


def _groups(parts: Sequence[tuple[Recording, Samples]], fitted: SteeringFit
            ) -> list[RecordingGroup]:
    ends = np.cumsum([len(samples) for _, samples in parts])[:-1]
    return make_groups([(recording, samples.command, residual) for (recording, samples), residual
                      in zip(parts, np.split(fitted.residual, ends), strict=True)])


def _describe_excluded(notes: Sequence[FileNote]) -> str:
    """Describe in one sentence how many samples were excluded, and why."""
    count = {kind: sum(n.rows for n in notes if n.kind == kind) for kind in EXCLUDED}
    out = ", ".join(f"{n} {kind}" for kind, n in count.items() if n)
    return f"excluded samples: {out}" if out else "no sample excluded"


def _cautions(samples: Samples, fitted: SteeringFit) -> list[str]:
    found = []
    levels = np.unique(samples.command)
    wide = np.flatnonzero(np.diff(levels) > 0.2)
    found += [f"no data between commands {levels[i]:+.2f} and {levels[i + 1]:+.2f}: "
              "the form interpolates there" for i in wide]
    if fitted.misfit > 0.003:
        found.append(f"level means differ from the five-parameter form by {fitted.misfit:.4f} rad "
                     "rms; this is part of angle_std_rad")
    if fitted.backlash is None:
        found.append("backlash: no level was kept after reaching it from both sides, "
                     "so it is not measured")
    elif fitted.backlash.value < 2.0 * fitted.backlash.std:
        found.append("backlash: few levels were reached from both sides; not different from zero")
    return found


def select_samples(recording: Recording, wheelbase: float
                   ) -> tuple[Samples, FloatArray, list[FileNote]]:
    """Return the steering samples of one recording, their v^2 (n,), and notes on excluded rows."""
    t, speed, yaw_rate, command, segment, texts = _read_motion(recording)
    name = recording.name
    notes = [FileNote(name, text) for text in texts]
    moving = np.isfinite(speed) & np.isfinite(yaw_rate) & (speed > MIN_RECORDED_SPEED)
    fast = moving & (speed > MIN_PAPER_SPEED)
    use = fast
    own = recording.schema == RUN
    if own:
        use = moving
    elif fast.sum() <= MIN_FAST_SHARE * moving.sum():
        use = moving
        if moving.any():
            top = float(np.nanmax(speed))
            used = (f"so samples above {MIN_RECORDED_SPEED} m/s are used instead of above "
                    f"{MIN_PAPER_SPEED} m/s")
            notes.append(FileNote(name, f"slow, {used}", f"slow: at most {top:.2f} m/s, {used}",
                                  value=top, value_unit="m/s at most"))
    limit = MAX_OWN_LATERAL if own else MAX_RECORDED_LATERAL
    slipping = use & (np.abs(speed * yaw_rate) > limit)
    if slipping.any():
        n = int(slipping.sum())
        notes.append(FileNote(name, SLIPPING.format(limit), f"{n} sample(s) above {limit} m/s2 of "
                              "lateral acceleration dropped (tyres slip)", n))
        use = use & ~slipping
    notes.append(FileNote(name, NOT_MOVING, f"{int(use.sum())} of {len(use)} samples used, the "
                          "others were at rest, slower, or slipped", int((~use & ~slipping).sum())))
    command, lag = shift_command(t, command, wheelbase * yaw_rate / np.where(use, speed, 1.0), use)
    if lag:
        kind = "commands change all the time, shifted by the lag that fits best (delay and lag)"
        notes.append(FileNote(name, kind, f"commands change all the time: taken {lag:.2f} s "
                              "earlier, where they fit best (delay and lag of servo and recorder)",
                              value=lag, value_unit="s"))
    samples = samples_of_turn(t, command, segment, wheelbase * yaw_rate, speed, use)
    return samples, np.square(speed[use]), notes


def _read_motion(recording: Recording
                 ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, list[str]]:
    """(time, speed, yaw rate, command, segment, notes), from the sensors or else from the mocap."""
    m = recording.messages
    if recording.encoder not in ("dead", "none"):
        return m.t, m.speed, m.yaw_rate, m.steering, m.segment, []
    motion = grid(recording, rolling_reference(recording))
    good = ~motion.bad
    rows = np.flatnonzero(good)[::GRID_STRIDE]
    gap = np.concatenate([[0], np.cumsum(np.diff(rows) > 3 * GRID_STRIDE)]) if len(rows) else rows
    why = "encoder dead" if recording.encoder == "dead" else "no encoder and no IMU"
    return (motion.t[rows], motion.v_x[rows], motion.omega[rows], motion.steering[rows],
            gap.astype(np.int64), [f"{why}: speed and yaw rate from the mocap"])


@dataclass(frozen=True, slots=True)
class RecordedServo:
    """Servo of runs of one car.

    car: its name, None for other recordings. pulse: command (n,) -> us, None if unknown.
    wheelbase [m] of that car.
    """

    car: str | None = None
    pulse: Callable[[FloatArray], FloatArray] | None = None
    wheelbase: float | None = None
    notes: tuple[str, ...] = ()


def read_servo(recordings: Sequence[Recording]) -> RecordedServo:
    """Read the servo from the car.toml in the runs; empty unless all recordings are runs.

    Raises RecordingError, ConfigError for a run whose car.toml cannot be read.
    """
    if any(r.schema != RUN for r in recordings):
        return RecordedServo()
    texts = [RunReader(r.path).files.get("car.toml") for r in recordings]
    configs = [parse_config(text, f"car.toml in {r.path}", recorded=True)
               for r, text in zip(recordings, texts, strict=True) if text]
    if len(configs) < len(recordings):
        return RecordedServo(notes=("no pulses: a run contains no car.toml",))
    names = sorted({c.name for c in configs})
    if len(names) > 1:
        return RecordedServo(
            notes=(f"caution: one map from runs of several cars: {', '.join(names)}",))
    if len({(c.steering.center_us, c.steering.span_us, c.steering.direction)
            for c in configs}) > 1:
        return RecordedServo(names[0], wheelbase=configs[0].geometry.wheelbase,
                     notes=("no pulses: [steering] center_us, span_us or direction changed "
                            "between the runs",))
    steering = configs[0].steering
    centre = steering.center_us
    span = steering.direction * steering.span_us

    def pulse(command: FloatArray) -> FloatArray:
        return centre + span * command

    return RecordedServo(names[0], pulse, configs[0].geometry.wheelbase)


@dataclass(frozen=True, slots=True)
class FileNote:
    """Note on one file.

    kind: the sentence without the figures of this file; notes of one kind are merged. text: the
    whole sentence, empty: the kind. rows: number of rows concerned, 0: the whole file. value: a
    figure of this file in ``value_unit``, or None.
    """

    file: str
    kind: str
    text: str = ""
    rows: int = 0
    value: float | None = None
    value_unit: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.text or self.kind}"


def merge_notes(notes: Sequence[FileNote]) -> tuple[str, ...]:
    """Merge notes to one line per kind, in the order in which the kinds first occur."""
    kinds: dict[str, list[FileNote]] = {}
    for note in notes:
        kinds.setdefault(note.kind, []).append(note)
    return tuple(_line(kind, same) for kind, same in kinds.items())


def _line(kind: str, notes: Sequence[FileNote]) -> str:
    files = list(dict.fromkeys(n.file for n in notes))
    where = f"in {len(files)} files" if len(files) > 1 else f"in {files[0]}"
    rows = sum(n.rows for n in notes)
    values = [n.value for n in notes if n.value is not None]
    figures = ""
    if values:
        low = f"{min(values):.2f}"
        high = f"{max(values):.2f}"
        span = low if low == high else f"{low} to {high}"
        figures = f" ({span} {notes[0].value_unit})"
    return f"{kind}: {f'{rows} rows ' if rows else ''}{where}{figures}"
