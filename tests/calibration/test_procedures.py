"""What all calibration procedures have in common, and those of other packages."""

from __future__ import annotations

import inspect

import pytest

from dart_hal.calibration import order
from dart_hal.calibration.procedure import Condition, Procedure, ProcedurePlan
from dart_hal.car import Car
from dart_hal.core.config import load_car
from dart_hal.core.config.calibration import Calibration
from dart_hal.core.errors import (
    CalibrationFailed,
    ConfigError,
    LinkLost,
    PluginFailed,
    UsageError,
)
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL

PROCEDURES = list(order.PROCEDURE_NAMES)

CODE = """
from dart_hal.calibration.procedure import Procedure, ProcedurePlan
from dart_hal.calibration.runner import driving
from dart_hal.core.errors import LinkLost


def plan(files):
    return ProcedurePlan("drives", 3.0)


def forget_to_stop(bench):
    with bench.car.raw():
        for state in bench.car.states(duration=1.0):
            bench.car.pulses(steering_us=1500.0, throttle_us=1600.0)
        raise ZeroDivisionError("no speed")


def lose_link(bench):
    raise LinkLost("the line is down")


FORGETFUL = Procedure(name="forgetful", help="Forget.", plan=plan, measure=forget_to_stop,
                      keys=("no.such_key",), after=("clock",))
LOST = Procedure(name="lost", help="Lose.", plan=plan, measure=lose_link)
MISNAMED = Procedure(name="another", help="Hide.", plan=plan, measure=lose_link)
NUMBER = 7
CLOCK = Procedure(name="clock", help="Replace ours.", plan=plan, measure=lose_link)
"""
ENTRIES = ("forgetful", "lost", "misnamed", "number", "clock", "missing")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A distribution ``other-car 2.5`` with the procedures of ``CODE``."""
    (tmp_path / "other_calibrations.py").write_text(CODE)
    folder = tmp_path / "other_car-2.5.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: other-car\nVersion: 2.5\n")
    (folder / "entry_points.txt").write_text("[dart_hal.procedures]\n" + "".join(
        f"{name} = other_calibrations:{name.upper()}\n" for name in ENTRIES))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(__import__("sys").modules, "other_calibrations", raising=False)


@pytest.mark.parametrize("name", PROCEDURES)
def test_each_procedure_fulfils_the_interface(name):
    procedure = order.load_procedure(name)
    assert isinstance(procedure, Procedure)
    assert procedure.name == name
    plan = procedure.plan(load_car("dart-01", ["cars"]), **procedure.defaults)
    assert plan.duration > 0.0
    assert (min(plan.floor) > 0.0) == (procedure.condition is Condition.FREE_FLOOR)
    for call in (procedure.plan, procedure.measure):
        assert procedure.defaults.keys() <= inspect.signature(call).parameters.keys()
    for key in procedure.keys:
        table, _, field = key.partition(".")
        assert hasattr(getattr(Calibration(car="dart-01"), table), field)
    earlier = PROCEDURES[:PROCEDURES.index(name)]
    assert set(procedure.after) <= set(earlier), "it would use what comes later"


@pytest.mark.parametrize("name", PROCEDURES)
def test_a_refused_plan_moves_nothing(name):
    with Car.open("sim://?nano=mock") as car:
        before = car.now
        with pytest.raises(CalibrationFailed, match="not agreed"):
            order.load_procedure(name)(car, ask=lambda question: False)
        assert car.now == before
        assert car.mode == "DISARMED"


def test_without_a_person_nothing_starts():
    with Car.open("sim://?nano=mock") as car, \
            pytest.raises(CalibrationFailed, match="this procedure needs an operator"):
        order.load_procedure("encoder")(car)


def test_a_typed_clock_shows_no_question():
    plan = order.load_procedure("clock").plan(load_car("dart-01", ["cars"]), 50.0, 0.01)
    assert plan is None


def test_procedures_of_other_packages_come_last(package):
    assert order.list_names() == (*PROCEDURES, "forgetful", "lost", "misnamed", "number", "missing")
    assert order.load_procedure("clock").help.startswith("The oscillator"), "ours stays ours"
    steps = order.make_steps(load_car("dart-01", ["cars"]), skip=("misnamed", "number", "missing"))
    assert steps[-1].verb == "forgetful"
    assert "lost" not in [s.verb for s in steps], "without keys it is no part of calibrate all"
    assert steps[-1] in order.due(steps, Calibration(car="dart-01"))


@pytest.mark.parametrize(("name", "kind", "message"), [
    ("misnamed", ConfigError, "misnamed of dart_hal.procedures is not a calibration"),
    ("number", ConfigError, "number of dart_hal.procedures is not a calibration"),
    ("missing", PluginFailed, "of other-car 2.5 failed: AttributeError")])
def test_what_is_no_procedure_is_refused_by_name(package, name, kind, message):
    with pytest.raises(kind, match=message):
        order.load_procedure(name)


@pytest.mark.slow
def test_an_error_of_another_package_names_it_and_the_esc_gets_neutral(package):
    pulses = []
    with Car.open("sim://?nano=mock") as car:
        world_of(car._engine.backend).watchers.append(
            lambda channel, pulse: pulses.append(1e6 * (pulse[1] - pulse[0]))
            if channel == THROTTLE_CHANNEL else None)
        with pytest.raises(PluginFailed, match=r"forgetful = .* of other-car 2.5 failed: Zero"):
            order.load_procedure("forgetful")(car)
        assert max(pulses) > 1550.0, "it drove"
        pulses.clear()
        list(car.states(duration=0.2))
        assert pulses
        assert max(pulses) < 1505.0
        with pytest.raises(LinkLost):
            order.load_procedure("lost")(car)


def test_the_plan_is_shown_as_a_question():
    questions = []
    quiet = Procedure(name="quiet", help="", plan=lambda files: ProcedurePlan("waits", 1.0),
                      measure=lambda bench: bench, condition=Condition.AT_REST)
    with Car.open("sim://?nano=mock") as car:
        quiet(car, ask=lambda question: questions.append(question) or True)
    assert questions == ["This waits. Is the car at rest?"]


@pytest.mark.parametrize(("name", "options", "found"), [
    ("encoder", {"distance": 300.0}, "300"), ("encoder", {"runs": 0}, "0"),
    ("throttle", {"room": -3.0}, "-3"), ("imu", {"turns": 0}, "0"),
    ("steering", {"speeds": (0.35, 2.0)}, "2.0"), ("steering", {"speeds": (0.4, 0.4)}, "0.4"),
    ("encoder", {"distance": float("nan")}, "nan"), ("clock", {"frequency": 50.2}, "")])
def test_options_outside_their_limits_are_refused_in_python_too(name, options, found):
    """A distance in centimetres drove on for 300 m."""
    with (Car.open("sim://?nano=mock") as car, pytest.raises(UsageError) as error):
        order.load_procedure(name)(car, None, **options)
    assert found in str(error.value)
    assert car.mode == "CLOSED"
