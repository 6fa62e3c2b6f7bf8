"""What a page is told of a car besides its samples: mode, what keeps it from driving, health."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from dart_hal.car import Car
from dart_hal.core.types import FloatArray, State
from dart_hal.fleet.peers import OtherPose
from dart_lab.live.view.rows import FIELDS
from dart_lab.live.view.words import Words, refusal_words, trip_words

IDLE = ("DISARMED", "TRIPPED", "LOCKED", "FAULT")
"""Modes in which it matters what would keep the car from arming."""
AFTER_STOP = ("RUN_STOP", "ENCODER_MOVING")
"""Refusals that follow from a stop and end by themselves: it is pressed, and the car rolls out."""
MOST_LINES = 4000
"""Lines of a map that are drawn; a room of boards has 30, a grid of 10 m some thousand."""


Lines = FloatArray | Mapping[str, FloatArray] | None
"""Lines (m, 4) [m] of a map: in whatever frame the poses are, or by frame."""


def begin(car: Car, lines: Lines, drives: bool) -> dict[str, Any]:
    """Once for each page: who the car is, and the map by frame ("": any) in which it drives."""
    limits = car.files.config.limits
    told = {"type": "begin", "car": car.files.config.name, "url": car.url, "fields": FIELDS,
            "drives": drives, "camera": car.has_camera, "lock": limits.max_steering,
            "notices": list(car.notices)}
    maps = lines if isinstance(lines, Mapping) else {} if lines is None else {"": lines}
    told["maps"] = {frame: each[:MOST_LINES].round(2).tolist() for frame, each in maps.items()}
    return told


def others_in(frame: str, poses: Mapping[str, OtherPose]) -> dict[str, Any]:
    """The other cars whose poses are in the frame of this one; elsewhere they would be drawn at
    places where they are not."""
    return {"type": "others", "poses": [
        {"name": f"{one.name} (lost)" if one.lost else one.name, "x": round(one.pose.x, 3),
         "y": round(one.pose.y, 3), "yaw": round(one.pose.yaw, 3)}
        for one in poses.values() if one.frame == frame]}


def status(car: Car, state: State, extra: Mapping[str, Any]) -> dict[str, Any]:
    """Some times a second; ``extra``: what the desk adds, such as who drives."""
    health, timing = state.health, car.timing
    external = state.external
    return {"type": "status", "t": round(state.t, 3), "mode": car.mode,
            "frame": state.estimate.frame, "tracking": str(state.estimate.tracking),
            "limited": list(state.applied.limited), "doubts": sorted(health.doubts),
            "flags": sorted(health.flags), "vcc": health.vcc,
            "us": [round(state.applied.steering_us, 1), round(state.applied.throttle_us, 1)],
            "link": {"lost": timing.lost, "damaged": timing.damaged,
                     "age_ms": round(1e3 * timing.link_age, 1)},
            "loop": {"p99_ms": _ms(timing.p99), "late": timing.late, "skipped": timing.skipped},
            "camera": camera(car, state) if car.has_camera else None,
            "pose_age": None if external is None or external.age > 1e6 else round(external.age, 3),
            "refusals": refusals(car) if car.mode in IDLE else [], "trips": trips(car),
            "cautions": [str(c) for c in car.cautions], **extra}


def camera(car: Car, state: State) -> dict[str, Any]:
    """How its images come: when the newest was taken [s], pace [1/s], what to look at."""
    health, trouble = car.camera.health, car.camera.trouble
    told = trouble.what if trouble else "; ".join(health.sentences() if health else ())
    return {"t": state.image and round(state.image.t, 3),
            "rate": health and round(health.rate, 1), "told": told}


def refusals(car: Car) -> list[dict[str, str]]:
    """What keeps the car from arming, and what to do."""
    names = [name for name in car.refusals() if car.mode == "DISARMED" or name not in AFTER_STOP]
    return [_item(name, refusal_words(name, car.stop_reason)) for name in names]


def trips(car: Car) -> dict[str, str] | None:
    """What tripped the car last, while it is TRIPPED or LOCKED."""
    if car.mode not in ("TRIPPED", "LOCKED") or not car.causes:
        return None
    words = [trip_words(name, car.stop_reason) for name in car.causes]
    remedies = dict.fromkeys(remedy for _, remedy in words)
    return _item(", ".join(car.causes), (" ".join(text for text, _ in words), " ".join(remedies)))


def not_armed(car: Car, names: Iterable[str]) -> str:
    """Why the car did not arm, in one line."""
    return "Not armed. " + " ".join(
        text for name in names for text in refusal_words(name, car.stop_reason))


def _item(name: str, words: Words) -> dict[str, str]:
    return {"name": name, "text": words[0], "remedy": words[1]}


def _ms(seconds: float) -> float | None:
    return round(1e3 * seconds, 1) if seconds == seconds else None
