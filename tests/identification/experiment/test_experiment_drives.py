"""The runner on cars that do not do as they should: it stops them and names the reason."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import ExperimentFailed
from dart_hal.core.types import Applied
from dart_lab.identification.experiment.excitation import Constant
from dart_lab.identification.experiment.floor import Floor, StartPlace
from dart_lab.identification.experiment.handover import find_mass, fit_run
from dart_lab.identification.experiment.make import conduct, make_plan
from dart_lab.identification.experiment.plans import ExperimentPlan, Segment
from dart_lab.identification.experiment.rehearsal import PaperCar
from dart_lab.identification.experiment.runner import run_plan


class Troubled(PaperCar):
    """A rehearsal's car with a fault; ``stops`` counts stop()."""

    def __init__(self, files, *, esc=True, encoder=True, imu=True, disarm_at=1e9, break_at=1e9,
                 steers=True):
        super().__init__(files)
        self.esc, self.encoder, self.imu, self.steers = esc, encoder, imu, steers
        self.disarm_at, self.break_at, self.stops = disarm_at, break_at, 0

    def states(self, **options):
        for state in super().states(**options):
            if state.t > self.break_at:
                raise KeyboardInterrupt
            if state.t > self.disarm_at:
                self.mode, self.causes = "TRIPPED", ("LINK_STALE",)
            if not self.encoder:
                state = replace(state, ticks=0, speed=0.0)
            accel = (state.applied.throttle - 0.15) * 12.0 if self.esc else 0.0
            yield replace(state, accel_x=max(accel, 0.0),
                          yaw_rate=state.yaw_rate if self.imu or state.t < 2.0 else None)

    def drive(self, *, steering=0.0, throttle=0.0, **options) -> Applied:
        return super().drive(steering=steering if self.steers else 0.3,
                             throttle=throttle if self.esc else 0.0, **options)

    def stop(self):
        self.stops += 1
        return super().stop()


@pytest.fixture(scope="module")
def plan(files):
    return make_plan("friction", files, Floor(8.0, 3.0), None)


@pytest.mark.slow
def test_sound_car_drives_to_the_end(files, plan):
    car = Troubled(files)
    drive = run_plan(car, plan)
    assert not drive.stopped
    assert car.stops == 1


@pytest.mark.slow
def test_car_that_never_moves_is_reported_with_its_cause(files, plan):
    car = Troubled(files, esc=False)
    with pytest.raises(ExperimentFailed, match="does not move") as error:
        run_plan(car, plan)
    assert "ESC" in error.value.likely
    assert car.stops == 1


@pytest.mark.slow
def test_dead_encoder_is_distinguished_from_a_dead_esc(files, plan):
    car = Troubled(files, encoder=False)
    with pytest.raises(ExperimentFailed, match="encoder does not count"):
        run_plan(car, plan)
    assert car.stops == 1


@pytest.mark.slow
def test_lost_yaw_rate_ends_the_drive(files, plan):
    with pytest.raises(ExperimentFailed, match="no yaw rate"):
        run_plan(Troubled(files, imu=False), plan)


@pytest.mark.slow
def test_a_trip_ends_the_drive_with_its_cause(files, plan):
    with pytest.raises(ExperimentFailed, match="TRIPPED") as error:
        run_plan(Troubled(files, disarm_at=4.0), plan)
    assert "LINK_STALE" in error.value.found


@pytest.mark.slow
def test_ctrl_c_stops_the_car(files, plan):
    car = Troubled(files, break_at=5.0)
    with pytest.raises(KeyboardInterrupt):
        run_plan(car, plan)
    assert car.stops == 1


@pytest.mark.slow
def test_car_that_does_not_steer_is_stopped_before_the_edge(files, plan):
    drive = run_plan(Troubled(files, steers=False), plan)
    assert "lane" in drive.stopped
    assert all(plan.fence.inside(f.pose.x, f.pose.y) for f in drive.frames)


@pytest.mark.parametrize("throttle", [0.3, 0.5])
def test_fence_stops_in_time_for_the_car_to_roll_out(files, throttle):
    ahead = Segment("away", 20.0, throttle=Constant(throttle), steering=Constant(-0.02))
    plan = ExperimentPlan("friction", (ahead,), Floor(6.0, 4.0), StartPlace(1.0, 2.0), 9.0)
    car = PaperCar(files)
    drive = run_plan(car, plan)
    assert "left the floor" in drive.stopped
    for state in car.states():
        if state.speed < 0.02:
            break
    assert plan.fence.inside(state.pose.x - drive.frames[0].pose.x, state.pose.y)
    assert state.pose.x > 2.5  # it was not stopped for nothing


def test_top_speed_ends_a_drive_that_runs_away(files):
    away = Segment("away", 20.0, throttle=Constant(0.5), steering=Constant(0.0))
    plan = ExperimentPlan("friction", (away,), Floor(99.0, 99.0), StartPlace(40.0, 40.0), 1.0)
    drive = run_plan(PaperCar(files), plan)
    assert "top speed" in drive.stopped
    assert max(f.speed for f in drive.frames) < 1.6


@pytest.mark.slow
def test_aborted_run_is_kept_and_its_fit_states_too_little(tmp_path):
    path = tmp_path / "aborted.mcap"
    with Car.open("sim://?seed=3&nano=mock", cars=tmp_path, record=path) as car:
        files, messages = car.files, []

        def interrupt(share: float, text: str) -> None:
            messages.append(text)
            if len(messages) > 20:
                raise KeyboardInterrupt

        plan = make_plan("friction", files, Floor(8.0, 3.0), None)
        with pytest.raises(KeyboardInterrupt):
            conduct(car, plan, interrupt)
        assert car.mode == "DISARMED"
    fit = fit_run(path, "friction", files, find_mass(files)).fits["friction"]
    assert not fit.converged
    assert not any(e.identifiable for e in fit.parameters.values())
    assert any("needed" in note for note in fit.notes)


@pytest.mark.slow
def test_simulated_car_without_its_encoder(tmp_path):
    """Through the whole Car: no edge, so the throttle is cut, and the drive ends with the cause."""
    with Car.open("sim://?seed=3&nano=mock&fail=enc:off@0", cars=tmp_path) as car:
        plan = make_plan("friction", car.files, Floor(8.0, 3.0), None)
        with pytest.raises(ExperimentFailed, match="encoder") as error:
            conduct(car, plan)
        assert car.mode == "DISARMED"
    assert "encoder" in error.value.what
