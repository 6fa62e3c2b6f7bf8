"""A package of another laboratory adds a cause: the template in examples/plugin."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from plugin_package import install

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"


def run_with(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an environment that has the package of ``folder``."""
    return subprocess.run([sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder)!r})"
                           f"\n{program}"], capture_output=True, text=True, check=False)


@pytest.fixture
def example_folder(tmp_path):
    install(tmp_path, {path.name: path.read_text(encoding="utf-8")
                       for path in EXAMPLE.iterdir() if path.is_file()})
    return tmp_path


@pytest.mark.slow
def test_the_catalogue_has_the_effect_with_its_equation(example_folder):
    done = run_with(example_folder, """
from dart_hal.vehicle.effects import catalogue, equation_text, own_effects
print(sorted(set(catalogue()) - set(own_effects())))
print(equation_text(catalogue()["tail_fin"]).strip())""")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "['tail_fin']", "F_yr = F_yr(tyre) - k v_x (v_y - l_r omega)"]


@pytest.mark.slow
def test_a_simulated_car_drives_with_it(example_folder):
    """Circles at speed: the rear slides less, so the car turns less."""
    done = run_with(example_folder, """
from dart_hal import PAPER
from dart_lab import LightCar, apply
for car in (LightCar(PAPER), LightCar(apply(PAPER, "tail_fin", k=4.0))):
    for _ in range(300):
        reading = car.drive(throttle=0.4, steering=0.6)
    print(reading.yaw_rate)""")
    assert done.returncode == 0, done.stderr
    without, with_fin = map(float, done.stdout.split())
    assert 0.5 < with_fin / without < 0.98


@pytest.mark.slow
def test_the_diagnosis_names_it(example_folder):
    done = run_with(example_folder, f"""
sys.path.insert(0, {str(Path(__file__).parents[2])!r})
import tempfile, pathlib
from studies.diagnosis import hidden_drive
from dart_hal import find_model, read_any
from dart_lab import apply, diagnose
from dart_hal.vehicle import PAPER
car, folder = apply(PAPER, "tail_fin", k=4.0), pathlib.Path(tempfile.mkdtemp())
train, test = (read_any([hidden_drive.write(folder / f"car_1_{{n}}.csv", car, seed=n,
               plan=hidden_drive.Plan(seconds=40.0))])[0] for n in (1, 2))
found = diagnose(*find_model("paper"), train, test, refit=False,
                 only=("tail_fin", "yaw_damping", "grip"))
print([c.effect for c in found.causes])""")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0] == "['tail_fin']"


@pytest.mark.slow
@pytest.mark.parametrize(("line", "found"), [
    ("EFFECT = 7", "found    : 7"), ("EFFECT = effects.own_effects()['grip']", "named grip")])
def test_what_is_no_new_effect_is_refused(tmp_path, line, found):
    install(tmp_path, {
        "pyproject.toml": (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"),
        "dart_tail_fin.py": f"from dart_hal.vehicle import effects\n{line}\n"})
    done = run_with(tmp_path, "from dart_hal.vehicle.effects import catalogue\ncatalogue()")
    assert done.returncode == 1
    assert found in done.stderr
