"""``calibrate steering --from``: a steering map out of recordings of the car.

The angle is atan(l W/v) without slip correction, from rows with v > 0.8 m/s as
in the paper; where nothing is that fast v > 0.3 m/s, and the notes say so.
Our own runs: v > 0.3 m/s below 2 m/s2, where tyres hardly slip. What slip may
do to the angle is part of the standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.calibration.samples import Samples, answered, concatenate, samples_of_turn
from dart_hal.calibration.sessions import Group, cautions, groups_of
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
               f"tyre slip nor backlash is taken out of the map; {PURPOSE}")
FAST, SLOW = 0.8, 0.3  # m/s
FAST_SHARE = 0.1  # of the moving rows must be fast, else the recording counts as slow
MAX_LATERAL = 4.0  # m/s2; beyond it the tyres slip by degrees, the angle is no steering angle
MAX_LATERAL_RUN = 2.0  # m/s2; of our own runs, which need not compare with published figures
STANDING = "standing or slow"
SLIPPING = "above {} m/s2 of lateral acceleration (tyres slip)"
THIN = 10  # every tenth sample of the 100 Hz grid, as often as a sensor message
# kinds of notes that the sentence on dropped samples sums up
COUNTED = (STANDING, SLIPPING.format(MAX_LATERAL), SLIPPING.format(MAX_LATERAL_RUN))


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


def samples_of(recording: Recording, wheelbase: float
               ) -> tuple[Samples, FloatArray, list[FileNote]]:
    """Steering samples of one recording, their v^2 (n,), and what was left out of it."""
    t, speed, yaw_rate, command, segment, said = _motion(recording)
    name = recording.name
    notes = [FileNote(name, text) for text in said]
    moving = np.isfinite(speed) & np.isfinite(yaw_rate) & (speed > SLOW)
    fast = moving & (speed > FAST)
    use = fast
    own = recording.schema == RUN
    if own:
        use = moving
    elif fast.sum() <= FAST_SHARE * moving.sum():
        use = moving
        if moving.any():
            top = float(np.nanmax(speed))
            used = f"so samples above {SLOW} m/s are used instead of above {FAST} m/s"
            notes.append(FileNote(name, f"slow, {used}", f"slow: at most {top:.2f} m/s, {used}",
                                  value=top, value_unit="m/s at most"))
    limit = MAX_LATERAL_RUN if own else MAX_LATERAL
    slipping = use & (np.abs(speed * yaw_rate) > limit)
    if slipping.any():
        n = int(slipping.sum())
        notes.append(FileNote(name, SLIPPING.format(limit), f"{n} sample(s) above {limit} m/s2 of "
                              "lateral acceleration dropped (tyres slip)", n))
        use = use & ~slipping
    notes.append(FileNote(name, STANDING, f"{int(use.sum())} of {len(use)} samples used, the "
                          "others stood, were slower or slipped", int((~use & ~slipping).sum())))
    command, more = answered(t, command, wheelbase * yaw_rate / np.where(use, speed, 1.0), use)
    if more:
        kind = "commands change all the time, taken as much earlier as fits best (delay and lag)"
        notes.append(FileNote(name, kind, f"commands change all the time: taken {more:.2f} s "
                              "earlier, where they fit best (delay and lag of servo and recorder)",
                              value=more, value_unit="s"))
    samples = samples_of_turn(t, command, segment, wheelbase * yaw_rate, speed, use)
    return samples, np.square(speed[use]), notes


def _motion(recording: Recording
            ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, list[str]]:
    """(time, speed, yaw rate, command, segment, notes): from the sensors, else from the mocap."""
    m = recording.messages
    if recording.encoder not in ("dead", "none"):
        return m.t, m.speed, m.yaw_rate, m.steering, m.segment, []
    motion = grid(recording, rolling_reference(recording))
    good = ~motion.bad
    rows = np.flatnonzero(good)[::THIN]
    gap = np.concatenate([[0], np.cumsum(np.diff(rows) > 3 * THIN)]) if len(rows) else rows
    why = "encoder dead" if recording.encoder == "dead" else "no encoder and no IMU"
    return (motion.t[rows], motion.v_x[rows], motion.omega[rows], motion.steering[rows],
            gap.astype(np.int64), [f"{why}: speed and yaw rate from the mocap"])


@dataclass(frozen=True, slots=True)
class Servo:
    """car: its name if all runs are of one; pulse: command (n,) -> us, None if not
    known; wheelbase [m] of that car."""

    car: str | None = None
    pulse: Callable[[FloatArray], FloatArray] | None = None
    wheelbase: float | None = None
    notes: tuple[str, ...] = ()


def servo_of(recordings: Sequence[Recording]) -> Servo:
    """What the car.toml in the runs says; nothing unless all recordings are runs.

    Errors: RecordingError, ConfigError for a run whose car.toml cannot be read.
    """
    if any(r.schema != RUN for r in recordings):
        return Servo()
    texts = [RunReader(r.path).files.get("car.toml") for r in recordings]
    configs = [parse_config(text, f"car.toml in {r.path}", recorded=True)
               for r, text in zip(recordings, texts, strict=True) if text]
    if len(configs) < len(recordings):
        return Servo(notes=("no pulses: a run holds no car.toml",))
    names = sorted({c.name for c in configs})
    if len(names) > 1:
        return Servo(notes=(f"caution: one map out of runs of several cars: {', '.join(names)}",))
    if len({(c.steering.center_us, c.steering.span_us, c.steering.direction)
            for c in configs}) > 1:
        return Servo(names[0], wheelbase=configs[0].geometry.wheelbase,
                     notes=("no pulses: [steering] center_us, span_us or direction changed "
                            "between the runs",))
    steering = configs[0].steering
    centre, span = steering.center_us, steering.direction * steering.span_us

    def pulse(command: FloatArray) -> FloatArray:
        return centre + span * command

    return Servo(names[0], pulse, configs[0].geometry.wheelbase)


@dataclass(frozen=True, slots=True)
class FileNote:
    """Something about one file.

    kind: the sentence without what differs between files; notes of one kind
    are grouped. text: the whole sentence, empty: the kind. rows: how many it
    concerns, 0: the whole file. value: a figure of this file in
    ``value_unit``, or None.
    """

    file: str
    kind: str
    text: str = ""
    rows: int = 0
    value: float | None = None
    value_unit: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.text or self.kind}"


def grouped(notes: Sequence[FileNote]) -> tuple[str, ...]:
    """One line per kind, in the order in which the kinds first occur."""
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
        low, high = f"{min(values):.2f}", f"{max(values):.2f}"
        span = low if low == high else f"{low} to {high}"
        figures = f" ({span} {notes[0].value_unit})"
    return f"{kind}: {f'{rows} rows ' if rows else ''}{where}{figures}"
