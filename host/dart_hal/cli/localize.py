"""``dart-hal localize``: where the car is in a map, by its lidar, wheels and gyro."""

from __future__ import annotations

from collections import Counter
from math import degrees, inf, remainder, tau
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.car.car import backend_of
from dart_hal.cli.common.localize_picture import draw
from dart_hal.cli.common.options import (
    Number,
    car_options,
    json_option,
    lidar_option,
    map_option,
    waive_option,
)
from dart_hal.cli.common.output import notices, print_json, progress_bar, results
from dart_hal.cli.common.outputs import OutputFile, PlotFile
from dart_hal.cli.common.session import map_of, say_trouble, with_progress
from dart_hal.cli.common.simulated_room import load_simulator
from dart_hal.control.ending import Phase
from dart_hal.control.while_located import WhileLocated
from dart_hal.core.types import FloatArray, Pose
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.localiser import Located
from dart_hal.estimation.localisation.source import LidarPoses, start_of


@click.command("localize")
@car_options
@map_option
@click.option("--start", default=None, metavar="X,Y,YAW",
              help="where the car is, m and rad (default: it is searched)")
@click.option("--duration", type=Number(min=0.1), default=20.0, show_default=True,
              help="seconds of the car's time")
@click.option("--speed", type=Number(0.0, 10.0), default=0.0, show_default=True,
              help="m/s at which the car drives while it is located; 0: it is not armed")
@click.option("--steering", type=Number(-0.5, 0.5), default=0.0, show_default=True,
              help="rad, left positive")
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the run to this MCAP file")
@click.option("--plot", type=PlotFile(), default=None,
              help="write a picture of the path over the map")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, chart: Path | None,
            start: str | None, duration: float, speed: float, steering: float,
            record: Path | None, plot: Path | None, lidar: str | None, waive: tuple[str, ...],
            as_json: bool) -> int:
    """Localise the car, or a recording of it with its scans, in a map.

    Prints the last pose with its standard errors, and how well the map explains the last scan; of
    a simulated car also how far it was off. With --speed the car waits until it is found, and slows
    down to rest once it is lost. Exits 1 where the car is lost at the end, or was.
    """
    backend = backend_of(url)
    source = LidarPoses(map_of(backend, chart), start_of(start) if start else None)
    told: list[Located] = []
    ended: WhileLocated | None = None
    with Car.over(backend, car=car_name, cars=cars, poses=source, record=record,
                  lidar=lidar) as car:
        notices(car.notices)
        if speed and car.drives:
            ended = WhileLocated(speed, duration)
            drive(car, source, ended, steering, waive, told)
        else:
            for _ in with_progress(car.states(duration=duration), duration, "localising"):
                note(source, told)
        car.stop()
        say_trouble(car)
    truth = _truth(backend, told) if chart is None else None
    found = {**figures(told, truth), "ended": ended and ended.why}
    if plot:
        found["files"] = {"plot": str(draw(source.chart, told, truth, plot))}
    if as_json:
        print_json(found)
    else:
        results.print(sentence(found), markup=False, highlight=False)
    tracked = found["status"] in ("TRACKING", "MAP_STALE")
    return 0 if tracked and (ended is None or ended.good) else 1


def note(source: LidarPoses, told: list[Located]) -> None:
    """What the newest scan told, once."""
    if source.newest is not None and (not told or told[-1] is not source.newest):
        told.append(source.newest)


def drive(car: Car, source: LidarPoses, ended: WhileLocated, steering: float,
          waive: tuple[str, ...], told: list[Located]) -> None:
    """At a steering angle [rad] until it has ended; the car stands while it is not located."""
    placed, armed = -inf, False
    with progress_bar() as bar:
        bar.add_task("localising", total=None)
        for state in car.states():
            note(source, told)
            if told and told[-1].pose is not None:
                placed = told[-1].arrival
            wanted = ended.answer(state.estimate.at(car.now), placed)
            if ended.phase is Phase.ENDED:
                return
            if ended.phase is Phase.WAITING:
                continue
            if not armed:
                armed = True
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=wanted, source="localize")


def _truth(backend: Backend, told: list[Located]) -> FloatArray | None:
    if not told:
        return None
    return load_simulator().true_path(backend, np.array([seen.t for seen in told]))


def figures(told: list[Located], truth: FloatArray | None) -> dict[str, Any]:
    """What the scans told; truth (n, 3): the pose at each, where it is known."""
    last = told[-1] if told else None
    found: dict[str, Any] = {
        "status": str(last.status) if last else "LOST", "scans": len(told),
        "agreement": last.agreement if last else None,
        "mirrored": bool(last and last.mirrored), "pose": last and last.pose and _pose(last.pose),
        "counts": dict(Counter(str(seen.status) for seen in told))}
    placed = [(seen.pose, true) for seen, true in zip(told, truth, strict=True)
              if seen.pose is not None] if truth is not None else []
    if placed:
        off = np.array([(at.x - x, at.y - y, remainder(at.yaw - yaw, tau))
                        for at, (x, y, yaw) in placed])
        far = np.hypot(off[:, 0], off[:, 1])
        found["error"] = {"rms_m": float(np.sqrt(np.mean(far**2))), "max_m": float(far.max()),
                          "yaw_rms_rad": float(np.sqrt(np.mean(off[:, 2]**2)))}
    return found


def _pose(at: Pose) -> dict[str, Any]:
    return {"x": at.x, "y": at.y, "yaw": remainder(at.yaw, tau),
            "cov": at.cov.tolist()}


def sentence(found: dict[str, Any]) -> str:
    """The same to be read."""
    ended = f"ended: {found['ended']}; " if found["ended"] else ""
    if found["pose"] is None:
        why = "; the scans turn against the gyro: inverted in [lidar]" if found["mirrored"] else ""
        return f"{ended}{found['status']}: no pose after {found['scans']} scans{why}"
    at, cov = found["pose"], np.array(found["pose"]["cov"])
    std = np.sqrt(np.diag(cov))
    text = (f"{ended}{found['status']}: x {at['x']:.3f} m, y {at['y']:.3f} m, "
            f"yaw {degrees(at['yaw']):.2f} deg; standard errors {1e3 * std[0]:.1f} mm, "
            f"{1e3 * std[1]:.1f} mm, {degrees(std[2]):.2f} deg; the map explains "
            f"{100.0 * found['agreement']:.0f} % of the last scan")
    if "error" in found:
        off = found["error"]
        text += (f"; truly off by {100.0 * off['rms_m']:.2f} cm rms, {100.0 * off['max_m']:.2f} cm "
                 f"at most, {degrees(off['yaw_rms_rad']):.2f} deg rms")
    return text
