"""Events at times of their own are found by the tails of the errors, and listed by moment."""

from __future__ import annotations

from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.report import page
from dart_lab.diagnosis.run import make_evidence
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.diagnosis.unexplained.outliers import find_outliers
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.shooting.fit import FREE, free_names
from studies.diagnosis.events import add_gusts, lift_rear_axle
from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_files import COMMANDS, Habits, record

STYLES = ("steps", "waves", "prbs", "gentle", "ramps", "laps")


def record_car(car, style, seed):
    habits = Habits(style=style, commands=COMMANDS[seed % len(COMMANDS)])
    return read(record(Path(mkdtemp()) / f"car_1_{seed}.csv", car, habits, 60.0, seed))


def find_long_tails(recording):
    """Channels that a refit of the paper's model leaves with long tails, and their moments."""
    evidence, _ = make_evidence([recording], PAPER.body.l_r)
    search = ForwardSearch(evidence, PAPER, Settings(free=free_names(PAPER, tuple(FREE))))
    fit, _ = search._fit_and_measure_noise(search.make_space(PAPER),
                                           MessageTiming(evidence.message_age))
    return {o.channel: o for o in find_outliers(evidence, fit.vehicle, fit.timing, USUAL.noise)}


@pytest.mark.slow
def test_gusts_are_found_with_their_moments():
    car = Car()
    begins = add_gusts(car, 1.2, seed=1)
    outliers = find_long_tails(record_car(car, "steps", seed=4))
    assert outliers["v_x"].ratio > 1.5
    moments = outliers["v_x"].moments
    assert 1 <= len(moments) <= 5
    assert [m.times for m in moments] == sorted((m.times for m in moments), reverse=True)
    for m in moments:  # a window of 0.5 s and a little of the wait before the first message
        since = m.second - begins[np.searchsorted(begins, m.second) - 1]
        assert since < 2.5


@pytest.mark.slow
def test_a_sound_car_has_none():
    assert find_long_tails(record_car(Car(), "steps", seed=4)) == {}


@pytest.mark.slow
def test_too_few_windows_give_no_finding():
    car = Car()
    add_gusts(car, 1.2, seed=1)
    short = read(record(Path(mkdtemp()) / "car_1_4.csv", car, Habits(style="steps"), 15.0, 4))
    assert find_long_tails(short) == {}


@pytest.mark.slow
def test_gusts_are_not_nothing_wrong():
    car = Car()
    add_gusts(car, 1.2, seed=1)
    model, vehicle = find_model("paper")
    recordings = [record_car(car, "steps", seed) for seed in (4, 8)]
    d = diagnose(model, vehicle, recordings[:1], recordings[1:])
    assert d.verdict in ("unexplained", "partly_explained")
    text = page(d)
    assert "times what most of them have" in text
    assert d.to_json()["outliers"][0]["moments"]


@pytest.mark.long
def test_events_are_flagged_and_sound_cars_are_not():
    """Fresh seeds, six styles: gusts in 11 of 12 drives or more, a lifted wheel in 8; of 24 sound
    cars one at most. (Found: 12, 10 and 1. On the drives that the limits were chosen by: gusts
    24 of 24, lifted wheel 10 of 12, of 48 sound cars one.)"""
    flagged = {"gusts": 0, "lifted": 0, "sound": 0}
    for k, style in enumerate(STYLES):
        for seed in range(5000 + 10 * k, 5004 + 10 * k):
            if seed % 2:
                car = Car()
                add_gusts(car, 1.5, seed)
                flagged["gusts"] += bool(find_long_tails(record_car(car, style, seed)))
                car = Car()
                lift_rear_axle(car, 0.5, seed)
                flagged["lifted"] += bool(find_long_tails(record_car(car, style, seed)))
            flagged["sound"] += bool(find_long_tails(record_car(Car(), style, seed)))
    assert flagged["gusts"] >= 11
    assert flagged["lifted"] >= 8
    assert flagged["sound"] <= 1
