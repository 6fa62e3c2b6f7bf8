"""The right answer taken off the list: no other name may be said with confidence instead."""

from __future__ import annotations

import pytest
from stranger import Car
from stranger_causes import SIZES, hide
from stranger_files import Habits, pair

from dart_hal.diagnose import diagnose
from dart_hal.diagnose.fit import refit
from dart_hal.diagnose.inputs import effects_named
from dart_hal.diagnose.noise import measure
from dart_hal.diagnose.run import evidence_of
from dart_hal.diagnose.scan import scan
from dart_hal.diagnose.space import Space, Timing
from dart_hal.recording.dart import read
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.load import find_model

LARGE = 2
SHOWN = {  # what is hidden: (channels, variables) of which one must be said to be unexplained
    "road_slope_x": ({"v_x", "v_y"}, {"heading"}),
    "mocap_yaw": ({"v_y"}, {"speed"}),
    "gyro_scale": ({"gyro"}, {"lateral_acceleration", "steering_angle", "direction"}),
    "steering_gain": ({"omega", "v_y"}, {"steering_angle", "direction", "lateral_acceleration"}),
    "lateral_pull": ({"omega", "v_y"}, {"speed"}),
    "mocap_offset_x": ({"v_y"}, {"steering_angle", "direction"}),
    "mocap_offset_y": ({"v_x", "encoder"}, {"lateral_acceleration", "steering_rate", "direction"}),
    "encoder_slip": ({"encoder"}, {"throttle"}),
    "encoder_latency": ({"encoder"}, {"throttle"})}
LEVEL = ("steering_trim", "gyro_bias", "imu_pitch", "imu_roll", "load_transfer", "imu_lever_arm")
"""What moves a whole channel to one side, or hardly shows: without its name there is silence."""
BY_DEFAULT = ("road_slope_x", "mocap_yaw", "gyro_scale")
RELATIVES = tuple(n for n in SIZES if n not in SHOWN and n not in LEVEL)


def files(folder, name, seed):
    car = Car()
    hide(car, name, SIZES[name][LARGE])
    return [read(p) for p in pair(folder, car, Habits(), (60.0, 30.0), seed)]


def asked(recordings, only=()):
    model, vehicle = find_model("paper")
    train, test = recordings
    return diagnose(model, vehicle, [train], [test], refit=False, only=only)


def gain_of(recording, name):
    """What the right name would take away of the loss."""
    seen, _ = evidence_of([recording], PAPER.body.l_r)
    noise = measure(seen.residuals(PAPER), seen.blocks(2.0))
    exact = Space(PAPER, ())
    point = refit(seen, noise, exact, exact.point(Timing()))
    return scan(seen, noise, point, [name])[0].gain


def by_default(names):
    return [n if n in BY_DEFAULT else pytest.param(n, marks=pytest.mark.slow) for n in names]


@pytest.mark.parametrize("name", by_default(SHOWN))
def test_what_nothing_else_is_like_ends_unexplained(tmp_path, name):
    recordings = files(tmp_path, name, 7)
    without = asked(recordings, effects_named((), (name,)))
    assert without.verdict == "unexplained"
    assert without.causes == ()
    channels, variables = SHOWN[name]
    assert any(u.channel in channels and variables & set(u.along) for u in without.unexplained)
    assert max(without.ranking.values()) < 0.5 * gain_of(recordings[0], name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LEVEL)
def test_what_only_moves_a_level_ends_in_silence(tmp_path, name):
    """A constant is no structure: nothing is named, but nothing is shown either."""
    recordings = files(tmp_path, name, 7)
    without = asked(recordings, effects_named((), (name,)))
    assert without.causes == ()
    assert max(without.ranking.values()) < 0.5 * gain_of(recordings[0], name)


@pytest.mark.slow
@pytest.mark.parametrize("name", RELATIVES)
def test_what_takes_the_place_of_a_cause_is_its_relative_and_explains_less(tmp_path, name):
    """Near relatives are named for each other. The first of them must be one that is written down
    as such, or what is left must be said; and it never gains what the right one does."""
    recordings = files(tmp_path, name, 7)
    without = asked(recordings, effects_named((), (name,)))
    known = catalogue()
    for cause in without.causes[:1]:
        relative = (cause.effect in known[name].confused_with
                    or name in known[cause.effect].confused_with)
        assert relative or without.unexplained, cause.effect
        assert without.ranking[cause.effect] < gain_of(recordings[0], name)
