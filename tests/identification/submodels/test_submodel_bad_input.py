"""Recordings that must not end in a silent wrong fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import read
from dart_hal.vehicle import PAPER
from dart_lab.identification.submodels import SUBMODELS, fit_submodels

EXCERPT = Path(__file__).resolve().parents[2] / "recorded" / "data"


@pytest.fixture(scope="module")
def driven(workshop, steps, lively):
    rng = np.random.default_rng(0)
    throttle = steps((0.22, 0.26, 0.3, 0.35), rng)
    return workshop.recordings(workshop.drive(lively, throttle, 0.0 * throttle, rng), 0,
                               name="good")


def blind(recording, **columns):
    return replace(recording, messages=replace(recording.messages, **columns))


@pytest.mark.slow
def test_a_car_that_never_moves(driven):
    parked = [replace(blind(r, speed=np.zeros(len(r.messages)), yaw_rate=np.zeros(len(r.messages))),
                      encoder="zero") for r in driven]
    fits, files = fit_submodels(parked, SUBMODELS)
    assert not any(f.sound or any(e.identifiable for e in f.parameters.values())
                   for f in fits.values())
    assert all(f.used == 0 and "the car never moved" in f.why for f in files.values())


@pytest.mark.slow
def test_a_dead_encoder_without_mocap_is_named(driven):
    dead = [replace(blind(r, speed=np.full(len(r.messages), np.nan)), encoder="dead")
            for r in driven]
    fits, files = fit_submodels(dead, ("friction", "motor"))
    assert not fits["motor"].sound
    assert all("encoder dead" in " ".join(f.why) for f in files.values())


@pytest.mark.slow
def test_one_bad_file_does_not_change_the_fit(driven):
    dead = replace(blind(driven[0], speed=np.full(len(driven[0].messages), np.nan)),
                   encoder="dead", path=driven[0].path.with_name("dead.csv"))
    clean = fit_submodels(driven, ("motor",))[0]["motor"].values()
    fits, files = fit_submodels([*driven, dead], ("motor",))
    assert fits["motor"].values() == clean
    assert files[dead.name].used == 0
    assert files[dead.name].dropped == len(dead.messages)


@pytest.mark.slow
def test_time_backwards_and_ten_rows(driven, tmp_path):
    text = driven[3].path.read_text().splitlines()
    swapped = tmp_path / "back.csv"
    swapped.write_text("\n".join([text[0], *text[50:], *text[1:50]]) + "\n")
    short = tmp_path / "short.csv"
    short.write_text("\n".join(text[:11]) + "\n")
    fits, files = fit_submodels([*driven[:3], read(swapped), read(short)], ("friction", "motor"))
    for name in "deg":
        entry = fits["motor"].parameters[name]
        assert abs(entry.value - getattr(PAPER.motor, name)) < 4.0 * entry.std
    assert files[f"{tmp_path.name}/short.csv"].used == 0
    assert fit_submodels([read(short)], ("motor",))[0]["motor"].n == 0


@pytest.mark.slow
def test_a_wrong_name_and_nothing_to_fit(driven):
    with pytest.raises(UsageError, match="sub-model"):
        fit_submodels(driven, ("engine",))
    with pytest.raises(UsageError, match="recording"):
        fit_submodels([], ("motor",))


@pytest.mark.slow
def test_mixed_schemas_of_real_recordings_give_every_sub_model_or_a_reason():
    everything, _ = read_any([EXCERPT])
    count: dict[Path, int] = {}
    recordings = []
    for r in everything:  # the first two of each folder
        count[r.path.parent] = count.get(r.path.parent, 0) + 1
        recordings += [r] if count[r.path.parent] <= 2 else []
    assert {"A", "B", "C"} <= {r.schema for r in recordings}
    fits, files = fit_submodels(recordings)
    assert tuple(fits) == SUBMODELS
    assert set(files) == {r.name for r in recordings}
    for name, fit in fits.items():
        assert fit.n > 0 or fit.notes, name
        assert np.all(np.isfinite(list(fit.values().values())))
        for entry in fit.parameters.values():
            assert not entry.identifiable or 0.0 < entry.std < np.inf
    lock = [f for n, f in files.items() if "racetrack" in n]
    assert all(f.dropped > 0.25 * (f.used + f.dropped) for f in lock)
