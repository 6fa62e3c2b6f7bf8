"""How often the 90 % intervals of a model that ``diagnose`` refits hold the hidden truth.

    .venv/bin/python -m studies.diagnosis.refit_coverage --first 61 --seeds 8

Each car drives ``experiment steps`` with motion capture, is diagnosed from the paper's model or, if
``--calibrate`` measured something first, from the measured one, and marked by ``sim --reveal``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np

from dart_hal.core.types import INTERVAL_90
from dart_hal.core.url import Url
from dart_lab.sim.marking import Mark, mark_car


def run(*words: str, folder: Path) -> None:
    """Run one verb in a folder."""
    program = Path(sys.executable).with_name("dart-hal")
    subprocess.run([program, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)


def mark_refit(seed: int, folder: Path, procedures: list[str]) -> list[Mark]:
    """Return the marks of the refitted model of one hidden car."""
    url = f"sim://?nano=mock&mocap=1&seed={seed}"
    car = ("--url", url, "--cars", "cars")
    model = folder / "cars" / f"sim-{seed}" / "model.toml"
    model.parent.mkdir(parents=True)
    for procedure in procedures:
        run("calibrate", procedure, "--yes", *car, folder=folder)
    run("experiment", "steps", "--no-fit", "--out", "train.mcap", *car, folder=folder)
    # A healthy car: one effect that it does not have keeps the search short.
    run("diagnose", "--train", "train.mcap", "--only", "gyro_latency", "--out", str(model),
        "--jobs", "1", folder=folder)
    marks = mark_car(Url.parse(url), [folder / "cars"]).marks
    return [mark for mark in marks if mark.group == "model"]


def main() -> None:
    """Print the errors of each car in standard errors, then the share inside for each group."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=61)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--calibrate", nargs="*", default=[], metavar="PROCEDURE")
    options = parser.parse_args()
    errors = defaultdict[str, list[float]](list)
    for seed in range(options.first, options.first + options.seeds):
        with tempfile.TemporaryDirectory() as folder:
            marks = mark_refit(seed, Path(folder), options.calibrate)
        line = []
        for mark in marks:
            assert None not in (mark.true, mark.measured, mark.low, mark.high)
            std = (mark.high - mark.low) / (2.0 * INTERVAL_90)
            z = (mark.measured - mark.true) / std
            errors[mark.name.partition(".")[0]].append(z)
            line.append(f"{mark.name} {z:+.1f}")
        print(f"{seed}: {', '.join(line)}", flush=True)
    errors["all"] = [z for group in list(errors) for z in errors[group]]
    for group, values in errors.items():
        z = np.array(values)
        inside = int(np.sum(np.abs(z) <= INTERVAL_90))
        print(f"{group:10} {inside:3} of {len(z):3} inside = {inside / len(z):.0%}, "
              f"rms {np.sqrt(np.mean(z**2)):.2f}, worst {np.max(np.abs(z)):.1f}")


if __name__ == "__main__":
    main()
