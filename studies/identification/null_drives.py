"""False causes in drives that hide nothing, with a model that ``identify`` fitted to other drives.

    python -m studies.identification.null_drives --joint          20 cars, two minutes of CPU
    python -m studies.identification.null_drives --cars 4 --first-seed 50

Each simulated car of ``studies.identification.coverage`` drives five minutes: three for
``identify``, one that a diagnosis learns from, and one that it judges by. The model has errors, so
"parameters only" is right as well as "nothing wrong"; a cause is false.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rich.console import Console

from dart_hal.core.config import ModelFile
from dart_hal.recording.dart import Recording
from dart_hal.vehicle import PAPER, Body
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import vehicle_of
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.diagnosis.run import diagnose
from dart_lab.identification.outcome import identify
from dart_lab.identification.write import build_model
from studies.identification.coverage import DRIVES, FRAME, parse_options, record_drives


def identify_model(recordings: Sequence[Recording], body: Body, joint: bool) -> ModelFile:
    """Identify all parts of the paper's model with this body."""
    base = model_of(replace(PAPER, body=body))
    outcome = identify(recordings, base, joint=joint, reference=FRAME)
    written = build_model(outcome.fits, outcome.over(base), outcome.source, joint=outcome.joint)
    return written.model or base


def diagnose_null(seed: int, any_car: bool, joint: bool) -> Diagnosis:
    """Identify a drawn car in its first drives, and diagnose its last two, which hide nothing."""
    car, drives = record_drives(seed, any_car, DRIVES + 2)
    model = identify_model(drives[:DRIVES], car.body, joint)
    inputs = check_inputs(drives[DRIVES:DRIVES + 1], drives[DRIVES + 1:], vehicle_of(model))
    return diagnose(model, vehicle_of(model), inputs.train, inputs.test)


def main() -> None:
    """Print a line for each car that gets a cause, and their number."""
    options = parse_options(__doc__)
    console = Console()
    wrong = possible = 0
    for seed in range(options.first_seed, options.first_seed + options.cars):
        found = diagnose_null(seed, options.any_car, options.joint)
        names = [cause.effect for cause in found.causes]
        wrong += bool(names)
        possible += bool(found.possible)
        if names or found.possible:
            console.print(f"car {seed}: {found.verdict}, causes {names}, "
                          f"possible {[one.effect for one in found.possible]}")
    console.print(f"{wrong} of {options.cars} drives get a cause, {possible} a possible one")


if __name__ == "__main__":
    main()
