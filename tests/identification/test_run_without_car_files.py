"""A run whose car files are missing is read with those of another car, and that is reported."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from dart_hal.car import Car
from dart_hal.car.runs import NamedCar, read_any
from dart_hal.recording.check import check

ROOT = Path(__file__).resolve().parents[2]
CARS = str(ROOT / "cars")


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> tuple[Path, Path]:
    """(a run, the same without its attachments and metadata)."""
    folder = tmp_path_factory.mktemp("runs")
    whole, bare = folder / "whole.mcap", folder / "bare.mcap"
    with Car.open("sim://?seed=3&nano=mock", record=whole) as car:
        car.arm()
        for k, _ in zip(range(300), car.states(), strict=False):
            car.drive(steering=0.2 if k % 100 < 50 else -0.2, throttle=0.2)
    with whole.open("rb") as source, bare.open("wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in channels:
                if schema is not None and schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding,
                                                                schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding,
                    schemas[schema.id] if schema is not None else 0, channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data,
                               message.publish_time, message.sequence)
        writer.finish()
    return whole, bare


def about_files(recording) -> list[str]:
    return [note.why for note in recording.notes if note.kind == "car_files"]


@pytest.mark.slow
def test_run_without_car_files_states_whose_are_used(runs):
    whole, bare = runs
    complete = read_any([whole])[0][0]
    assert about_files(complete) == [], "negative control: the run with its attachments"
    found = read_any([bare], car=NamedCar("dart-01", CARS))[0][0]
    (note,) = about_files(found)
    assert "holds no files of its car" in note
    assert "dart-01" in note
    assert any(f.kind == "car_files" and f.serious for f in check(found).findings)


@pytest.mark.slow
def test_replay_of_a_run_without_car_files_gives_a_notice(runs):
    with Car.open(f"replay://{runs[1]}", cars=CARS) as car:
        assert any("holds no files of its car" in notice for notice in car.notices)
    with Car.open(f"replay://{runs[0]}", cars=CARS) as car:
        assert not any("holds no files" in notice for notice in car.notices)


@pytest.mark.slow
def test_named_car_is_the_one_whose_files_are_used(runs, tmp_path):
    folder = tmp_path / "other"
    folder.mkdir()
    text = (ROOT / "cars" / "dart-01" / "car.toml").read_text()
    (folder / "car.toml").write_text(text.replace('name = "dart-01"', 'name = "other"'))
    found = read_any([runs[1]], car=NamedCar("other", str(tmp_path)))[0][0]
    assert found.car.name == "other"
    assert "those of other" in about_files(found)[0]
