"""What a recorder makes of a stranger's drive: 14 columns, a row per mocap message."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from studies.diagnosis.stranger import Car, H, Truth, drive, gusts
from studies.diagnosis.stranger_drivers import driver

HEADER = ("elapsed time sensors,current,voltage,acc x (IMU),acc y (IMU),W (IMU),vel encoder,"
          "safety_value,throttle,steering,vicon time,vicon x,vicon y,vicon yaw")
GEAR = 0.04129216  # m of way per turn of the encoder ring: 2 pi 0.0233 m 11/39
COMMANDS = ("lockstep", "clock10", "clock20", "anytime")
PLACES = {  # Unix time, where the marker is: (m ahead of the rear axle, rad, m to the left)
    "sep24": (1_725_790_000.0, (0.115, 0.010, -0.010)),
    "jul24": (1_721_380_000.0, (0.0862, 0.0270, 0.0))}


@dataclass(frozen=True)
class Habits:
    """How a drive is driven and recorded; everybody does it a little differently.

    style: of the driver; commands: when they change; place: date and marker;
    aligned: messages fall on mocap rows; late (s, s): from sampling a message to
    its arrival; jitter [s]: of the mocap stamps; zero_rows: before the first
    message; moving: the file starts in the middle of the drive; counts: the
    encoder counts marks, else a mean speed; push, where: disturbance [N];
    mocap_columns: without them one row per message, 10 columns.
    """

    style: str = "steps"
    commands: str = "lockstep"
    place: str = "sep24"
    aligned: bool = False
    late: tuple[float, float] = (0.001, 0.008)
    jitter: float = 0.0
    zero_rows: int = 4
    moving: bool = False
    counts: bool = True
    push: float = 0.12
    where: str = "axles"
    mocap: tuple[float, float] = (2e-4, 5e-4)
    gyro: float = 0.003
    shake: float = 1.2
    mocap_columns: bool = True


def drawn(rng: np.random.Generator, styles: tuple[str, ...] = ("steps", "waves", "laps")) -> Habits:
    """Habits by lot."""
    return Habits(
        style=str(rng.choice(styles)), commands=str(rng.choice(COMMANDS, p=[0.5, 0.2, 0.15, 0.15])),
        place=str(rng.choice(["sep24", "sep24", "sep24", "jul24"])),
        aligned=bool(rng.random() < 0.35),
        late=((0.0, 0.0), (0.001, 0.008))[int(rng.random() < 0.7)],
        jitter=float(rng.choice([0.0, 1e-4])), zero_rows=int(rng.choice([0, 3, 11])),
        moving=bool(rng.random() < 0.3), counts=bool(rng.random() < 0.75),
        where=str(rng.choice(["centre", "body", "axles"])), mocap=(rng.uniform(1e-4, 3e-4), 5e-4))


def record(path: Path | str, car: Car, habits: Habits, seconds: float, seed: int) -> Path:
    """Drive for that long and write; the same seed gives the same file."""
    rng = np.random.default_rng(seed)
    rest = 0.0 if habits.moving else rng.uniform(1.0, 3.0)
    skip = 4.0 if habits.moving else 0.0
    end = skip + seconds + 0.3
    sent = _sent(habits, end, rng)
    truth = drive(car, driver(habits.style, end, rng, rest), _ticks(habits, sent, end, rng), end,
                  gusts(round(end / H) + 1, habits.push, habits.where, rng))
    stamps = skip + 0.2 + np.arange(round(seconds / 0.01)) * 0.01
    sent = sent[sent > skip + 0.2 + 0.01 * habits.zero_rows - 0.05]
    messages = _messages(truth, car, habits, sent, rng)
    if not habits.mocap_columns:
        inside = (sent >= stamps[0]) & (sent < stamps[-1])
        np.savetxt(path, messages[inside], fmt="%.7g", delimiter=",", newline="\r\n", comments="",
                   header=HEADER[:HEADER.index(",vicon")])
        return Path(path)
    heard = sent + rng.uniform(*habits.late, len(sent))
    which = np.searchsorted(heard, stamps + 1e-7, side="right") - 1
    rows = np.where((which >= 0)[:, None], messages[np.maximum(which, 0)], 0.0)
    if not habits.zero_rows:
        rows[which < 0] = messages[0]
    x, y, yaw = _poses(truth, car, habits, stamps, rng)
    epoch = PLACES[habits.place][0] + stamps + rng.normal(size=len(stamps)) * habits.jitter
    table = np.column_stack([rows, epoch, x, y, np.remainder(yaw + np.pi, 2 * np.pi) - np.pi])
    np.savetxt(path, table, fmt=["%.7g"] * 10 + ["%.7f", "%.6f", "%.6f", "%.6f"], delimiter=",",
               newline="\r\n", header=HEADER, comments="")
    return Path(path)


def _sent(habits: Habits, end: float, rng: np.random.Generator) -> np.ndarray:
    """When the sensors are sampled: every 0.1 s."""
    first = 0.1 if habits.aligned else rng.uniform(0.1, 0.2)
    return first + 0.1 * np.arange(int((end - first) / 0.1))


def _ticks(habits: Habits, sent: np.ndarray, end: float, rng: np.random.Generator) -> list[float]:
    """When the driver's commands may change."""
    if habits.commands == "lockstep":
        return list(sent)
    if habits.commands == "anytime":
        return list(np.cumsum(rng.uniform(0.02, 0.15, int(end / 0.02))))
    period = {"clock10": 0.1, "clock20": 0.05}[habits.commands]
    return list(np.arange(rng.uniform(0.0, period), end, period))


def _messages(truth: Truth, car: Car, habits: Habits, sent: np.ndarray, rng: np.random.Generator
              ) -> np.ndarray:
    """The ten columns of each message (m, 10)."""
    age = {key: car.age.get(key, 0.0) for key in ("encoder", "gyro", "accel")}
    gyro = truth.turn.copy()
    for hook in car.gyro:
        gyro = hook(gyro, truth)
    turn = np.interp(sent - age["gyro"], truth.t, gyro) + rng.normal(size=len(sent)) * habits.gyro
    ax, ay = _felt(truth, car)
    for hook in car.imu:
        ax, ay = hook(ax, ay, truth)
    shake = habits.shake * np.tanh(truth.at("v", sent) / 0.2) + 0.02
    felt = [np.interp(sent - age["accel"], truth.t, a) + shake * rng.normal(size=len(sent))
            for a in (ax, ay)]
    now = np.minimum(np.ceil(sent / H - 1e-6).astype(int), len(truth.t) - 1)
    zero, one = np.zeros(len(sent)), np.ones(len(sent))
    elapsed = (sent + 57.3).astype(np.float32).astype(float)
    return np.column_stack([
        elapsed, zero, zero, np.round(felt[0], 2), np.round(felt[1], 2),
        np.round(turn / 0.00109083) * 0.00109083,
        _encoder(truth, car, habits, sent - age["encoder"]), one, truth.u[now], truth.s[now]])


def _felt(truth: Truth, car: Car) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration at the place of the IMU, by the rigid body."""
    arm = car.imu_at - car.lr
    spin = np.gradient(truth.turn, H)
    beside = car.imu_left
    return (truth.ax - arm * truth.turn**2 - beside * spin,
            truth.ay + arm * spin - beside * truth.turn**2)


def _encoder(truth: Truth, car: Car, habits: Habits, when: np.ndarray) -> np.ndarray:
    """Marks that went by in the last 0.1 s, as a speed [m/s]."""
    speed = truth.v.copy()
    for hook in car.wheel:
        speed = hook(speed, truth)
    turns = np.concatenate([[0.0], np.cumsum(np.abs(speed[:-1])) * H]) / GEAR + 0.37
    before, after = (np.interp(w, truth.t, turns) for w in (when - 0.1, when))
    if not habits.counts and not car.lost_marks:
        reading = (after - before) * GEAR / 0.1
    else:
        marks, good = car.marks, car.marks - car.lost_marks

        def seen(u: np.ndarray) -> np.ndarray:
            whole = np.floor(u)
            return good * whole + np.minimum(np.floor((u - whole) * marks), good)

        reading = (seen(after) - seen(before)) * GEAR / marks / 0.1
    for hook in car.counted:
        reading = hook(reading, when, truth)
    return reading


def _poses(truth: Truth, car: Car, habits: Habits, stamps: np.ndarray, rng: np.random.Generator
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Marker frame in the room at the stamps, as the cameras have it."""
    lx, theta, ly = PLACES[habits.place][1]
    when = stamps - car.age.get("pose", 0.0)
    x, y, yaw = (truth.at(name, when) for name in ("x", "y", "yaw"))
    ahead, left, turned = lx - car.lr, ly, -theta
    for hook in car.pose:
        ahead, left, turned = hook(ahead, left, turned)
    c, s = np.cos(yaw), np.sin(yaw)
    fine, coarse = habits.mocap
    n = len(stamps)
    return (x + ahead * c - left * s + rng.normal(size=n) * fine,
            y + ahead * s + left * c + rng.normal(size=n) * fine,
            yaw + turned + rng.normal(size=n) * coarse)


def pair(folder: Path, car: Car, habits: Habits, seconds: tuple[float, float], seed: int
         ) -> tuple[Path, Path]:
    """A drive to learn from and one to judge by, of the same car and habits."""
    other = replace(habits, moving=False)
    return (record(folder / f"train_{seed}.csv", car, habits, seconds[0], 2 * seed),
            record(folder / f"test_{seed}.csv", car, other, seconds[1], 2 * seed + 1))


def full_turn() -> float:
    """Way of the car per turn of a wheel [m]."""
    return 2 * math.pi * 0.0233
