"""``dart-hal accept``: the report, its refusals, and neutral throttle after Ctrl-C."""

from __future__ import annotations

import json
import signal

import click
import pytest

from dart_hal.calibration.acceptance import PART_SCATTER, STEP_NAMES, Measurand, agrees
from dart_lab.cli.accept import AcceptanceOperator
from dart_lab.sim.world import THROTTLE_CHANNEL, World
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US
from tests.pages import foreign

ACCEPTED_CAR = "sim://?nano=mock&seed=5"
EMULATED = "sim://?nano=mock"
# s from Ctrl-C to the last pulse that moves the car.
NEUTRAL_DEADLINE_S = 0.040


def only(*names):
    """Options that leave all other steps out."""
    return [word for name in STEP_NAMES if name not in names for word in ("--skip", name)]


@pytest.mark.slow
def test_a_short_check_is_reported_with_predictions(verb, tmp_path):
    done = verb("accept", "--yes", "--json", "--url", ACCEPTED_CAR, "--emulator", EMULATED,
                *only("supply", "cutoff", "rotation"))
    assert done.code == 0, done.err
    answer = done.json
    steps = {step["id"]: step for step in answer["steps"]}
    assert list(steps) == list(STEP_NAMES)
    assert {name for name, step in steps.items() if step["status"] == "measured"} == {
        "supply", "cutoff", "rotation"}
    assert steps["esc"]["status"] == "skipped"
    assert steps["esc"]["reason"] == "--skip"
    (edges,) = steps["rotation"]["values"]
    assert edges["agrees"] is True
    assert edges["predicted"] == pytest.approx(71.0, abs=4.0)
    assert all(value["measured"] is None for value in steps["supply"]["values"])
    arm_time = steps["cutoff"]["values"][-1]
    assert arm_time["measured"] == pytest.approx(arm_time["predicted"], abs=1.0)
    written = json.loads((tmp_path / "accept.json").read_text())
    assert written == {k: v for k, v in answer.items() if k not in ("page", "file")}
    page = (tmp_path / "accept.html").read_text()
    assert not foreign(page)
    assert "edges per turn of a driven wheel" in page
    assert "not measured" in page
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_all_steps_run_on_an_emulated_car(verb):
    done = verb("accept", "--yes", "--json", "--url", ACCEPTED_CAR, "--emulator", EMULATED)
    assert done.code == 0, done.err
    values = {v["id"]: v for step in done.json["steps"] for v in step["values"]}
    assert {step["status"] for step in done.json["steps"]} == {"measured"}
    # The emulated car has no oscilloscope for its supply; everything else is predicted.
    assert {k for k, v in values.items() if v["predicted"] is None} == {
        "battery_volts", "nano_volts", "servo_volts"}
    assert values["clock_error"]["measured"] != pytest.approx(0.0, abs=100.0)
    # A sound car differs from the nominal one by as much as sound parts do.
    assert {values[key]["agrees"] for key in PART_SCATTER} == {True}
    assert values["throttle.signal_loss"]["agrees"] is False
    assert values["frame_rate"]["agrees"] is True


@pytest.mark.parametrize(("ppm", "sound"), [(-1400.0, True), (4000.0, True), (-8000.0, False)])
def test_a_resonator_within_its_tolerance_agrees(ppm, sound):
    measured = Measurand("clock_error", "clock", ppm, "ppm", 0.1)
    assert agrees(measured, Measurand("clock_error", "clock", 0.0, "ppm", 1.0)) is sound


@pytest.mark.slow
@pytest.mark.emulator
def test_the_firmware_of_the_emulator_passes_the_same_check(verb):
    done = verb("accept", "--yes", "--json", "--url", "sim://?nano=avr&seed=5", "--emulator",
                "sim://?nano=avr", *only("delay", "cutoff", "rotation"))
    assert done.code == 0, done.err
    assert done.json["mock"] is False
    agreed = {v["id"]: v["agrees"] for step in done.json["steps"] for v in step["values"]}
    assert {"latency.command_to_pulse", "arming", "edges_per_turn"} <= set(agreed)
    assert all(agreed.values())


@pytest.mark.slow
def test_a_broken_part_fails_its_step_and_not_the_others(verb):
    done = verb("accept", "--yes", "--json", "--url", f"{ACCEPTED_CAR}&fail=enc:off@0",
                "--emulator", EMULATED, *only("cutoff", "rotation"))
    assert done.code == 1
    steps = {step["id"]: step for step in done.json["steps"]}
    assert steps["rotation"]["status"] == "failed"
    assert "encoder" in steps["rotation"]["reason"]
    assert steps["rotation"]["try"]
    assert steps["cutoff"]["status"] == "measured"


@pytest.mark.parametrize(("options", "words"), [
    (("--yes", "--url", "serial:///dev/ttyUSB0?i2c=1"), "--yes"),
    (("--yes", "--port", "/dev/ttyUSB0"), "--yes"),
    (("--port", "/dev/ttyUSB0", "--url", ACCEPTED_CAR), "--port and --url"),
    (("--emulator", "serial:///dev/ttyUSB0"), "--emulator"),
    (("--url", "replay://run.mcap"), "recording"),
    (("--url", ACCEPTED_CAR, "--html", "page.txt"), "page.txt"),
    (("--url", ACCEPTED_CAR, "--skip", "wings"), "wings"),
])
def test_unusable_options_are_refused_before_anything_moves(verb, options, words):
    error = verb("accept", "--json", *options).error
    assert words in error["what"]


def test_a_car_that_cannot_be_opened_is_reported_before_the_prediction(verb):
    done = verb("accept", "--json", "--url", "serial:///dev/ttyNONE?i2c=1")
    assert done.error["code"] == "D-LINK-02"
    assert "predicting" not in done.err


@pytest.mark.slow
def test_no_step_starts_without_an_operator_or_yes(verb):
    error = verb("accept", "--json", "--url", ACCEPTED_CAR, "--emulator", EMULATED,
                 *only("supply")).error
    assert "not confirmed" in error["what"]


def test_readings_may_be_empty_and_are_numbers(monkeypatch):
    answers = iter(["", "12 V", "nan", "12,4"])
    monkeypatch.setattr(click, "prompt", lambda *args, **options: next(answers))
    operator = AcceptanceOperator()
    assert operator.read_instrument("battery_volts", "battery [V]") is None
    assert operator.read_instrument("battery_volts", "battery [V]") == 12.4


@pytest.fixture
def press(verb, monkeypatch):
    """Run the check, with Ctrl-C at a moving pulse of the car; return (what ran, pulses, when)."""
    def run(*steps, nth=40):
        made = World.__init__
        worlds = []
        pulses = []
        pressed = []

        def watch(channel, pulse):
            if channel != THROTTLE_CHANNEL:
                return
            pulses.append((pulse[1], (pulse[1] - pulse[0]) * 1e6))
            moving = sum(abs(us - NEUTRAL_US) > NEUTRAL_TOLERANCE_US for _, us in pulses)
            if moving == nth and not pressed:
                pressed.append(pulse[1])
                signal.raise_signal(signal.SIGINT)

        def make_watched_world(world, *args, **options):
            made(world, *args, **options)
            worlds.append(world)
            # The first two worlds are those of the check of the car and of the prediction.
            if len(worlds) == 3:
                world.watchers.append(watch)

        monkeypatch.setattr(World, "__init__", make_watched_world)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            done = verb("accept", "--yes", "--json", "--url", ACCEPTED_CAR, "--emulator", EMULATED,
                        *only(*steps))
        finally:
            signal.signal(signal.SIGINT, before)
        assert pressed
        return done, pulses, pressed[0]

    return run


@pytest.mark.slow
def test_ctrl_c_leaves_neutral_and_reports_what_was_measured(press, tmp_path):
    done, pulses, pressed = press("cutoff", "wheel", "gyro")
    assert done.code == 130
    assert not [us for t, us in pulses if t > pressed + NEUTRAL_DEADLINE_S
                and abs(us - NEUTRAL_US) > NEUTRAL_TOLERANCE_US]
    assert abs(pulses[-1][1] - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US
    steps = {s["id"]: s for s in json.loads((tmp_path / "accept.json").read_text())["steps"]}
    assert steps["cutoff"]["status"] == "measured"
    assert steps["wheel"]["reason"] == steps["gyro"]["reason"] == "interrupted"


@pytest.mark.slow
def test_control_an_exit_that_keeps_the_pins_would_drive_on(press, monkeypatch):
    monkeypatch.setattr("dart_hal.car.driver.Driver.close", lambda driver, now: None)
    monkeypatch.setattr("dart_hal.car.driver.Driver.stop", lambda driver, now, event=None:
                        driver.actuator.applied)
    monkeypatch.setattr("dart_hal.devices.actuation.chain.Actuator.stop",
                        lambda actuator: actuator.applied)
    assert abs(press("wheel")[1][-1][1] - NEUTRAL_US) > NEUTRAL_TOLERANCE_US
