"""One file of all cars: each is read back as if it had a file of its own, on one time base."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader

from dart_hal.car import Car, Fleet
from dart_hal.car.table import read_table
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.recording.mcap_records import read_mcap
from dart_hal.recording.run import RunReader
from dart_hal.recording.run_file import RunFile, select_car

RECORDED_URLS = ["sim://?seed=1&nano=mock", "sim://?seed=2&nano=mock"]


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """(file of both, files of each, States of each) of one drive, recorded in both ways."""
    folder = tmp_path_factory.mktemp("fleet")
    both = folder / "both.mcap"
    single = [folder / "a.mcap", folder / "b.mcap"]
    states = [[], []]
    for record in (both, single):
        with Fleet.open(RECORDED_URLS, record=record) as fleet:
            for car, own_states in zip(fleet.cars, states, strict=True):
                own_states.clear()
                car.on_state(own_states.append)
            for n, now in enumerate(fleet.states(duration=0.5)):
                for car, state in zip(fleet.cars, now, strict=True):
                    car.drive(steering=0.1)
                    if n % 10 == 0:
                        car.log("speed", state.speed)
    return both, single, states


@pytest.mark.slow
@pytest.mark.parametrize("n", [0, 1])
def test_each_car_is_read_back_as_from_its_own_file(drive, n):
    both, single, _ = drive
    one = RunReader(f"{both}?car=sim-{n + 1}")
    alone = RunReader(single[n])
    assert one.meta == alone.meta
    assert one.files == alone.files
    assert one.hello == alone.hello
    for read in ("chunks", "sent", "commands", "applied", "logged", "i2c"):
        mine = list(getattr(one, read)())
        own = list(getattr(alone, read)())
        assert mine == own
        assert mine or read == "i2c"


@pytest.mark.slow
def test_a_replay_sees_the_states_of_the_drive(drive):
    both, _, states = drive
    with Car.open(f"replay://{both}?car=sim-2") as car:
        replayed = list(car.states())
    assert [s.t for s in replayed[-40:]] == [s.t for s in states[1][-40:]]
    assert [s.pose.x for s in replayed[-40:]] == [s.pose.x for s in states[1][-40:]]
    assert len(read_table(f"{both}?car=sim-2")) == len(replayed)


@pytest.mark.slow
def test_channels_begin_with_the_name_and_share_a_time_base(drive):
    found = read_mcap(drive[0])
    assert {"/sim_1/rx", "/sim_1/odom", "/sim_2/rx", "/sim_2/odom"} <= set(found.topics.values())
    ends = [select_car(found, name).extent()[2] for name in ("sim-1", "sim-2")]
    assert abs(ends[0] - ends[1]) < 0.02e9
    stamps = np.array([m.ns for m in found.messages({"/sim_1/odom", "/sim_2/odom"})])
    assert np.diff(stamps).min() > -0.02e9, "in the order of time, but for a tick"


@pytest.mark.slow
def test_naming_no_car_or_another_lists_those_that_are_there(drive):
    both, single, _ = drive
    for name in (both, f"{both}?car=blue"):
        with pytest.raises(RecordingError, match="sim-1, sim-2"):
            RunReader(name)
    with pytest.raises(RecordingError, match="one car"):
        RunReader(f"{single[0]}?car=sim-1")


class SetClock:
    """A computer whose calendar jumps back by an hour at each reading."""

    def __init__(self):
        self.wall = 1_700_000_000 * 10**9

    def time_ns(self):
        self.wall -= 3600 * 10**9
        return self.wall + 3600 * 10**9


def test_clocks_that_began_at_other_times_are_brought_to_one(tmp_path, monkeypatch):
    """Exactly: a replay sees the car's own stamps again."""
    monkeypatch.setattr("dart_hal.recording.run_file.time", SetClock())
    monkeypatch.setattr("dart_hal.recording.run_file.elapsed_ns", lambda: 200 * 10**9)
    from dart_hal.recording.run import RunWriter

    shared = RunFile(tmp_path / "run.mcap")
    t = 1.0 / 3.0
    for now in (103.5, 100.25):  # the second one's clock began 3.25 s later
        with RunWriter(shared, car="red", start=0.1, now=now) as writer:
            writer.rx(b"x", t)
            if now == 103.5:
                first = writer
                keep = RunWriter(shared, car="keep")
    keep.close()
    assert first.path == tmp_path / "run.mcap"
    found = read_mcap(tmp_path / "run.mcap")
    assert set(found.zeros.values()) == {1_699_999_896_500_000_000, 1_699_999_899_750_000_000}
    with (tmp_path / "run.mcap").open("rb") as file:
        stamps = [m.log_time for _, _, m in make_reader(file).iter_messages()]
    assert stamps == [1_699_999_896_833_333_333, 1_699_999_900_083_333_333]
    for name in ("red", "red-2"):
        assert [c.t for c in RunReader(f"{tmp_path / 'run.mcap'}?car={name}").chunks()] == [t]


@pytest.mark.parametrize(("first", "second", "zeros"), [
    (None, 5.0, [0, 0]), (5.0, None, [1_699_999_995 * 10**9] * 2),
    (5.0, 9.0, [1_699_999_995 * 10**9, 1_699_999_991 * 10**9])])
def test_the_first_car_decides_whether_a_file_has_a_calendar(tmp_path, monkeypatch, first, second,
                                                             zeros):
    """Else a virtual car with a real one would be 50 years away."""
    monkeypatch.setattr("dart_hal.recording.run_file.time", SetClock())
    monkeypatch.setattr("dart_hal.recording.run_file.elapsed_ns", lambda: 200 * 10**9)
    shared = RunFile(tmp_path / "run.mcap")
    assert [shared.find_clock_zero(now) for now in (first, second)] == zeros
    shared.close()


def test_an_old_file_is_kept_and_a_fleet_that_does_not_open_leaves_a_whole_one(tmp_path):
    run = tmp_path / "run.mcap"
    run.write_bytes(b"old")
    with pytest.raises(UsageError):
        Fleet.open([RECORDED_URLS[0], "sim://?colour=red"], record=run)
    assert (tmp_path / "run.1.mcap").read_bytes() == b"old"
    assert read_mcap(run).complete


def test_two_cars_of_one_recording_are_refused(tmp_path):
    urls = ["sim://?seed=1&nano=mock", "sim://?seed=2&nano=mock"]
    file = tmp_path / "same.mcap"
    with pytest.raises(UsageError, match="two cars of a fleet have one recording"):
        Fleet.open(urls, record=[file, str(file)])
    assert not file.exists()
