"""Findings about a recording: what the reader changed, and what a user has to know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .facts import RecordingFacts
from .motion import MAX_SLIP_SHARE, MAX_SLIP_SPEED, MIN_MOVING_SPEED, RecordedMotion

# Kinds of findings by their effect: rows dropped, or only reported; the others change values.
DROPPED_KINDS = ("cut_off_line", "not_finite", "not_started", "held_copies", "repeated_stamp",
                 "mocap_repeated", "differing_copies")
REPORTED_KINDS = ("car_files", "quantum", "lost_messages", "encoder_zero", "read",
                  "reference_unknown", "marker_differs", "marker_of_day", "steering_reversed")
SERIOUS_KINDS = ("differing_copies", "time_back", "mocap_time_back", "false_lock", "encoder_dead",
                 "sensor_stuck", "not_finite", "never_moves", "too_short", "message_gap",
                 "reference_unknown", "marker_differs", "marker_of_day", "mostly_bad",
                 "steering_reversed", "car_files")
MIN_FIT_DURATION = 3.0  # s
MAX_TILT_ACCELERATION = 0.15  # m/s2 at rest
REST_ROWS = 10
MIN_REPORTED_SLIP = 0.05  # of the driven time


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding about a recording.

    kind: one word of the table in docs/reference/recordings.md. effect: "dropped" (rows), "changed"
    (values or marks) or "said" (only reported). serious: read it before a fit.
    """

    kind: str
    text: str
    rows: int = 0
    effect: str = "said"
    serious: bool = False

    def __str__(self) -> str:
        return f"{self.text}: {self.rows} row(s)" if self.rows else self.text


def findings(m: RecordedMotion, f: RecordingFacts) -> list[Finding]:
    """Return the findings about one recording, serious ones first."""
    speed = m.recording.scale.speed
    out = [_finding_of_note(n.kind, n.why, n.rows) for n in m.recording.notes]
    if m.mostly_bad:
        share = 1.0 - float(m.good.mean())
        out.insert(0, _report("mostly_bad", f"{share:.0%} of the motion capture is marked bad "
                              "(gaps, jumps, false lock, or messages that are missing): nothing "
                              "may be concluded from the rest"))
    elif not m.moves:
        out.append(_report("never_moves", "the car never moves: no speed above "
                         f"{MIN_MOVING_SPEED * speed:.2g} m/s in any sensor"))
    if f.duration < MIN_FIT_DURATION:
        out.append(_report("too_short", f"only {f.duration:.1f} s long: too short for a fit"))
    if f.rounded:
        out.append(_report("rounded", "sensor values have 2 decimals: a quantum of 0.01 on top of "
                         "the encoder's"))
    out += _mocap(m, f) + _accelerometer(m)
    if m.slip >= MIN_REPORTED_SLIP:
        out.append(Finding("slip", "wheel and ground speed differ by more than "
                           f"{MAX_SLIP_SPEED * speed:.2g} m/s in {m.slip:.0%} of the driven time: "
                           "the wheels slip, use the mocap",
                           serious=m.slip >= MAX_SLIP_SHARE))
    return sorted(out, key=lambda x: not x.serious)


def _finding_of_note(kind: str, why: str, rows: int) -> Finding:
    effect = ("dropped" if kind in DROPPED_KINDS else
              "said" if kind in REPORTED_KINDS else "changed")
    return Finding(kind, why, rows, effect, kind in SERIOUS_KINDS)


def _report(kind: str, text: str) -> Finding:
    return Finding(kind, text, serious=kind in SERIOUS_KINDS)


def _mocap(m: RecordedMotion, f: RecordingFacts) -> list[Finding]:
    if f.mocap is None:
        return []
    out = []
    if f.mocap.wraps:
        out.append(Finding("yaw_wraps", f"yaw passes +-pi {f.mocap.wraps} time(s): unwrapped after "
                           "the outliers were set aside", effect="changed"))
    if f.mocap.bad > 0.0 and not m.mostly_bad:
        out.append(Finding("bad_samples", f"{f.mocap.bad:.1%} of the motion is marked bad, 0.2 s "
                           "to both sides included", effect="changed"))
    return out


def _accelerometer(m: RecordedMotion) -> list[Finding]:
    """Report an offset at rest (tilt) and a large spread while driving (vibration)."""
    a = m.recording.messages
    if not np.isfinite(a.accel_x).any():
        return []
    speed = np.nan_to_num(a.speed)
    rest = (speed == 0.0) & (a.throttle == 0.0)
    out = []
    if m.recording.encoder == "ok" and rest.sum() >= REST_ROWS:
        x = float(np.nanmean(a.accel_x[rest]))
        y = float(np.nanmean(a.accel_y[rest]))
        if max(abs(x), abs(y)) > MAX_TILT_ACCELERATION:
            out.append(_report("accelerometer_tilt", "accelerometer at rest shows "
                             f"({x:+.2f}, {y:+.2f}) m/s2: tilt, do not integrate it"))
    driven = speed > MIN_MOVING_SPEED * m.recording.scale.speed
    if driven.sum() >= REST_ROWS and float(np.nanstd(a.accel_x[driven])) > 1.0:
        out.append(_report("vibration", "accelerometer x scatters by "
                         f"{float(np.nanstd(a.accel_x[driven])):.1f} m/s2 while driving: "
                         "vibration sampled too slowly"))
    return out
