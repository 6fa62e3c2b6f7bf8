"""Messages to a page about a car, other than its samples: mode, refusals, trips, health."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from dart_hal.car import Car
from dart_hal.core.types import FloatArray, State
from dart_hal.fleet.peers import OtherPose
from dart_lab.live.view.rows import FIELDS
from dart_lab.live.view.words import Words, refusal_words, trip_words

# Modes in which the page lists the reasons against arming.
IDLE_MODES = ("DISARMED", "TRIPPED", "LOCKED", "FAULT")
# Refusals that follow from a stop and end by themselves: the stop holds, and the car rolls out.
AFTER_STOP = ("RUN_STOP", "ENCODER_MOVING")
# Lines of a map that are drawn. A room of boards has 30, a grid of 10 m some thousand.
MAX_MAP_LINES = 4000
# Lines (m, 4) [m] of a map: in the frame of the poses, or by frame.
Lines = FloatArray | Mapping[str, FloatArray] | None


def begin_message(car: Car, lines: Lines, drives: bool) -> dict[str, Any]:
    """Return the first message to a page: the car, and the map by frame ("": any)."""
    limits = car.files.config.limits
    message = {"type": "begin", "car": car.files.config.name, "url": car.url, "fields": FIELDS,
               "drives": drives, "camera": car.has_camera, "lock": limits.max_steering,
               "notices": list(car.notices)}
    maps = lines if isinstance(lines, Mapping) else {} if lines is None else {"": lines}
    message["maps"] = {frame: each[:MAX_MAP_LINES].round(2).tolist() for frame,
                       each in maps.items()}
    return message


def others_message(frame: str, poses: Mapping[str, OtherPose]) -> dict[str, Any]:
    """Return the message with the other cars whose poses are in ``frame``.

    Poses in another frame would be drawn at wrong places.
    """
    return {"type": "others", "poses": [
        {"name": f"{one.name} (lost)" if one.lost else one.name, "x": round(one.pose.x, 3),
         "y": round(one.pose.y, 3), "yaw": round(one.pose.yaw, 3)}
        for one in poses.values() if one.frame == frame]}


def status_message(car: Car, state: State, extra: Mapping[str, Any]) -> dict[str, Any]:
    """Return the status message, sent some times a second; ``extra``: more fields."""
    health = state.health
    timing = car.timing
    external = state.external
    return {"type": "status", "t": round(state.t, 3), "mode": car.mode,
            "frame": state.estimate.frame, "tracking": str(state.estimate.tracking),
            "limited": list(state.applied.limited), "doubts": sorted(health.doubts),
            "flags": sorted(health.flags), "vcc": health.vcc,
            "battery": state.battery and round(state.battery, 2),
            "us": [round(state.applied.steering_us, 1), round(state.applied.throttle_us, 1)],
            "link": {"lost": timing.lost, "damaged": timing.damaged,
                     "age_ms": round(1e3 * timing.link_age, 1)},
            "loop": {"p99_ms": _ms(timing.p99), "late": timing.late, "skipped": timing.skipped},
            "camera": camera_status(car, state) if car.has_camera else None,
            "pose_age": None if external is None or external.age > 1e6 else round(external.age, 3),
            "refusals": refusal_items(car) if car.mode in IDLE_MODES else [],
            "trips": trip_item(car),
            "cautions": [str(c) for c in car.cautions], **extra}


def camera_status(car: Car, state: State) -> dict[str, Any]:
    """Return time of the newest image [s], images per second and problems of the camera."""
    health = car.camera.health
    error = car.camera.trouble
    problems = error.what if error else "; ".join(health.sentences() if health else ())
    return {"t": state.image and round(state.image.t, 3),
            "rate": health and round(health.rate, 1), "told": problems}


def refusal_items(car: Car) -> list[dict[str, str]]:
    """Return the refusals of arm() with message and remedy."""
    names = [name for name in car.refusals() if car.mode == "DISARMED" or name not in AFTER_STOP]
    return [_item(name, refusal_words(name, car.stop_reason)) for name in names]


def trip_item(car: Car) -> dict[str, str] | None:
    """Return the last trip with message and remedy, while the car is TRIPPED or LOCKED."""
    if car.mode not in ("TRIPPED", "LOCKED") or not car.causes:
        return None
    words = [trip_words(name, car.stop_reason) for name in car.causes]
    remedies = dict.fromkeys(remedy for _, remedy in words)
    return _item(", ".join(car.causes), (" ".join(text for text, _ in words), " ".join(remedies)))


def describe_refusals(car: Car, names: Iterable[str]) -> str:
    """Return one line with the reasons why the car did not arm."""
    return "Not armed. " + " ".join(
        text for name in names for text in refusal_words(name, car.stop_reason))


def _item(name: str, words: Words) -> dict[str, str]:
    return {"name": name, "text": words[0], "remedy": words[1]}


def _ms(seconds: float) -> float | None:
    return round(1e3 * seconds, 1) if seconds == seconds else None
