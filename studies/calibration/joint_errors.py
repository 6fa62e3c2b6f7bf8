"""Errors of ``identify --joint`` on hidden cars, with the standard errors that it states.

A car is calibrated as ``calibrate all`` does and drives four experiments, as in the tutorial of a
car of one's own. The joint fit then starts at the measured model.
"""

from __future__ import annotations

from pathlib import Path

from dart_hal.car import Car
from dart_hal.car.files import load_files
from dart_hal.car.runs import read_any
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_lab.identification.experiment.floor import Floor
from dart_lab.identification.experiment.handover import find_mass, note_mass
from dart_lab.identification.experiment.make import conduct, make_plan
from dart_lab.identification.measured import named_model
from dart_lab.identification.outcome import identify_jointly
from dart_lab.identification.write import SECTIONS
from dart_lab.sim.truth import reveal_url
from studies.calibration.hidden_errors import Errors, all_errors, url_of

DRIVES = ("friction", "motor", "delay", "tyres")
FLOOR = "8"
"""m x m, as in the tutorial."""


def calibrated(seed: int, folder: Path) -> Errors:
    """Calibrate the car of a seed into ``folder``; errors of all quantities."""
    url = url_of(seed, mocap=True, late=False, lidar=True, bent=True)
    return all_errors(seed, url, str(folder))


def drive(seed: int, folder: Path) -> list[Path]:
    """Drive and record the experiments of a calibrated car; those on disk are kept."""
    url = url_of(seed, mocap=True, late=False)
    runs = []
    for name in DRIVES:
        run = folder / f"{name}.mcap"
        runs.append(run)
        if run.is_file():
            continue
        part = run.with_name(f"{name}.part.mcap")
        part.unlink(missing_ok=True)
        backend = open_backend(url)
        plan = make_plan(name, load_files(backend, "", folder), Floor.parse(FLOOR), None)
        with Car.over(backend, cars=folder, record=part) as car:
            note_mass(car, find_mass(car.files, None, backend.workshop))
            conduct(car, plan)
        part.rename(run)
    return runs


def joint_errors(seed: int, folder: Path) -> Errors:
    """(error, standard error) of every parameter of the joint fit of a seed's car."""
    runs = drive(seed, folder)
    base, _ = named_model("measured", runs)
    recordings, skipped = read_any(runs)
    found, _ = identify_jointly(recordings, skipped, SECTIONS, base, "")
    true = true_parameters(seed, files_span(runs[0]))
    rows: Errors = {}
    for section, fit in found.fits.items():
        for key, e in fit.parameters.items():
            rows[f"{section}.{key}"] = [(e.value - true[f"{section}.{key}"], e.std)]
    return rows


def files_span(run: Path) -> float:
    """us of pulse for full throttle, as the recording's car file has it."""
    with Car.open(f"replay://{run}") as car:
        return car.files.config.throttle.span_us


def true_parameters(seed: int, span: float) -> dict[str, float]:
    """Parameters by "section.key" of the hidden car, in units of the recorded commands.

    span [us]: full throttle of the recorded commands, where the ESC's own ends at its saturation.
    Delays count from the command: the wait for a PWM frame and the pulse come on top.
    """
    shown = reveal_url(Url.parse(url_of(seed, late=False)))
    true = {f"{section}.{key}": entry["value"] for section, table in shown["vehicle"].items()
            if isinstance(table, dict) for key, entry in table.items()}
    ratio = span / shown["sensors"]["throttle.saturation_us"]
    true["motor.d"] *= ratio
    true["motor.e"] *= ratio
    true["motor.g"] /= ratio
    for name in ("steering", "throttle"):
        true[f"delay.{name}_s"] += shown["sensors"]["latency.command_to_pulse"]
    return true
