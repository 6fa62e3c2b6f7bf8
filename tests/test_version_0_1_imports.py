"""Programs of older versions import and call what they did, and get the new name in a warning."""

from __future__ import annotations

import subprocess
import sys
import warnings
from importlib import import_module

import numpy as np
import pytest

from dart_hal import PAPER, Car, figure_of_eight, rollout
from dart_hal.compat import MOVED, MOVED_MEMBERS, find_new_path
from dart_hal.vehicle.batch import car_rollout

PATHS = {
    "dart_hal": "Car Fleet",
    "dart_hal.actuation.steering_map": "steering_map",
    "dart_hal.calibration.steering": "calibrate_steering plan",
    "dart_hal.car": "Car join",
    "dart_hal.config": "Calibration Quantity load_car save_calibration save_model",
    "dart_hal.control.crossing.coordinator": "Coordinator",
    "dart_hal.control.crossing.crosser": "Crosser",
    "dart_hal.control.crossing.layouts": "LAYOUTS",
    "dart_hal.control.crossing.order": "Phase",
    "dart_hal.control.curvature_aware.generator": "PathWeights TUNED",
    "dart_hal.control.curvature_aware.progress": "Law",
    "dart_hal.control.follow": "Follower Phase Rules",
    "dart_hal.control.monitoring.course": "Course",
    "dart_hal.control.monitoring.detection": "coverage hiding",
    "dart_hal.control.monitoring.formation": "Formation",
    "dart_hal.control.monitoring.kuramoto": "disagreement",
    "dart_hal.control.monitoring.lissajous": "Lissajous",
    "dart_hal.control.monitoring.monitor": "Monitor",
    "dart_hal.control.monitoring.peer": "STEP",
    "dart_hal.control.mpc.obstacles": "Obstacle",
    "dart_hal.control.paths": "Path figure_of_eight",
    "dart_hal.control.plant": "plant_of",
    "dart_hal.control.platoon.car": "Ahead PlatoonCar",
    "dart_hal.control.platoon.follower": "Follower",
    "dart_hal.control.platoon.gains": "DART STABLE",
    "dart_hal.control.platoon.laws": "leader",
    "dart_hal.control.platoon.safe": "Margins",
    "dart_hal.control.pursuit": "PurePursuit",
    "dart_hal.control.speed": "SpeedLaw",
    "dart_hal.control.trackers": "Pursuit curvature_aware",
    "dart_hal.control.tracks": "track_named",
    "dart_hal.diagnose": "diagnose",
    "dart_hal.diagnose.inputs": "checked",
    "dart_hal.diagnose.report": "write_page",
    "dart_hal.evaluate": "errors evaluate gains measured predict prepare score",
    "dart_hal.experiment.floor": "Floor",
    "dart_hal.experiment.make": "conduct make_plan",
    "dart_hal.foxglove.server": "serve",
    "dart_hal.identify.runs": "read_any read_run",
    "dart_hal.links.emulator": "EmulatedNano",
    "dart_hal.localisation.grid": "Grid write_grid",
    "dart_hal.mapping.mapper": "Mapper",
    "dart_hal.mapping.occupancy": "grid_of",
    "dart_hal.recording": "to_dataframe",
    "dart_hal.recording.dart": "grid read read_all",
    "dart_hal.recording.run": "RunReader",
    "dart_hal.sim.light": "FIRMWARE LightCar LightConfig",
    "dart_hal.types": "Pose",
    "dart_hal.vehicle": "Batch UPSTREAM_2024 rollout",
    "dart_hal.vehicle.batch": "car_rollout car_step",
    "dart_hal.vehicle.effects": "apply",
    "dart_hal.vehicle.file": "model_of",
    "dart_hal.vehicle.load": "find_model",
    "dart_hal.vehicle.parameters": "Delay",
    "dart_hal.vehicle.sets": "PAPER UPSTREAM_2024",
    "dart_hal.view.player": "run_of save",
}
"""Every module that handbook and examples of version 0.1 import, and the names from it."""


@pytest.mark.parametrize("module", PATHS)
def test_names_of_version_0_1_are_found(module):
    moved = find_new_path(module) is not None
    sys.modules.pop(module, None) if moved else None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = import_module(module)
        assert all(hasattr(found, name) for name in PATHS[module].split())
    deprecations = [w for w in caught if issubclass(w.category, DeprecationWarning)
                    and module in str(w.message)]
    assert bool(deprecations) is (moved or module == "dart_hal.recording")


@pytest.mark.parametrize("old", MOVED)
def test_every_new_path_exists(old):
    assert import_module(MOVED[old]).__name__ == MOVED[old]


@pytest.mark.slow
def test_old_and_new_path_are_one_module():
    """A second copy would have classes and caches of its own."""
    program = ("import warnings; warnings.simplefilter('ignore')\n"
               "import dart_hal.sim.light.car as old, dart_lab.sim.light.car as new\n"
               "from dart_hal.errors import NotArmed\nfrom dart_hal.core import errors\n"
               "print(old is new, NotArmed is errors.NotArmed)")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          check=True)
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.slow
def test_the_warning_names_the_line_of_the_program(tmp_path):
    program = tmp_path / "program.py"
    program.write_text("x = 1\nfrom dart_hal.sim.light import LightCar\n")
    done = subprocess.run([sys.executable, "-W", "default", program], capture_output=True,
                          text=True, check=True)
    assert "program.py:2: DeprecationWarning: dart_hal.sim.light is dart_lab.sim.light" in (
        done.stderr)


def test_a_path_that_never_was_is_not_found():
    with pytest.raises(ModuleNotFoundError):
        import_module("dart_hal.simulation")
    assert find_new_path("dart_hal.car") is None


@pytest.mark.parametrize("url", ["sim://?lidar=1&camera=top", "sim://"])
def test_members_of_a_car_are_at_their_new_paths(url):
    with Car.open(url) as car:
        for name, (path, without) in MOVED_MEMBERS.items():
            with pytest.warns(DeprecationWarning,
                              match=f"car.{name} is car.{path}") as deprecations:
                old = getattr(car, name)
            assert deprecations[0].filename == __file__
            part, _, member = path.partition(".")
            absent = part in ("lidar", "camera") and url == "sim://"
            assert old == (without if absent else getattr(getattr(car, part), member))


def test_no_other_member_is_known():
    with Car.open("sim://") as car, pytest.raises(AttributeError, match="lidars"):
        _ = car.lidars


def check_renamed(old, new, match):
    """Both calls return the same; the first warns in the line of the program."""
    with pytest.warns(DeprecationWarning, match=match) as deprecations:
        result = old()
    assert deprecations[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_equal(result, new())


def test_names_of_version_0_2_in_a_path():
    path = figure_of_eight(0.5)
    check_renamed(lambda: path.at(0.5), lambda: path.interpolate(0.5), r"Path.at is Path.interpol")
    check_renamed(lambda: path.closest(0.1, 0.2, near=0.0),
                  lambda: path.closest(0.1, 0.2, s_guess=0.0), r"near=...\) is .*\(s_guess")


def test_names_of_version_0_2_in_a_rollout():
    start = np.zeros((6, 1))
    inputs = [np.full((5, 1), 0.2)] * 2
    for function, states in ((rollout, start), (car_rollout, np.zeros((8, 1)))):
        check_renamed(lambda f=function, s=states: f(PAPER, s, *inputs, at=[2]),
                      lambda f=function, s=states: f(PAPER, s, *inputs, output_samples=[2]),
                      r"rollout\(at=...\) is (car_)?rollout\(output_samples")
    with pytest.raises(TypeError):
        rollout(PAPER, start, *inputs, at=[2], output_samples=[2])


def test_names_of_version_0_2_in_a_car():
    with Car.open("sim://") as car:
        estimate = next(car.states()).estimate
        check_renamed(lambda: estimate.at(car.now).pose.x,
                      lambda: estimate.predict(car.now).pose.x, "at is MotionEstimate.predict")
        check_renamed(lambda: car.run_stop(True, by="judge"),
                      lambda: car.run_stop(False, source="judge"), r"run_stop\(source=")
        assert car.refusals() == ()
