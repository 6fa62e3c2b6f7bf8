"""Recordings of two cars without names are found before a fit; those of one car never alarm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from dart_hal.car.runs import read_any
from dart_hal.core.errors import RecordingError
from dart_hal.recording.check import check, summary
from dart_hal.recording.dart.model import freeze
from dart_hal.recording.dart.one_car import (
    caution_several_cars,
    find_car_difference,
    refuse_several_cars,
)
from dart_hal.recording.dart.response import (
    DELAYS,
    LAGS,
    STEP,
    _filter_command,
    _range,
    _windows,
    measure_response,
)
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.sets import PAPER
from dart_lab.cli.data import check_command
from dart_lab.cli.identify import command as identify_command
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.importing import read_tables
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read
from studies.diagnosis.mixed_cars import halve, read_responses
from studies.diagnosis.other_car import write_log
from tests.common import EXCERPT
from tests.recorded.test_effects_hidden_in_another_cars_log import LOG

# The same car on another day: another trim, floor and battery.
OTHER_DAY = {"steering_trim": -0.03, "grip": -0.25, "motor_gain": -0.1}


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """drive(seed, **effects): 40 s of that car, made once."""
    folder = tmp_path_factory.mktemp("cars")
    made = {}

    def drive_once(seed, **effects):
        key = (seed, *sorted(effects.items()))
        if key not in made:
            p = PAPER
            for name, k in effects.items():
                p = apply(p, name, k=k)
            path = folder / f"{len(made)}.csv"
            made[key] = read(hidden_drive.write(path, p, seed=seed,
                                                plan=hidden_drive.Plan(seconds=40.0)))
        return made[key]

    return drive_once


def scale_sensors(recording, speed=1.0, throttle=1.0):
    """The recording with another scale of the encoder or of the throttle command."""
    m = recording.messages
    return replace(recording, messages=replace(
        m, speed=freeze(m.speed * speed), throttle=freeze(m.throttle * throttle)))


def name_car(recording):
    return replace(recording, car=SimpleNamespace(name="red", geometry=PAPER.body))


@pytest.mark.slow
def test_cars_that_steer_differently_are_refused_by_groups(drive):
    ours = [drive(1), drive(2, **OTHER_DAY)]
    theirs = [drive(3, steering_gain=-0.45), drive(4, steering_gain=-0.45)]
    with pytest.raises(RecordingError) as caught:
        refuse_several_cars([ours[0], theirs[0], ours[1], theirs[1]])
    assert "two cars" in caught.value.what
    assert "same steering command" in caught.value.found
    found = find_car_difference([ours[0], theirs[0], ours[1], theirs[1]])
    groups = [{r.name for r in ours}, {r.name for r in theirs}]
    assert {frozenset(found.first), frozenset(found.second)} == set(map(frozenset, groups))
    ratio = 1.0 + found.size if found.first[0] in groups[0] else 1.0 / (1.0 + found.size)
    assert ratio == pytest.approx(0.55, abs=3.0 * found.error)


@pytest.mark.slow
def test_one_car_with_another_trim_floor_and_battery_is_not_two(drive):
    refuse_several_cars([drive(1), drive(2, **OTHER_DAY), drive(3), drive(4, **OTHER_DAY)])


@pytest.mark.parametrize(("change", "kind"), [({"speed": 1.5}, "encoder"),
                                              ({"throttle": 4.0}, "throttle_poses")])
def test_another_scale_of_encoder_or_throttle_is_found(drive, change, kind):
    found = find_car_difference([drive(1), scale_sensors(drive(2, **OTHER_DAY), **change)])
    assert found is not None
    assert found.kind == kind


@pytest.mark.slow
def test_two_cars_are_found_by_their_own_sensors(drive):
    recordings = (drive(1), drive(3, steering_gain=-0.5), drive(2, **OTHER_DAY))
    ours, theirs, other_day = (replace(r, mocap=None) for r in recordings)
    assert find_car_difference([ours, theirs]).kind == "steering_sensors"
    # The scale of an encoder by itself may differ between days.
    assert find_car_difference([ours, scale_sensors(other_day, speed=1.25)]) is None


@pytest.mark.slow
def test_recordings_that_state_one_car_are_only_cautioned(drive):
    named = [name_car(drive(1)), name_car(drive(3, steering_gain=-0.45))]
    refuse_several_cars(named)
    (caution,) = caution_several_cars(named)
    assert "two cars" in caution
    assert caution_several_cars([name_car(drive(1)), name_car(drive(2, **OTHER_DAY))]) == ()
    assert caution_several_cars([drive(1), drive(3, steering_gain=-0.45)]) == (), "not stated"


@pytest.mark.slow
def test_standing_or_short_recordings_cannot_be_compared(drive):
    still = replace(drive(1), messages=replace(
        drive(1).messages, speed=freeze(np.zeros(len(drive(1).messages)))), mocap=None)
    assert measure_response(still).curves == {}
    assert find_car_difference([still, drive(2)]) is None
    assert find_car_difference([drive(2)]) is None
    assert find_car_difference([]) is None


@pytest.mark.slow
def test_published_excerpts_are_of_one_car_and_another_laboratory_s_is_not():
    excerpts, _ = read_any([EXCERPT])
    assert find_car_difference(excerpts) is None
    theirs, _ = read_any([LOG])
    with pytest.raises(RecordingError, match="two cars"):
        refuse_several_cars([*excerpts, *theirs])
    with pytest.raises(RecordingError, match="two cars"):
        check_inputs([*excerpts, *theirs], [], PAPER)


@pytest.mark.slow
def test_verbs_state_two_cars():
    answer = CliRunner().invoke(check_command, [str(EXCERPT), str(LOG)])
    assert answer.exit_code == 0
    assert "recordings of two cars" in answer.output
    alone = CliRunner().invoke(check_command, [str(EXCERPT)])
    assert "two cars" not in alone.output, "negative control"
    refused = CliRunner().invoke(identify_command, ["all", "--dry-run", str(EXCERPT), str(LOG)])
    assert isinstance(refused.exception, RecordingError)


def test_summary_of_a_check_has_the_note(drive):
    both = [check(drive(1)), check(drive(3, steering_gain=-0.45))]
    assert any("two cars" in note for note in summary(both).notes)
    assert not any("two cars" in note for note in summary(both[:1]).notes)


@pytest.mark.slow
def test_no_real_car_alarms_in_all_its_recordings(recordings, other_cars):
    """Controls: 88 recordings of the published car, in which floors, trims and encoders change."""
    from dart_hal.recording.dart.response import compare_responses

    dart = read_responses(recordings) + read_responses(other_cars / "dart_unused")
    f1tenth = read_responses(other_cars / "f1tenth_upenn2022")
    zheng, _ = read_any([other_cars / "zheng2022" / "day1.csv.gz"])
    assert compare_responses(dart) is None
    assert compare_responses(f1tenth) is None
    assert compare_responses(halve(zheng)) is None
    assert compare_responses([*dart, *f1tenth]) is not None
    assert compare_responses([*dart, *halve(zheng)]) is not None
    assert compare_responses([*f1tenth, *halve(zheng)]) is not None


@pytest.mark.slow
def test_filters_of_the_response_are_those_of_scipy():
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
    from scipy.signal import lfilter

    values = np.random.default_rng(8).normal(size=200)
    for size in (4, 5):
        mean = _windows(values, size // 2, size - 1 - size // 2).mean(axis=1)
        assert mean == pytest.approx(uniform_filter1d(values, size))
        origin = (size - 1) // 2
        assert _range(values, size * STEP) == pytest.approx(
            maximum_filter1d(values, size, origin=origin)
            - minimum_filter1d(values, size, origin=origin))
    # a curvature that follows a command by a delay and a lag is found as that command
    delay, lag = DELAYS[-1], LAGS[-1]
    late = np.concatenate([np.full(delay, values[0]), values[:len(values) - delay]])
    keep = np.exp(-STEP / lag)
    follows, _ = lfilter([1.0 - keep], [1.0, -keep], late, zi=[keep * late[0]])
    use = np.ones(len(values), dtype=np.bool_)
    assert _filter_command(values, 0.3 + follows, use) == pytest.approx(follows)


@pytest.mark.slow
@pytest.mark.parametrize("trim", [-0.2, 0.16])
def test_parts_of_one_log_with_a_large_trim_are_of_one_car(tmp_path, trim):
    """At the command 0 such a car turns: curvature over command is no measure of its gain."""
    (table,) = read_tables([LOG])
    (whole,), _ = read_any([write_log(dict(table.columns), tmp_path / "log.mcap")])
    columns = {key: values[1500:7500] for key, values in table.columns.items()}
    columns["steering"] = np.clip(columns["steering"] - trim, -1.0, 1.0)
    frame = replace(whole.marker, source="stated", std=None)
    parts = [write_log({key: values[rows] for key, values in columns.items()}, tmp_path / file)
             for file, rows in (("a.mcap", slice(0, 3600)), ("b.mcap", slice(3600, None)))]
    assert find_car_difference(read_any(parts, reference=frame)[0]) is None


@pytest.mark.slow
def test_cars_with_a_large_trim_that_steer_differently_are_two(drive):
    ours = [drive(1, steering_trim=0.12), drive(2, steering_trim=0.1)]
    assert find_car_difference(ours) is None
    theirs = drive(3, steering_trim=0.12, steering_gain=-0.45)
    assert find_car_difference([*ours, theirs]).kind.startswith("steering")
