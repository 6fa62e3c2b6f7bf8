"""`calibrate encoder` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.encoder import Taped, calibrate_encoder, travel_per_edge
from dart_hal.calibration.measured import write
from dart_hal.calibration.ring_table import make_ring_table, remove_swing
from dart_hal.calibration.straight import Rolled
from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.ring import LearntRing, RingLearner
from dart_lab.sim.truth import reveal, truth, world_of
from studies.calibration.hidden_errors import off_by

URL = "sim://?nano=mock&seed="


def measured(url, tmp_path, *, alter=lambda backend: None, workshop=None, **options):
    backend = open_backend(url)
    alter(backend)
    with Car.over(backend, cars=tmp_path) as car:
        try:
            return car.files, calibrate_encoder(car, workshop or backend.workshop, **options)
        finally:
            assert car.mode != "RAW"


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(1, 2), range(2, 9), range(9, 10)],
                         ids=["1 car", "7 cars", "car 9"])
@pytest.mark.long_except("1 car", "car 9")
def test_hidden_cars(tmp_path, seeds):
    for seed in seeds:
        _, result = measured(f"{URL}{seed}", tmp_path)
        true = reveal(seed)["sensors"]
        metres = result.quantities["encoder.metres_per_edge"]
        error = metres.value - true["encoder.metres_per_edge"]
        assert abs(error) < 3.0 * metres.std
        assert abs(error) < 0.002 * metres.value
        assert metres.std < 0.001 * metres.value
        ring = result.quantities["encoder.ring"]
        z = off_by(np.array(ring.value), true["encoder.ring"]) / np.array(ring.std)
        assert np.sqrt(np.mean(z**2)) < 1.6
        assert np.max(ring.std) < 0.0001


def swinging(newton):
    """A force on the car, in step with the ring: ``newton`` once a turn and half of it twice."""
    def alter(backend):
        world = world_of(backend)
        motion, turn = world.motion, 0.5 * world.car.gear_revolution / np.pi
        step = motion.step

        def pushed(*held):
            phase = world.distance / turn
            motion.drive.push = newton * (np.cos(phase) + 0.5 * np.sin(2.0 * phase))
            return step(*held)

        motion.step = pushed

    return alter


@pytest.mark.slow
@pytest.mark.parametrize(("speeds", "separated"), [
    ((0.35, 0.5), True), pytest.param((0.35,), False, id="control: one speed")])
def test_an_oscillation_once_per_turn_is_separated_from_the_marks(
        tmp_path, monkeypatch, speeds, separated):
    monkeypatch.setattr("dart_hal.calibration.encoder.ROLL_SPEEDS", speeds)
    _, result = measured(f"{URL}4", tmp_path, alter=swinging(0.04))
    ring = result.quantities["encoder.ring"]
    error = off_by(np.array(ring.value), reveal(4)["sensors"]["encoder.ring"])
    assert (np.sqrt(np.mean((error / np.array(ring.std)) ** 2)) < 1.6) == separated
    assert (np.max(np.abs(error)) < 0.0005) == separated
    assert any("oscillates once per turn" in note for note in result.notes) == separated


@pytest.mark.slow
@pytest.mark.emulator
def test_intervals_of_the_firmware_give_the_ring(tmp_path):
    _, result = measured("sim://?nano=avr&seed=3", tmp_path, distance=1.0, runs=1)
    ring = result.quantities["encoder.ring"]
    z = off_by(np.array(ring.value), reveal(3)["sensors"]["encoder.ring"]) / np.array(ring.std)
    assert np.sqrt(np.mean(z**2)) < 1.6
    assert np.max(ring.std) < 0.001


def test_control_the_drawing_would_be_off():
    """What the cars would have without a calibration misses both targets."""
    true = [reveal(seed)["sensors"] for seed in range(1, 21)]
    drawn = reveal(0)["sensors"]["encoder.metres_per_edge"]
    metres = [abs(t["encoder.metres_per_edge"] / drawn - 1.0) for t in true]
    uneven = [np.std(t["encoder.ring"]) for t in true]
    assert np.mean(np.array(metres) > 0.002) > 0.4
    assert np.min(uneven) > 0.005


@pytest.mark.slow
def test_what_is_written_is_read_and_keeps_what_was_there(tmp_path):
    files, result = measured(f"{URL}3", tmp_path, distance=1.0, runs=1)
    assert result.written is None
    assert not list(tmp_path.rglob("calibration.toml"))
    written = write(files, result)
    with Car.open(f"{URL}3", cars=tmp_path) as car:
        known = car.files.calibration
        assert str(car.files.folder / "calibration.toml") == written.written
    assert known.encoder.metres_per_edge.std == pytest.approx(
        result.quantities["encoder.metres_per_edge"].std, rel=0.01)
    assert len(known.encoder.ring.value) == 20
    assert known.provenance["encoder"]["residual"] == result.residual


@pytest.mark.slow
@pytest.mark.parametrize(("missing", "edges", "message"), [
    ("0.05", 19, r"an interval of 1\.\d\d times the mean: 1 edge"),
    ("0.1", 18, r"an interval of 2\.\d\d times the mean: 2 edge"),
    ("-0.05", 21, r"an interval of 0\.\d\d times the mean: an edge too many")])
def test_missing_and_double_marks_are_named(tmp_path, missing, edges, message):
    with pytest.raises(CalibrationFailed, match=f"{edges} edges per revolution") as caught:
        measured(f"{URL}2&effect=encoder_ring:missing={missing}", tmp_path)
    assert caught.match(message)
    assert f"edges_per_rev = {edges}" in caught.value.remedy


@pytest.mark.slow
@pytest.mark.parametrize(("url", "why"), [
    ("2&fail=enc:off@0s", "encoder does not count"),
    ("2&fail=enc:off@6s", "encoder does not count"), ("2&fail=wheel:stuck@6s", "wheel is blocked"),
    ("2&fail=esc:off@6s", "motor does not answer")])
def test_what_does_not_turn_or_count_is_named(tmp_path, url, why):
    with pytest.raises(CalibrationFailed, match=why):
        measured(URL + url, tmp_path)
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_steering_that_answers_the_other_way_is_noticed(tmp_path):
    def turn_round(backend):
        backend.car_toml = backend.car_toml.replace("[steering]", "[steering]\ndirection = -1")

    with pytest.raises(CalibrationFailed, match="does not keep a straight line"):
        measured(f"{URL}2", tmp_path, alter=turn_round)


class Tape:
    """The simulated workshop, read wrong."""

    def __init__(self, workshop, misread) -> None:
        self.mark, self._true, self._misread = workshop.mark, workshop.distance, misread

    def distance(self) -> float:
        return self._misread.pop(0)(self._true())


@pytest.mark.slow
@pytest.mark.parametrize(("misread", "why"), [
    ([lambda m: m, lambda m: m + 0.1], "do not agree"),
    ([lambda m: m / 0.3048], "does not fit the edges"),
    ([lambda m: 0.0], "does not fit the edges")])
def test_misread_tape_is_refused(tmp_path, misread, why):
    backend = open_backend(f"{URL}2")
    with Car.over(backend, cars=tmp_path) as car, pytest.raises(CalibrationFailed, match=why):
        calibrate_encoder(car, Tape(backend.workshop, misread), distance=1.0)
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_ctrl_c_stops_the_car(tmp_path):
    backend = open_backend(f"{URL}2")
    with Car.over(backend, cars=tmp_path) as car:
        def press(state):
            if state.speed > 0.3:
                raise KeyboardInterrupt

        car.on_state(press)
        with pytest.raises(KeyboardInterrupt):
            calibrate_encoder(car, backend.workshop)
        assert car.mode == "DISARMED"
        car._engine.listeners.remove(press)
        rolling = [s.speed for s in car.states(duration=1.5)]
        assert rolling[0] > 0.2
        assert abs(rolling[-1]) < 0.05
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_nothing_moves_unless_it_was_agreed(tmp_path):
    backend = open_backend(f"{URL}2")
    questions = []
    with Car.over(backend, cars=tmp_path) as car:
        with pytest.raises(CalibrationFailed, match="not agreed"):
            calibrate_encoder(car, backend.workshop, ask=lambda q: questions.append(q) or False)
        assert abs(truth(backend).distance) < 1e-9
    for word in ("travel per edge", " s, ", "floor of", "tape"):
        assert word in questions[0]


def test_interval_of_the_tape_is_what_tape_and_ends_make_it():
    """Two thousand virtual tapes: 90 % of the 90 % intervals hold the truth."""
    rng, gap = np.random.default_rng(1), 0.00206
    inside = []
    for _ in range(2000):
        taped = []
        for _ in range(2):
            begin, path = rng.uniform(0.0, gap), rng.uniform(2.9, 3.1)
            edges = int((begin + path) / gap)
            taped.append(Taped(Rolled(edges, path, path, 8.0), path + 0.002 * rng.normal()))
        found, _ = travel_per_edge(taped)
        inside.append(abs(found.value - gap) < 1.645 * found.std)
    assert 0.88 < np.mean(inside) < 0.92


def test_even_ring_is_no_other_ring():
    rng, learner = np.random.default_rng(2), RingLearner()
    learner.add(1, (10_000 + rng.normal(0.0, 10.0, 2000)).astype(int).tolist())
    table, notes = make_ring_table([learner], 20)
    assert len(table.value) == 20
    assert not any("caution" in note for note in notes)


@pytest.mark.parametrize("swing", [0.0, 1e-4, 1e-3])
@pytest.mark.slow
def test_interval_of_the_ring_knows_what_swings_with_it(swing):
    """Two hundred virtual rings: 90 % of the 90 % intervals, for any oscillation."""
    rng, inside = np.random.default_rng(3), []
    for _ in range(200):
        true = 1.0 + rng.normal(0.0, 0.03, 20)
        true *= 20.0 / true.sum()
        force = rng.normal(0.0, swing, 20)
        std = np.full(20, 2e-4)
        rings = [LearntRing(np.roll(true + force * (0.35 / v) ** 2 + rng.normal(0.0, std), shift),
                            std, 40.0, 1e-3, 1.0 / v) for v, shift in ((0.35, 0), (0.5, 7))]
        found, stated, _ = remove_swing(rings)
        inside.append(np.mean(np.abs(found - true) < 1.645 * stated))
    assert 0.87 < np.mean(inside) < 0.95


@pytest.mark.slow
def test_a_car_without_a_gyro_is_refused(tmp_path):
    """Its heading is computed from the steering: the tape was up to 2 % short, unnoticed."""
    measured(f"{URL}1", tmp_path / "control", distance=1.0)
    url = f"{URL}1&fail=imu:off@0s"

    def do_without(backend):
        backend.car_toml = backend.car_toml.replace("required = true", "required = false")

    with pytest.raises(CalibrationFailed, match="no data of the IMU"):
        measured(url, tmp_path, alter=do_without, distance=1.0)
