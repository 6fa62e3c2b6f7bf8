"""Chapter of the demo on the real car: what the paper's model gets wrong on the excerpt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import dart_hal
from dart_hal.car.runs import read_any
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.report import write_page
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.report.html import Html

MODEL_NAME = "paper"
FOLDER = Path("tests", "recorded", "data")
MAX_CAUSES = 3  # each takes seconds, and the largest come first
# Split by day: drives until 9 September 2024 are for training, later days for testing.
TRAIN = ("50_tire_model_data", "60_racetrack_lap_v_060", "81_throttle_ramps")
TEST = ("91_free_driving_16_sept_2024", "steering_identification_25_sept_2024")
PAGE = "diagnosis_real.html"
# Content of the page and of the JSON: plain data, which a process can send.
Section = tuple[Html, dict[str, Any]]


def find_excerpt() -> Path | None:
    """Find the committed recordings: in the checkout of the package, or below this folder."""
    roots = (Path(dart_hal.__file__).resolve().parents[2], Path.cwd())
    found = (root / FOLDER for root in roots)
    return next((f for f in found if all((f / n).is_dir() for n in (*TRAIN, *TEST))), None)


def diagnose_excerpt(folder: Path, page: Path) -> Diagnosis:
    """Diagnose the excerpt; the report is written to ``page``."""
    file, p = find_model(MODEL_NAME)
    train, test = (read_any([folder / name for name in names])[0] for names in (TRAIN, TEST))
    sides = check_inputs(train, test, p)
    found = diagnose(file, p, sides.train, sides.test, max_causes=MAX_CAUSES)
    found = replace(found, model=MODEL_NAME, notes=(*sides.notes, *found.notes))
    given = (f"--{side} " + " ".join(str(FOLDER / name) for name in names)
             for side, names in (("train", TRAIN), ("test", TEST)))
    write_page(found, page, command=f"dart-hal diagnose --model {MODEL_NAME} "
                                   f"--max-causes {MAX_CAUSES} "
                                   + " ".join(given))
    return found


def section(folder: Path, page: Path) -> Section:
    """Content of the page and of the JSON for the real car."""
    from dart_lab.demo.section import real_section

    found = diagnose_excerpt(folder, page)
    gains = {k: {"test": g.test, "test_ci95": [g.low, g.high]} for k, g in found.gain.items()}
    return real_section(found, TRAIN, TEST, page.name), {
        "verdict": found.verdict, "gain": gains, "causes": [c.to_json() for c in found.causes]}
