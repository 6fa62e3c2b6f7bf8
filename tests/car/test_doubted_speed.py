"""Wrong encoders: what ``drive_speed`` makes of them, how soon it is reported, what covers it."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from dart_hal.car import Car
from dart_hal.core.types import SPEED_DOUBTS
from dart_hal.devices.actuation.direction_watch import DirectionWatch
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation import speed
from dart_lab.sim.truth import world_of

pytestmark = pytest.mark.usefixtures("armed_esc")


@dataclass
class DoubtedRun:
    """What one drive showed: all times in s after the fault."""

    flagged: dict[str, float] = field(default_factory=dict)
    fastest: float = 0.0
    uncovered: float = 0.0
    limited: set[str] = field(default_factory=set)
    capped: bool = False

    @property
    def t_first_doubt(self) -> float:
        """When the speed was first doubted; inf = never."""
        return min((t for name, t in self.flagged.items() if name in SPEED_DOUBTS),
                   default=float("inf"))


def half(world) -> None:
    world.nano.set_ring(0, world.car.ring_a.edges[::2])


def two_marks(world) -> None:
    world.nano.set_ring(0, world.car.ring_a.edges[:2])


def off(world) -> None:
    world.nano.set_ring(0, ())


def phantom(world) -> None:
    """2610 edges/s from nowhere, on top of nothing."""
    nano = world.nano
    inner = type(world.nano).set_wheel
    nano.set_wheel = lambda rate: inner(nano, rate + 2610 / 20)
    nano.set_wheel(0.0)


def drive(tmp_path, fault, *, target_speed: float, t_fault: float, believed: bool = False,
          seconds: float = 3.0, seed: int = 3) -> DoubtedRun:
    """``drive_speed(target_speed)`` with a fault at ``t_fault`` s; believed: no check of the
    encoder."""
    backend = open_backend(f"sim://?nano=mock&seed={seed}")
    run = DoubtedRun()
    with Car.over(backend, cars=tmp_path) as car:
        world = world_of(backend)
        car.arm(waive=["CALIBRATION_MISSING"])
        if believed:
            car._engine.telemetry.encoder.judge = lambda *_: None
        start = None
        struck = None
        for state in car.states(duration=t_fault + seconds):
            start = state.t if start is None else start
            if struck is None and state.t - start >= t_fault:
                fault(world)
                struck = state.t
            if struck is not None:
                truth = abs(world.truth().v_x)
                run.fastest = max(run.fastest, truth)
                for name in state.health.doubts:
                    run.flagged.setdefault(name, state.t - struck)
                if state.health.speed_doubted:
                    run.uncovered = max(run.uncovered,
                                        abs(truth - abs(state.speed)) / state.speed_std)
            applied = car.drive_speed(steering=0.0, speed=target_speed)
            if state.health.speed_doubted:
                run.limited.update(applied.limited)
                run.capped = run.capped or applied.throttle == 0.0
    return run


@pytest.mark.parametrize("t_fault", [0.0, 2.5], ids=["from rest", "while driving"])
@pytest.mark.parametrize("fault", [half, two_marks, off], ids=lambda f: f.__name__)
@pytest.mark.slow
def test_missing_edges_are_reported_and_do_not_open_the_throttle(tmp_path, fault, t_fault):
    run = drive(tmp_path, fault, target_speed=1.0, t_fault=t_fault)
    assert run.t_first_doubt <= 0.5
    assert run.fastest <= 1.3
    assert run.uncovered <= 3.0
    assert "ENCODER_DOUBTED" in run.limited
    assert run.capped


@pytest.mark.parametrize("fault", [half, two_marks, off], ids=lambda f: f.__name__)
@pytest.mark.slow
def test_control_an_encoder_that_is_believed_runs_away(tmp_path, fault):
    run = drive(tmp_path, fault, target_speed=1.0, t_fault=0.0, believed=True)
    assert run.fastest > 1.3
    assert run.t_first_doubt > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "fastest"), [(half, 0.9), (two_marks, 0.6), (off, 0.5)],
                         ids=["half", "two marks", "off"])
def test_reverse_is_watched_as_well(tmp_path, fault, fastest):
    run = drive(tmp_path, fault, target_speed=-0.5, t_fault=0.0)
    assert run.t_first_doubt < 1.2
    assert run.fastest <= fastest
    assert run.uncovered <= 3.0
    blind = drive(tmp_path, fault, target_speed=-0.5, t_fault=0.0, believed=True)
    assert blind.fastest > run.fastest + 0.2


@pytest.mark.slow
def test_edges_from_nowhere_are_reported_and_covered(tmp_path):
    run = drive(tmp_path, phantom, target_speed=1.0, t_fault=2.0)
    assert run.t_first_doubt <= 0.5
    assert run.fastest <= 1.35
    assert run.uncovered <= 3.0


@pytest.mark.slow
def test_a_doubt_ends_with_a_stop_and_the_next_drive_is_judged_again(tmp_path):
    backend = open_backend("sim://?nano=mock&seed=3")
    with Car.over(backend, cars=tmp_path) as car:
        world = world_of(backend)
        car.arm(waive=["CALIBRATION_MISSING"])
        half(world)
        for state in car.states(duration=1.0):
            car.drive_speed(steering=0.0, speed=1.0)
        assert state.health.doubts == {"ENCODER_LOW"}
        world.nano.set_ring(0, world.car.ring_a.edges)
        car.stop()
        assert "ENCODER_LOST" in car.refusals()
        for _ in car.states(duration=2.5):
            pass
        car.arm(waive=["CALIBRATION_MISSING"])
        for state in car.states(duration=2.0):
            car.drive_speed(steering=0.0, speed=1.0)
        assert not state.health.doubts
        assert state.speed > 0.8


def spins(world) -> None:
    """Wheels 60 % quicker than the ground for 0.4 s."""
    nano = world.nano
    inner = world.nano.set_wheel
    nano.set_wheel = lambda rate: inner(1.6 * rate)
    world.schedule(world.t + 0.4, lambda w: setattr(nano, "set_wheel", inner))


@pytest.mark.slow
def test_a_wheel_that_spins_for_a_moment_is_no_ring_that_lost_its_marks(tmp_path):
    """Reported soon, nothing is held against the ring, and the brakes do not turn its sign."""
    run = drive(tmp_path, spins, target_speed=2.0, t_fault=1.7, seconds=1.0)
    assert run.flagged["ENCODER_SLIPS"] < 0.1
    assert "ENCODER_LOW" not in run.flagged
    assert run.fastest < 2.2
    assert run.uncovered <= 3.0


@pytest.mark.slow
def test_control_wheels_that_turn_round_from_any_speed_run_away(tmp_path, monkeypatch):
    """Quicker against the brakes looks like backwards: the throttle opens, until the car is
    disarmed because it drives against its throttle."""
    monkeypatch.setattr(DirectionWatch, "update", lambda *values: False)
    monkeypatch.setattr(speed, "MAX_DRIVEN_REVERSAL_SPEED", 1e9)
    assert drive(tmp_path, spins, target_speed=2.0, t_fault=1.7, seconds=1.0).fastest > 2.6
