"""Drives of the independent simulator, searched: the search alone, without its report."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.gains import make_recording_set
from dart_lab.diagnosis.run import make_evidence
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import refit
from dart_lab.identification.shooting.fit import FREE, free_names
from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_causes import hide
from studies.diagnosis.stranger_files import Habits, record

USUAL = Habits()
ALL_FREE = free_names(PAPER, tuple(FREE))


def car(*causes, **changed):
    """A car with causes (name, size) hidden in it; changed: its own numbers, as factors."""
    c = Car()
    for name, factor in changed.items():
        setattr(c, name, getattr(c, name) * factor)
    for name, size in causes:
        hide(c, name, size)
    return c


def fitted_side(hide=lambda car: None, seconds=60.0):
    """(side, fit) of a simulated car whose model is right; hide: hangs events on the car."""
    strange = Car()
    hide(strange)
    file = Path(mkdtemp()) / "car_1_4.csv"
    recording = read(record(file, strange, Habits(style="steps"), seconds, 4))
    evidence, _ = make_evidence([recording], PAPER.body.l_r)
    search = ForwardSearch(evidence, PAPER, Settings())
    fit, _ = search._fit_and_measure_noise(search.make_space(PAPER),
                                           MessageTiming(evidence.message_age))
    return make_recording_set(evidence, [recording], PAPER.body.l_r, None), fit


def drive(*causes, seconds=40.0, seed=3, habits=USUAL, **changed):
    """A recording of ``car``; each is written once."""
    return _drive(causes, seconds, seed, habits, tuple(changed.items()))


@lru_cache(maxsize=32)
def _drive(causes, seconds, seed, habits, changed):
    path = Path(mkdtemp()) / f"car_1_{seed}.csv"
    return read(record(path, car(*causes, **dict(changed)), habits, seconds, seed))


def evidence(*recordings):
    return make_evidence(recordings, PAPER.body.l_r)[0]


def fit_start(of_drive, p=PAPER, free=(), noise=None):
    """(noise, point) of evidence: nothing but timing and ``free`` fitted."""
    space = Space(p, free)
    noise = noise or estimate_noise(of_drive.residuals(p, MessageTiming()), of_drive.blocks())
    return noise, refit(of_drive, noise, space, space.point(MessageTiming()))


def search(*recordings, p=PAPER, free=(), known=None, names=(), **settings):
    """What the search finds; the base is right and fixed unless something of it is free."""
    return ForwardSearch(evidence(*recordings), p, Settings(
        free=tuple(free), known=known or {}, names=tuple(names), **settings)).run()


def names(found):
    return [n.effect for n in found.accepted]


def size_of(found, name):
    """First parameter of an effect that was found."""
    return next(a.values[0] for a in found.point.vehicle.effects if a.name == name)


def share_explained(change, other):
    """1 - squared error / square, of a change (N,) by another one."""
    return 1.0 - float(np.sum((change - other)**2) / np.sum(change**2))
