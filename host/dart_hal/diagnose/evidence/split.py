"""The end of a recording held out: what comes first trains, what comes last tests.

The clock of a recording stays as it is, because a battery runs down from its
beginning on, whichever part of it is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from dart_hal.recording.dart import Messages, Mocap, Recording
from dart_hal.types import BoolArray

BETWEEN = 1.0
"""s between the two parts, so that what disturbed one does not disturb the other."""


def hold_out(recordings: Sequence[Recording], share: float
             ) -> tuple[list[Recording], list[Recording]]:
    """(first parts, last parts) of recordings; the last ``share`` of the time of each."""
    parts = [split(r, share) for r in recordings]
    return [first for first, _ in parts], [last for _, last in parts]


def split(r: Recording, share: float) -> tuple[Recording, Recording]:
    """(first part, the last ``share`` of its time); both keep name, hash and clock.

    The last part keeps the mocap rows before it, of which none can be used: no
    message belongs to them. Without messages of sensors (schema C) its time begins anew.
    """
    arrival = r.messages.arrival
    begin, end = float(arrival[0]), float(arrival[-1])
    at = end - share * (end - begin)
    first = replace(r, messages=_messages(r.messages, arrival <= at - BETWEEN))
    last = replace(r, messages=_messages(r.messages, arrival >= at))
    if r.mocap is None:
        return first, last
    first = replace(first, mocap=_mocap(r.mocap, r.mocap.t <= at - BETWEEN))
    return first, last if r.schema != "C" else _anew(last, r.mocap, at)


def _anew(last: Recording, mocap: Mocap, at: float) -> Recording:
    kept = _mocap(mocap, mocap.t >= at)
    since = float(kept.t[0])
    epoch = None if kept.epoch is None else kept.epoch + since
    m = last.messages
    return replace(last, mocap=replace(kept, t=kept.t - since, epoch=epoch),
                   messages=replace(m, t=m.t - since, arrival=m.arrival - since))


def _messages(m: Messages, rows: BoolArray) -> Messages:
    return Messages(**{f.name: getattr(m, f.name)[rows] for f in fields(m)})


def _mocap(m: Mocap, rows: BoolArray) -> Mocap:
    return Mocap(m.t[rows], m.epoch, m.x[rows], m.y[rows], m.yaw[rows], m.outlier[rows])
