"""What depends on the drive is found and named; noise is not, however it is coloured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_lab.diagnosis.unexplained import crossfit
from dart_lab.diagnosis.unexplained.structure import (
    ResidualGroup,
    explained_shares,
    find_group_structure,
)
from dart_lab.identification.evidence.readings import SENSORS
from dart_lab.identification.evidence.residuals import MOTION

FEATURE_SECONDS = 120.0


def smooth(rng, t, memory):
    """Noise (n,) of variance 1 that forgets within ``memory`` [s]."""
    out = rng.normal(size=len(t))
    for i in range(1, len(t)):
        keep = np.exp(-abs(t[i] - t[i - 1]) / memory) if memory else 0.0
        out[i] = keep * out[i - 1] + np.sqrt(1.0 - keep**2) * out[i]
    return out


def group(channels, step, seed, recordings=1, memory=0.0):
    """Noise along a made-up drive; the same stretches of time have the same labels."""
    rng = np.random.default_rng(seed)
    t = np.tile(np.arange(0.0, FEATURE_SECONDS, step), recordings)
    recording = np.repeat(np.arange(recordings), len(t) // recordings)
    features = {name: smooth(rng, t, forgets) for name, forgets in {
        "speed": 3.0, "steering_angle": 1.0, "throttle": 2.0, "x": 5.0, "y": 5.0}.items()}
    heading = np.cumsum(features["steering_angle"]) * step
    way = np.cumsum(2.0 + 0.3 * features["speed"]) * step
    features |= {"time": t, "way": way, "heading": heading % (2.0 * np.pi) - np.pi,
                 "revolution_angle": way / 0.0413 % 1.0,
                 "direction": np.sign(features["steering_angle"])}
    y = np.stack([smooth(rng, t, memory) for _ in channels], axis=1)
    return ResidualGroup(channels, y, np.full(y.shape, 0.02), features,
                 recording * 100_000 + (t // 2.0).astype(np.int64), recording,
                 tuple(f"day/{k}.csv" for k in range(recordings)))


def windows(seed, **how):
    return group(MOTION, 0.5, seed, **how)


def messages(seed, **how):
    return group(SENSORS, 0.1, seed, **how)


def plant_structure(residuals, channel, curve, share=0.25):
    """With ``share`` of the variance of a channel from a function of the features."""
    shape = curve(residuals.features)
    y = residuals.y.copy()
    i = residuals.channels.index(channel)
    y[:, i] = (np.sqrt(1.0 - share) * y[:, i]
               + np.sqrt(share) * (shape - shape.mean()) / shape.std())
    return replace(residuals, y=y)


@pytest.mark.slow
def test_noise_is_no_structure():
    fired = [seed for seed in range(20)
             if find_group_structure([windows(seed, memory=0.15)], seed)]
    assert len(fired) <= 1


@pytest.mark.long
@pytest.mark.parametrize("memory", [0.0, 0.15])
def test_noise_is_no_structure_in_one_of_a_hundred(memory):
    fired = [seed for seed in range(200)
             if find_group_structure([windows(seed, memory=memory), messages(seed, memory=memory)],
                                     seed)]
    assert len(fired) <= 6  # 2 expected; more than 6 in one of 200


@pytest.mark.parametrize(("make", "channel", "curve", "feature"), [
    (windows, "v_x", lambda f: f["speed"], {("speed",)}),
    (windows, "v_x", lambda f: np.exp(-((f["speed"] - 0.5) / 0.5)**2), {("speed",)}),
    (windows, "omega", lambda f: f["throttle"] * f["steering_angle"],
     {("steering_angle", "throttle"), ("throttle", "direction")}),
    (windows, "v_x", lambda f: 1.0 * (f["steering_angle"] > 0.0),
     {("direction",), ("steering_angle",)}),
    (windows, "v_y", lambda f: np.sin(f["heading"] + 1.0), {("heading",)}),
    (windows, "v_x", lambda f: 1.0 * ((f["x"] > 0.0) & (f["y"] > 0.0)), {("x", "y")}),
    (windows, "v_x", lambda f: f["time"], {("time",)}),
    (messages, "encoder", lambda f: np.sin(2.0 * np.pi * (f["revolution_angle"] + 0.2)),
     {("revolution_angle",)}),
    (windows, "v_x", lambda f: np.sin(2.0 * np.pi * f["way"] / 1.3 + 2.0), {("way",)}),
    (messages, "gyro", lambda f: np.abs(f["steering_angle"]), {("steering_angle",)}),
])
@pytest.mark.slow
def test_what_is_planted_is_found_where_it_is(make, channel, curve, feature):
    found = find_group_structure([plant_structure(make(5), channel, curve, 0.4)], 1)
    assert [u.channel for u in found] == [channel]
    assert found[0].along in feature
    assert found[0].p_value <= 0.01
    assert 0.15 < found[0].share < 0.5  # what is predicted is a part of what is there
    assert channel in found[0].structure
    assert found[0].along[0] in found[0].structure


@pytest.mark.parametrize("curve", [lambda f: f["speed"],
                                   lambda f: np.sin(2.0 * np.pi * f["way"] / 1.3)])
@pytest.mark.slow
def test_the_same_structure_with_the_signs_of_stretches_turned_is_noise(curve):
    """The negative control: as large, as smooth, but it follows no function of the features."""
    residuals = plant_structure(windows(5), "v_x", curve, 0.6)
    assert find_group_structure([residuals])
    _, stretch = np.unique(residuals.block, return_inverse=True)
    signs = np.random.default_rng(3).choice([-1.0, 1.0], stretch.max() + 1)
    assert not find_group_structure([replace(residuals, y=residuals.y * signs[stretch][:, None])])


@pytest.mark.slow
def test_waves_have_their_length_and_size_and_in_each_recording_a_phase_of_its_own():
    residuals = windows(6, recordings=3)
    phase = np.array([0.3, 2.1, 4.0])[residuals.recording]
    wave = 0.8 * np.sin(2.0 * np.pi * residuals.features["way"] / 0.9 + phase)
    found, = find_group_structure([replace(residuals,
                                           y=residuals.y + np.outer(wave, [1.0, 0.0, 0.0]))])
    assert (found.channel, found.along) == ("v_x", ("way",))
    assert found.period == pytest.approx(0.9, rel=0.01)
    assert "every 0.90 m" in found.structure
    size = float(found.structure.split("+-")[1].split()[0])
    assert size == pytest.approx(0.8 * residuals.size[0, 0], rel=0.15)


@pytest.mark.slow
def test_stripes_on_the_floor_have_their_width_and_in_all_recordings_the_same_place():
    residuals = windows(6, recordings=3)
    x = {**residuals.features, "x": 4.0 * np.sin(0.11 * np.arange(len(residuals.y)))}
    stripes = 0.8 * np.sin(2.0 * np.pi * x["x"] / 1.1)
    shifted = 0.8 * np.sin(2.0 * np.pi * x["x"] / 1.1 + 2.0 * np.pi / 3.0 * residuals.recording)
    striped = residuals.y + np.outer(stripes, [1.0, 0.0, 0.0])
    found, = find_group_structure([replace(residuals, features=x, y=striped)])
    assert (found.channel, found.along) == ("v_x", ("x",))
    assert found.period == pytest.approx(1.1, rel=0.03)
    assert "m along x of the room" in found.structure
    elsewhere = find_group_structure([replace(residuals, features=x,
                                              y=residuals.y + np.outer(shifted, [1.0, 0.0,
                                                                                                        0.0]))])
    assert ("x",) not in [u.along for u in elsewhere]


@pytest.mark.slow
def test_a_car_that_hardly_moves_has_no_waves():
    residuals = windows(6)
    hardly_moving = {**residuals.features, "way": 1e-3 * residuals.features["time"]}
    assert find_group_structure([replace(residuals, features=hardly_moving)]) == ()


@pytest.mark.slow
def test_a_level_of_each_recording_is_called_that():
    level = np.array([1.0, -1.0, 0.3, -0.3])
    residuals = windows(7, recordings=4)
    levels = residuals.y + np.outer(level[residuals.recording], [1.0, 0.0, 0.0])
    found = find_group_structure([replace(residuals, y=levels)])
    assert [(u.channel, u.along) for u in found] == [("v_x", ("recording",))]
    assert "at recording day/0.csv" in found[0].structure, "by name: the order of files is ours"


@pytest.mark.slow
def test_what_does_not_carry_over_to_another_recording_is_not_found_along_a_variable():
    residuals = windows(8, recordings=4)
    turns = np.array([1.0, -1.0, 1.0, -1.0])[residuals.recording]
    carried = plant_structure(residuals, "v_x", lambda f: f["speed"])
    not_carried = plant_structure(residuals, "v_x", lambda f: f["speed"] * turns)
    assert ("speed",) in [u.along for u in find_group_structure([carried])]
    assert ("speed",) not in [u.along for u in find_group_structure([not_carried])]


@pytest.mark.slow
def test_share_falls_to_nothing_with_the_cause():
    noise = windows(9)
    before = explained_shares([plant_structure(noise, "omega",
                                               lambda f: f["speed"] * f["steering_angle"],
                                               0.5)])
    after = explained_shares([noise])
    assert 0.25 < before["omega"] < 0.6
    assert max(after.values()) < 0.06
    assert set(before) == set(MOTION)


@pytest.mark.slow
def test_same_seed_same_answer_and_too_little_gives_none():
    residuals = plant_structure(windows(5), "v_x", lambda f: f["speed"], 0.6)
    assert find_group_structure([residuals], 4) == find_group_structure([residuals], 4)
    short = residuals.block < np.unique(residuals.block)[8]
    few = replace(residuals, y=residuals.y[short], block=residuals.block[short],
                  recording=residuals.recording[short],
                  features={k: v[short] for k, v in residuals.features.items()})
    assert find_group_structure([few]) == ()
    assert set(explained_shares([few]).values()) == {0.0}


def test_both_ways_to_turn_signs_agree():
    draw = np.random.default_rng(2)
    block = np.repeat(np.arange(12), 5)
    signs = draw.choice([-1.0, 1.0], (40, 12))
    sums = draw.standard_normal((2, 12, 3))
    fold = np.arange(12) % 4
    columns = draw.standard_normal((len(block), 3))
    grams = [columns[fold[block] == k].T @ columns[fold[block] == k] for k in range(4)]
    folds = [(a, np.linalg.inv(sum(grams) - a + np.eye(3)), fold == k)
             for k, a in enumerate(grams)]
    one, other = (way(sums, folds, signs) for way in (crossfit._by_form, crossfit._by_fold))
    assert one == pytest.approx(other, rel=1e-9)
    assert np.ptp(one) > 0.1
