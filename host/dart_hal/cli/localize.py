"""``dart-hal localize``: locate the car in a map by its lidar, wheels and gyro."""

from __future__ import annotations

from collections import Counter
from math import degrees, inf, remainder, tau
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.car.car import open_url
from dart_hal.car.lidar import list_map_errors, mounting_covariance
from dart_hal.cli.common.localize_picture import draw_localization
from dart_hal.cli.common.options import (
    FiniteNumber,
    car_options,
    json_option,
    lidar_option,
    map_option,
    plot_option,
    waive_option,
)
from dart_hal.cli.common.output import print_json, progress_bar, results, show_notices
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.session import load_map, show_sensor_errors, with_progress
from dart_hal.cli.common.simulated_room import load_simulator
from dart_hal.control.ending import MAX_POSE_GAP, Phase
from dart_hal.control.while_located import WhileLocated
from dart_hal.core.config import CarFiles
from dart_hal.core.types import FloatArray, Pose
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.health import Status
from dart_hal.estimation.localisation.localiser import Located
from dart_hal.estimation.localisation.source import LidarPoses, parse_start


@click.command("localize")
@car_options
@map_option
@click.option("--start", default=None, metavar="X,Y,YAW",
              help="start pose, m and rad (default: the car is searched in the whole map)")
@click.option("--duration", type=FiniteNumber(min=0.1), default=20.0, show_default=True,
              help="seconds of car time")
@click.option("--speed", type=FiniteNumber(0.0, 10.0), default=0.0, show_default=True,
              help="m/s; the car drives while it is located; 0: it is not armed")
@click.option("--steering", type=FiniteNumber(-0.5, 0.5), default=0.0, show_default=True,
              help="rad, left positive")
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the run to this MCAP file")
@plot_option("the path in the map")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, chart: Path | None,
            start: str | None, duration: float, speed: float, steering: float,
            record: Path | None, plot: Path | None, lidar: str | None, waive: tuple[str, ...],
            as_json: bool) -> int:
    """Locate the car, or a recording with scans, in a map.

    Prints the last pose with standard errors, the share of the last scan that the map explains, and
    for a simulated car the true error. With --speed the car drives once located, and stops when its
    pose is lost. Exits 1 if it was lost.
    """
    backend = open_url(url)
    source = LidarPoses(load_map(backend, chart), parse_start(start) if start else None)
    poses: list[Located] = []
    ended: WhileLocated | None = None
    with Car.over(backend, car=car_name, cars=cars, poses=source, record=record,
                  lidar=lidar) as car:
        show_notices(car.notices)
        if speed and car.drives:
            # With --speed the drive ends by rules about the pose; a car that is pushed, or a
            # recording, is localised for --duration.
            ended = WhileLocated(speed, duration)
            drive_until_ended(car, source, ended, steering, waive, poses)
        else:
            for _ in with_progress(car.states(duration=duration), duration, "localising"):
                collect_newest(source, poses)
        car.stop()
        show_sensor_errors(car)
    # Only the room of the simulation has a true pose; a map of --map is in a frame of its own.
    truth = _true_path(backend, poses) if chart is None else None
    found = {**summarise_poses(poses, truth, car.files, source.map_std, car.now),
             "ended": ended and ended.why}
    if plot:
        found["files"] = {"plot": str(draw_localization(source.chart, poses, truth, plot))}
    if as_json:
        print_json(found)
    else:
        results.print(format_summary(found), markup=False, highlight=False)
    tracked = found["status"] in ("TRACKING", "MAP_STALE")
    return 0 if tracked and (ended is None or ended.good) else 1


def collect_newest(source: LidarPoses, poses: list[Located]) -> None:
    """Append the pose of the newest scan, if it is not the last one of ``poses``."""
    if source.newest is not None and (not poses or poses[-1] is not source.newest):
        poses.append(source.newest)


def drive_until_ended(car: Car, source: LidarPoses, ended: WhileLocated, steering: float,
                                  waive: tuple[str, ...], poses: list[Located]) -> None:
    """Drive with a constant steering angle [rad] until ``ended`` has; wait while not located."""
    last_pose_t = -inf
    armed = False
    with progress_bar() as bar:
        bar.add_task("localising", total=None)
        for state in car.states():
            collect_newest(source, poses)
            if poses and poses[-1].pose is not None:
                # By arrival: the controller has to stop when poses stop coming, whatever their
                # delay.
                last_pose_t = poses[-1].arrival
            speed = ended.answer(state.estimate.predict(car.now), last_pose_t)
            if ended.phase is Phase.ENDED:
                return
            if ended.phase is Phase.WAITING:
                continue
            if not armed:
                armed = True
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=speed, source="localize")


def _true_path(backend: Backend, poses: list[Located]) -> FloatArray | None:
    """Return the true poses x, y [m], yaw [rad] (n, 3) of a simulated car at the scans."""
    if not poses:
        return None
    return load_simulator().true_path(backend, np.array([located.t for located in poses]))


def summarise_poses(poses: list[Located], truth: FloatArray | None, files: CarFiles,
                    map_std: float, end: float) -> dict[str, Any]:
    """Return the figures of the localisation.

    poses: one for each scan. truth (n, 3): the true pose at each scan, None if not known. files:
    those of the car, with the mounting of the lidar. map_std [m]: of the walls of the map. end
    [s]: now; a pose that is older than ``MAX_POSE_GAP`` is lost.
    """
    last = poses[-1] if poses else None
    silence = end - last.arrival if last else 0.0
    current = last if silence <= MAX_POSE_GAP else None
    found: dict[str, Any] = {
        "status": str(current.status) if current else "LOST", "scans": len(poses),
        "silent_s": 0.0 if current else silence,
        "agreement": last.agreement if last else None,
        "mirrored": bool(last and last.mirrored),
        "pose": current and current.pose and _pose_json(current.pose, files, map_std),
        "counts": dict(Counter(str(located.status) for located in poses))}
    found["why"] = "" if found["pose"] else _explain_missing_pose(found)
    pairs = [(located.pose, true) for located, true in zip(poses, truth, strict=True)
             if located.pose is not None] if truth is not None else []
    if pairs:
        # The yaw error is wrapped to +-pi: a full turn is no error.
        error = np.array([(pose.x - x, pose.y - y, remainder(pose.yaw - yaw, tau))
                          for pose, (x, y, yaw) in pairs])
        distance = np.hypot(error[:, 0], error[:, 1])
        found["error"] = {"rms_m": float(np.sqrt(np.mean(distance**2))),
                          "max_m": float(distance.max()),
                          "yaw_rms_rad": float(np.sqrt(np.mean(error[:, 2]**2)))}
    return found


def _pose_json(pose: Pose, files: CarFiles, map_std: float) -> dict[str, Any]:
    by_map = np.diag(np.square(list_map_errors(map_std)))
    covariance = pose.cov + mounting_covariance(files, pose.yaw) + by_map
    return {"x": pose.x, "y": pose.y, "yaw": remainder(pose.yaw, tau), "cov": covariance.tolist()}


def format_summary(found: dict[str, Any]) -> str:
    """Return the figures of the localisation as one sentence."""
    ended = f"ended: {found['ended']}; " if found["ended"] else ""
    if found["pose"] is None:
        return (f"{ended}{found['status']}: no pose after {found['scans']} scans; "
                f"{found['why']}")
    pose = found["pose"]
    std = np.sqrt(np.diag(np.array(pose["cov"])))
    text = (f"{ended}{found['status']}: x {pose['x']:.3f} m, y {pose['y']:.3f} m, "
            f"yaw {degrees(pose['yaw']):.2f} deg; standard errors {1e3 * std[0]:.1f} mm, "
            f"{1e3 * std[1]:.1f} mm, {degrees(std[2]):.2f} deg; the map explains "
            f"{100.0 * found['agreement']:.0f} % of the last scan")
    if "error" in found:
        error = found["error"]
        text += (f"; true error {100.0 * error['rms_m']:.2f} cm rms, {100.0 * error['max_m']:.2f} "
                 "cm "
                 f"at most, {degrees(error['yaw_rms_rad']):.2f} deg rms")
    return text


def _explain_missing_pose(found: dict[str, Any]) -> str:
    if not found["scans"]:
        return "check the lidar: dart-hal doctor"
    if found["silent_s"]:
        return f"no scan for the last {found['silent_s']:.1f} s; check the lidar: dart-hal doctor"
    if found["mirrored"]:
        return "the scans turn against the gyro: check inverted in [lidar]"
    if found["status"] == Status.AMBIGUOUS:
        return "the room looks the same from several places of the map: state --start X,Y,YAW"
    if found["status"] != Status.LOST:
        return "the last scan alone gave none"
    return (f"the map explains {100.0 * found['agreement']:.0f} % of the last scan; check that it "
            "is of this room, and the mounting in [lidar]")
