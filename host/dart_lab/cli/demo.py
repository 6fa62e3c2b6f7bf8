"""``dart-hal demo``: the main job, without hardware, in a minute and a half."""

from __future__ import annotations

import math
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.calibration.result import SteeringResult
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.car import Car
from dart_hal.cli.common.options import json_option, out_folder_option
from dart_hal.cli.common.output import console, print_json, progress_bar, results, show_notices
from dart_hal.cli.common.session import with_progress
from dart_hal.control.paths import figure_of_eight
from dart_hal.control.plant import plant_of
from dart_hal.control.trackers import Pursuit
from dart_hal.core.errors import UsageError
from dart_hal.core.process import jobs
from dart_hal.core.process.extras import install_command
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_lab.demo import map as demo_map
from dart_lab.demo import real as demo_real
from dart_lab.demo.diagnosis import (
    DiagnosisChapter,
    describe_effect,
    remove_hidden_effects,
    run_chapter,
)
from dart_lab.demo.page import DemoResults, EightDrive, write_page, write_summary
from dart_lab.demo.section import HIDDEN_TITLE, REAL_TITLE, hidden_section, real_skipped
from dart_lab.diagnosis.report import describe_cause, headline
from dart_lab.sim.truth import reveal_url, truth

# Radius of the two circles [m]; the smallest turning radius of the paper's car is 0.55 m.
EIGHT_RADIUS = 0.9
# Speed [m/s]. The lateral acceleration v^2 / r = 0.4 m/s2 is far below the limit of the tyres.
EIGHT_SPEED = 0.6
LAPS = 2
SKIPPED = "skipped: its recordings come with the sources, and this installation has none"


@click.command("demo")
@click.option("--url", default="sim://?seed=7", show_default=True, metavar="URL",
              help="simulated car; its seed chooses the hidden parameters")
@out_folder_option("page, recording and calibration", Path("demo"))
@json_option
def command(url: str, out: Path, as_json: bool) -> None:
    """Calibrate an emulated car, drive a figure of eight, change two things in it, find them.

    The changes are the effect= of the URL, or chosen by the seed. Further chapters map a track with
    the lidar and follow it, and diagnose the real car from the recordings of the sources.
    """
    parsed = Url.parse(url)
    if parsed.scheme != "sim":
        raise UsageError("the demo needs a simulated car, whose truth is known", found=url,
                         expected="sim://?seed=N",
                         remedy="dart-hal calibrate steering --url " + url)
    if find_spec("matplotlib") is None:
        raise UsageError("the demo draws its page with matplotlib, which is not installed",
                         remedy=install_command("plot"))
    reveal_url(parsed)  # raises the errors of opening this car before the first drive
    number = parsed.options.get("seed", "0")
    healthy = remove_hidden_effects(parsed)
    began = time.monotonic()
    # 1. Calibrate. 2. Start the independent chapters in another process. 3. Meanwhile drive and
    # diagnose the emulated car. 4. Collect the results and write the pages.
    result, hello, notices = calibrate(healthy, out)
    background = jobs.start_in_background(run_independent_chapters, demo_real.find_excerpt(),
                                          int(number), out)
    drive = drive_eight(healthy, out)
    chapter = run_chapter(parsed, int(number), out)
    with progress_bar() as bar:
        bar.add_task("the real car, and a track by the lidar", total=None)
        (real, real_json), (lidar, lidar_json) = next(background)
    files = {"page": out / "index.html", "summary": out / "summary.png",
             "recording": out / "eight.mcap", "calibration": Path(result.written or ""),
             **chapter.files, **({} if "skipped" in real_json else
                                 {"diagnosis_real": out / demo_real.PAGE}),
             **({} if "skipped" in lidar_json else {"map": out / demo_map.MAP_FILE})}
    # Compare with the true parameters of the simulated car.
    known = reveal_url(Url.parse(healthy))
    numbers = {"steering_rms_deg": steering_rms(result, known["steering"]),
               "odometry_error_m": float(drive.errors[-1]), "distance_m": drive.distance}
    demo = DemoResults(healthy, hello, result, known, drive, numbers, notices)
    write_page(files["page"], demo, {
        "hidden": (HIDDEN_TITLE, hidden_section(chapter, known["sensors"])),
        "lidar": (demo_map.TITLE, lidar), "real": (REAL_TITLE, real)})
    write_summary(files["summary"], demo)
    last = drive.states[-1]
    if as_json:
        print_json({"url": url, "files": files, "duration_s": last.t, "frames": len(drive.states),
                    "lost": last.health.lost,
                    "summary": {**numbers, "diagnosis": chapter.to_json(), "lidar": lidar_json,
                                "real_car": real_json}})
    else:
        print_results(numbers, result, drive, chapter)
        results.print(demo_map.summarise(lidar_json))
        results.print(f"the real car: {real_json.get('skipped') or real_json['verdict']}")
        console.print(f"{time.monotonic() - began:.0f} s in all; open {files['page'].resolve()}",
                      highlight=False)


def run_independent_chapters(folder: Path | None, number: int, out: Path
                             ) -> tuple[demo_map.Section, demo_map.Section]:
    """Run the chapters that need no other: the real car, then the lidar."""
    real = (real_skipped(), {"skipped": SKIPPED}) if folder is None else demo_real.section(
        folder, out / demo_real.PAGE)
    return real, demo_map.section(number, out)


def calibrate(url: str, out: Path) -> tuple[SteeringResult, dict[str, Any], tuple[str, ...]]:
    """Chapter one: measure the steering map of a car with unknown parameters."""
    with Car.open(url, cars=out / "cars") as car:
        show_notices(car.notices)
        hello = car.hello.as_json()
        kind = "MockNano" if car.hello.mock else "firmware in the emulator"
        console.print(f"{kind}: version {hello['firmware']}, board {hello['board_id']}")
        with progress_bar() as bar:
            task = bar.add_task("calibrating the steering", total=1.0)
            result = calibrate_steering(
                car, source=url,
                progress=lambda part, text: bar.update(task, completed=part, description=text))
        return result, hello, car.notices


def drive_eight(url: str, out: Path) -> EightDrive:
    """Chapter two: drive a figure of eight with the new calibration, by odometry alone."""
    backend = open_backend(url)
    with Car.over(backend, cars=out / "cars", record=out / "eight.mcap") as car:
        drive = EightDrive(figure_of_eight(EIGHT_RADIUS))
        pursuit = Pursuit(drive.track, plant_of(car.files))
        car.arm()
        duration = LAPS * drive.track.length / EIGHT_SPEED
        for state in with_progress(car.states(duration=duration), duration, "figure of eight"):
            steering = pursuit.steer(state.estimate.predict(car.now))
            car.drive_speed(steering=steering, speed=EIGHT_SPEED)
            drive.states.append(state)
            drive.offsets.append(pursuit.offset)
        # True poses at the times of the states, for the errors of the odometry.
        known = [truth(backend, state.t) for state in drive.states]
        drive.true = np.array([(k.x, k.y, k.yaw, k.v_x) for k in known])
        return drive


def steering_rms(result: SteeringResult, known: dict[str, Any]) -> float:
    """Return the RMS error of the measured steering map over the command range [deg]."""
    grid = np.linspace(-1.0, 1.0, 201)
    found = np.interp(grid, result.command, result.angle)
    true = np.interp(grid, known["command"], known["angle_rad"])
    return math.degrees(float(np.sqrt(np.mean((found - true) ** 2))))


def print_results(numbers: dict[str, float], result: SteeringResult, drive: EightDrive,
                  chapter: DiagnosisChapter) -> None:
    """Print the results of the chapters on the emulated car."""
    last = drive.states[-1]
    results.print(f"steering map: {numbers['steering_rms_deg']:.2f} deg rms against ground truth"
                  f" (stated: {math.degrees(float(np.mean(result.angle_std))):.2f} deg)")
    results.print(f"figure of eight: {numbers['distance_m']:.1f} m, odometry off by "
                  f"{100 * numbers['odometry_error_m']:.1f} cm at the end; "
                  f"{len(drive.states)} frames decoded, {last.health.lost} lost")
    d = chapter.diagnosis
    found = " ".join(f"{cause.effect}: {describe_cause(d, i)['What']}"
                     for i, cause in enumerate(d.causes)) or headline(d)
    results.print(f"diagnosis: {found}", markup=False)
    results.print(f"what was changed: {'; '.join(map(describe_effect, chapter.hidden))}",
                  markup=False)
