"""Reading and writing the files of a car: laws."""

from __future__ import annotations

import os
import shutil
from datetime import datetime, timezone
from itertools import accumulate
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.config import (
    Calibration,
    EffectEntry,
    ModelFile,
    Quantities,
    Quantity,
    SteeringTable,
    cars_home,
    dump,
    load_car,
    parse_calibration,
    parse_car,
    parse_config,
    parse_model,
    save,
    save_calibration,
)
from dart_hal.core.config.write import merge
from dart_hal.core.errors import ConfigError

EXAMPLE_CAR = Path(__file__).parents[3] / "cars" / "dart-01" / "car.toml"
finite = st.floats(-1e6, 1e6, allow_nan=False)
positive = st.floats(1e-6, 1e6)
plain_letters = st.characters(exclude_categories=["Cc", "Cs"])
quantity = st.builds(Quantity, finite, st.floats(0, 1e6), st.text(plain_letters, max_size=20))


@st.composite
def maps(draw: st.DrawFn) -> SteeringTable:
    n = draw(st.integers(2, 12))
    steps = st.lists(st.floats(1e-3, 0.1), min_size=n, max_size=n)
    sign = draw(st.sampled_from((1.0, -1.0)))
    pulses = accumulate(draw(steps), initial=10.0)
    angles = accumulate(draw(steps), initial=-0.6)
    return SteeringTable(pulse_us=tuple(100 * p for p in pulses),
                         angle_rad=tuple(sign * a for a in angles),
                         std_rad=(0.0, *draw(steps)))


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    blank = Calibration(car=draw(st.sampled_from(["a", "dart-01", 'x"y'])),
                        provenance=draw(st.dictionaries(st.sampled_from(["log", "n", "fit"]), (
                            st.text(max_size=9, alphabet="ab #\"'=") | finite))))
    values: dict[str, Quantity | Quantities] = {
        "pwm.oscillator_hz": Quantity(draw(st.floats(22e6, 28e6)), draw(st.floats(1.0, 1e5))),
        "imu.gyro_bias": Quantity(draw(st.floats(-10.0, 10.0)), draw(st.floats(0, 1e6)),
                                  draw(st.text(plain_letters, max_size=20))),
        "encoder.ring": Quantities((0.5, 1.5, 1.0), draw(positive))}
    kept = draw(st.sets(st.sampled_from(sorted(values))))
    filled = blank.with_quantities({k: v for k, v in values.items() if k in kept})
    steering = msgspec.structs.replace(filled.steering, map=draw(st.none() | maps()))
    return msgspec.structs.replace(filled, steering=steering)


models = st.builds(
    ModelFile, name=st.sampled_from(["paper", "fit 3"]), kind=st.sampled_from(["dynamic"]),
    body=st.fixed_dictionaries({"wheelbase": finite | quantity}),
    friction=st.dictionaries(st.sampled_from(["a", "b", "c", "q"]), finite | quantity),
    effects=st.lists(st.builds(EffectEntry, st.sampled_from(["drag", "lag"]),
                               st.dictionaries(st.sampled_from(["k", "T"]), finite | quantity)),
                     max_size=3).map(tuple))


@given(calibrations())
def test_a_calibration_that_was_written_reads_the_same(cal: Calibration) -> None:
    assert parse_calibration(dump(cal), "x", cal.car) == cal


@pytest.mark.slow
@given(calibrations(), calibrations())
def test_writing_over_an_older_calibration_leaves_nothing_of_it(old, new) -> None:
    assert parse_calibration(merge(dump(old), new), "x", new.car) == new


@given(models, models)
def test_a_model_that_was_written_reads_the_same(old: ModelFile, new: ModelFile) -> None:
    assert parse_model(dump(new), "x") == new
    assert parse_model(merge(dump(old), new), "x") == new


def test_the_example_car_reads_and_writing_it_back_changes_nothing() -> None:
    text = EXAMPLE_CAR.read_text(encoding="utf-8")
    car = parse_config(text, str(EXAMPLE_CAR))
    assert merge(text, car) == text
    assert parse_config(dump(car), "x") == car


def test_a_changed_value_keeps_every_comment() -> None:
    text = EXAMPLE_CAR.read_text(encoding="utf-8")
    car = parse_config(text, "x")
    limits = msgspec.structs.replace(car.limits, max_throttle=0.25)
    changed = merge(text, msgspec.structs.replace(car, limits=limits))
    assert parse_config(changed, "x").limits.max_throttle == 0.25
    assert [line.partition("#")[2] for line in changed.splitlines()] == \
        [line.partition("#")[2] for line in text.splitlines()]


def test_saving_keeps_the_previous_files_in_history_and_no_other_traces(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    blank = Calibration(car="a")
    for hertz in (25.0e6, 25.1e6, 25.2e6, 25.2e6):
        save_calibration(blank.with_quantities({"pwm.oscillator_hz": Quantity(hertz, 1e4)}),
                         folder)
    names = sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
    assert names == ["calibration.toml", "history/calibration-0001.toml",
                     "history/calibration-0002.toml"]
    first = parse_calibration((folder / names[1]).read_text(encoding="utf-8"), "x")
    assert first.pwm.oscillator_hz == Quantity(25.0e6, 1e4)


def test_a_calibration_that_breaks_its_own_laws_is_not_written(tmp_path: Path) -> None:
    wrong = Calibration(car="a").with_quantities({"pwm.oscillator_hz": Quantity(1.0, 0.1)})
    with pytest.raises(ConfigError):
        save_calibration(wrong, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch) -> None:
    path = save(Calibration(car="a"), tmp_path / "calibration.toml")
    before = path.read_text(encoding="utf-8")
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        save(Calibration(car="b"), path)
    assert path.read_text(encoding="utf-8") == before


@pytest.fixture
def places(tmp_path: Path, monkeypatch) -> dict[str, Path]:
    names = {"given": tmp_path / "given", "named": tmp_path / "named",
             "here": tmp_path / "cars", "own": tmp_path / "share" / "dart-hal" / "cars"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    monkeypatch.setenv("DART_CARS", str(names["named"]))
    text = EXAMPLE_CAR.read_text(encoding="utf-8")
    for name, folder in names.items():
        (folder / "dart-01").mkdir(parents=True)
        mass = {"given": 1.1, "named": 1.2, "here": 1.3, "own": 1.4}[name]
        (folder / "dart-01" / "car.toml").write_text(text.replace("1.67", str(mass)),
                                                     encoding="utf-8")
    return names


def test_folders_are_searched_in_order(places, monkeypatch) -> None:
    def mass(dirs: list[Path] | None) -> float:
        return load_car("dart-01", dirs).config.geometry.mass

    assert mass([places["given"]]) == 1.1
    assert mass(None) == 1.2
    monkeypatch.delenv("DART_CARS")
    assert mass(None) == 1.3
    assert cars_home() == Path("cars")
    (places["here"] / "dart-01" / "car.toml").unlink()
    assert mass(None) == 1.4


def test_measurements_go_to_the_folder_that_was_named(places, tmp_path, monkeypatch) -> None:
    """--cars, else $DART_CARS, else ./cars, else the home folder; for real and simulated cars."""
    other = tmp_path / "other"
    text = EXAMPLE_CAR.read_text(encoding="utf-8")
    for load in (lambda dirs=None: load_car("dart-01", dirs),
                 lambda dirs=None: parse_car(text, "sim://", dirs)):
        assert load([other]).folder == other / "dart-01"
        assert load([other, places["given"]]).folder == places["given"] / "dart-01"
        assert load().folder == places["named"] / "dart-01"
    monkeypatch.setenv("DART_CARS", f"{other}{os.pathsep}{places['named']}")
    assert load_car("dart-01").folder == places["named"] / "dart-01"
    assert parse_car(text.replace("dart-01", "sim-7"), "sim://").folder == other / "sim-7"
    monkeypatch.delenv("DART_CARS")
    assert parse_car(text, "sim://").folder == Path("cars") / "dart-01"
    shutil.rmtree(places["here"] / "dart-01")
    assert parse_car(text, "sim://").folder == places["own"] / "dart-01"
    shutil.rmtree(places["own"] / "dart-01")
    assert parse_car(text, "sim://").folder == Path("cars") / "dart-01"
    shutil.rmtree(places["here"])
    assert parse_car(text, "sim://").folder == places["own"] / "dart-01"


def test_measurements_of_another_folder_are_not_read(places, tmp_path) -> None:
    quantities = {"throttle.neutral_us": Quantity(1510.0, 2.0)}
    save_calibration(Calibration(car="dart-01").with_quantities(quantities),
                     places["named"] / "dart-01")
    assert load_car("dart-01").neutral_us == 1510.0
    assert load_car("dart-01", [tmp_path / "other"]).neutral_us == 1500.0


def test_the_calibration_wins_over_the_car_file(places) -> None:
    folder = places["named"] / "dart-01"
    files = load_car("dart-01")
    assert files.oscillator_hz is None
    assert (files.neutral_us, files.imu_mount) == (1500.0, (0.0, 0.0, 0.0))
    save_calibration(Calibration(car="dart-01").with_quantities({
        "pwm.oscillator_hz": Quantity(25.2e6, 1e4), "throttle.neutral_us": Quantity(1510.0, 2.0),
        "imu.mount_yaw": Quantity(0.1, 0.01)}), folder)
    files = load_car("dart-01")
    assert files.oscillator_hz == Quantity(25.2e6, 1e4)
    assert (files.neutral_us, files.imu_mount) == (1510.0, (0.1, 0.0, 0.0))
    given = parse_car(EXAMPLE_CAR.read_text(encoding="utf-8"), "sim://")
    assert given.folder == folder
    assert given.oscillator_hz == files.oscillator_hz


def test_a_map_that_steers_against_car_toml_is_refused(places) -> None:
    table = SteeringTable(pulse_us=(1200.0, 1800.0), angle_rad=(0.3, -0.3), std_rad=(0.1, 0.1))
    cal = Calibration(car="dart-01")
    steering = msgspec.structs.replace(cal.steering, map=table)
    save_calibration(msgspec.structs.replace(cal, steering=steering),
                     places["named"] / "dart-01")
    with pytest.raises(ConfigError, match="the other way"):
        load_car("dart-01")


def test_old_and_foreign_firmware_are_warned_about() -> None:
    when = datetime(2026, 1, 1, tzinfo=timezone.utc)
    cal = Calibration(car="a", provenance={"when": when, "firmware": "sha256:1"})
    assert cal.warnings(datetime(2026, 2, 1, tzinfo=timezone.utc), "sha256:1") == ()
    assert cal.warnings(datetime(2027, 1, 1, tzinfo=timezone.utc), "sha256:2") == \
        ("CALIBRATION_OLD", "FIRMWARE_CHANGED")


def test_every_quantity_can_be_set_and_read_by_its_name() -> None:
    from dart_hal.core.config import QUANTITIES
    for name in QUANTITIES:
        value = Quantities((1.0,), 0.1) if name == "encoder.ring" else Quantity(1.0, 0.1)
        assert Calibration(car="a").with_quantities({name: value}).quantities() == {name: value}
    with pytest.raises(ConfigError, match="no quantity"):
        Calibration(car="a").with_quantities({"pwm.hertz": Quantity(1, 1)})


def test_the_example_car_is_there_outside_the_sources_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert load_car("dart-01").config.name == "dart-01"
    with pytest.raises(ConfigError, match="no car gone") as refused:
        load_car("gone", [Path("cars")])
    assert refused.value.expected.count("cars,") == 1
    source = refused.value.remedy.partition("; cp ")[2].split()[0]
    assert Path(source).is_file()
