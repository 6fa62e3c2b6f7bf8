"""The span of a message of a run does not depend on how often the throttle jumped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.car.runs import FRAMES_PER_FINE_MESSAGE, FRAMES_PER_MESSAGE, finer, read_run
from dart_hal.core.timing import SAMPLE
from dart_lab.identification.prediction.commands import message_step


@pytest.fixture(scope="module")
def jumping(tmp_path_factory):
    """A run whose throttle goes up and down every 30 ms."""
    path = tmp_path_factory.mktemp("run") / "jumping.mcap"
    with Car.open("sim://?seed=3&nano=mock&physics=kinematic&tick=10", record=path) as car:
        car.arm()
        for k, _ in enumerate(car.states(duration=3.0)):
            car.drive(throttle=0.2 + 0.05 * (k // 3 % 2))
        car.stop()
    return path


@pytest.mark.slow
@pytest.mark.parametrize("every", [FRAMES_PER_MESSAGE, FRAMES_PER_FINE_MESSAGE])
def test_a_mean_represents_its_span(jumping, every):
    run = read_run(jumping, every)
    assert np.median(np.diff(run.messages.t)) < 0.5 * FRAMES_PER_MESSAGE * SAMPLE
    assert message_step(run) == pytest.approx(every * SAMPLE)


@pytest.mark.slow
def test_a_coarse_run_is_read_again_and_a_fine_one_is_not(jumping):
    coarse = read_run(jumping)
    fine = finer(coarse)
    assert fine.span == pytest.approx(FRAMES_PER_FINE_MESSAGE * SAMPLE)
    assert len(fine.messages) > len(coarse.messages)
    assert finer(fine) is fine
    of_the_moment = replace(coarse, span=0.0)
    assert finer(of_the_moment) is of_the_moment


@pytest.mark.slow
def test_what_a_program_logs_next_to_the_car_changes_nothing(tmp_path):
    runs = []
    for logs in (False, True):
        path = tmp_path / f"logs_{logs}.mcap"
        with Car.open("sim://?seed=3&nano=mock&physics=kinematic&tick=10", record=path) as car:
            car.arm()
            for k, state in enumerate(car.states(duration=1.5)):
                car.drive(throttle=0.2)
                if logs:
                    car.log("speed", -state.speed)
                    car.log("mpc/plan", [float(k), np.nan])
        runs.append(read_run(path).messages)
    for name in ("t", "speed", "yaw_rate", "throttle", "steering"):
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name),
                              equal_nan=True)
