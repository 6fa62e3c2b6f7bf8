"""A class: a sealed car with a task of its own for each student, and the marks of all.

Seed, effect and order of the tasks follow from the secret of the class, so its file is all that a
lecturer keeps.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.text_file import read_text
from dart_hal.core.url import Url
from dart_lab.sim.marking import MarkingSheet, mark_car
from dart_lab.sim.sealed import NONCE_BYTES, SealedCar, seal, unseal

CLASS_SCHEMA = "dart-hal/class/1"
SECRET_BYTES = 32
# Of a seed, so that it cannot be found by trying.
SEED_BYTES = 16
MAX_STUDENTS = 500
# Names of a wrong folder that an error lists.
MAX_LISTED_FOLDERS = 5
# Faults of the tasks: smallest and largest size, in the unit of the catalogue. A refit would absorb
# a weaker motor or a longer lag into parameters of the model, and every hidden car has play and a
# limited rate of its servo. So only effects that are neither. How often the commands of the task
# find them: docs/how_to/classroom.md.
FAULT_SIZES = {
    "battery_fade": (-0.45, -0.3),
    "lateral_pull": (0.04, 0.06),
    "gyro_latency": (0.07, 0.09),
}
# Share of the cars without a fault: finding one there is a mistake.
HEALTHY_SHARE = 0.2
# Calibrations of every task: the diagnosis starts from them.
FIRST_PROCEDURES = ("encoder", "imu")
# One more for each car, after the diagnosis, which does not use it. A car whose battery fades ends
# the calibration of its ESC with an error.
LAST_PROCEDURES = ("steering",)


@dataclass(frozen=True, slots=True)
class StudentTask:
    """What one student gets: a URL, a fault to find, and a calibration after it."""

    student: str
    car: str
    url: str
    procedure: str


@dataclass(frozen=True, slots=True)
class Classroom:
    """A class as its lecturer keeps it."""

    secret: bytes
    tasks: tuple[StudentTask, ...]


@dataclass(frozen=True, slots=True)
class StudentMark:
    """Marks of one student; sheet: None if nothing was handed in, or nothing that can be read.

    fault: true fault and its size, empty for a healthy car. found: causes of the model that was
    handed in, None without a model. unreadable: why a file cannot be read, else empty.
    """

    student: str
    car: str
    fault: str
    found: tuple[str, ...] | None
    sheet: MarkingSheet | None
    unreadable: str = ""

    @property
    def fault_right(self) -> bool:
        """Whether the model has the true fault and no other, of any size."""
        true = (self.fault.partition(":")[0],) if self.fault else ()
        return self.found == true

    def to_json(self) -> dict[str, Any]:
        """Plain types."""
        return {"student": self.student, "car": self.car, "fault": self.fault,
                "found": self.found, "fault_right": self.fault_right,
                "unreadable": self.unreadable, "sheet": self.sheet and self.sheet.to_json()}


def make_class(students: Sequence[str], secret: bytes | None = None) -> Classroom:
    """Return a new class. secret: SECRET_BYTES bytes, drawn if None."""
    secret = secrets.token_bytes(SECRET_BYTES) if secret is None else secret
    return Classroom(secret, tuple(_make_task(k, name, secret)
                                   for k, name in enumerate(students)))


def _make_task(k: int, student: str, secret: bytes) -> StudentTask:
    # 1. Independent bytes of the secret: car, name, token, draws.
    digest = hmac.new(secret, f"car {k}".encode(), hashlib.sha512).digest()
    seed = int.from_bytes(digest[:SEED_BYTES], "big")
    name = f"class-{digest[16:20].hex()}"
    nonce = digest[20:20 + NONCE_BYTES]
    rng = np.random.default_rng(int.from_bytes(digest[32:], "big"))
    # 2. The fault and its size, and the calibration.
    fault = ""
    if rng.uniform() >= HEALTHY_SHARE:
        effect = list(FAULT_SIZES)[int(rng.integers(len(FAULT_SIZES)))]
        fault = f"{effect}:{rng.uniform(*FAULT_SIZES[effect]):.3g}"
    procedure = LAST_PROCEDURES[int(rng.integers(len(LAST_PROCEDURES)))]
    # 3. The token, signed for the reveal.
    token = seal(SealedCar(name, seed, fault), secret, nonce)
    return StudentTask(student, name, f"sim://?nano=mock&mocap=1&sealed={token}", procedure)


def write_class(classroom: Classroom, folder: Path) -> Path:
    """Write the file of the lecturer, which only its owner can read, and the tasks; return the
    former. Raises UsageError for a folder that has a class already."""
    lecturer = folder / "lecturer" / "class.json"
    if lecturer.exists():
        raise UsageError(f"{folder} has a class already", found=str(lecturer),
                         expected="a new folder", remedy="dart-hal class --students N --out NEW")
    lecturer.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"schema": CLASS_SCHEMA, "secret": classroom.secret.hex(),
                       "tasks": [asdict(task) for task in classroom.tasks]}, indent=2)
    # Created with its final mode: at no time can others read it.
    with os.fdopen(os.open(lecturer, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w",
                   encoding="utf-8") as file:
        file.write(text + "\n")
    tasks = folder / "students"
    tasks.mkdir(exist_ok=True)
    for k, task in enumerate(classroom.tasks, 1):
        (tasks / f"{k:03d}.md").write_text(format_task(task), encoding="utf-8")
    return lecturer


def read_class(path: Path) -> Classroom:
    """Read the file of a lecturer. Raises UsageError, ConfigError."""
    try:
        data = json.loads(read_text(path))
        tasks = tuple(StudentTask(t["student"], t["car"], t["url"], t["procedure"])
                      for t in data["tasks"])
        return Classroom(bytes.fromhex(data["secret"]), tasks)
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{path} is no file of a class", found=str(path),
                         expected="lecturer/class.json of dart-hal class") from None


def format_task(task: StudentTask) -> str:
    """Return the page of a student; its commands are complete and in order."""
    only = " ".join(f"--only {name}" for name in FAULT_SIZES)
    first = "\n".join(f"dart-hal calibrate {p} --yes --cars cars" for p in FIRST_PROCEDURES)
    return f"""# Car {task.car}, for {task.student}

1. Calibrate {" and ".join(FIRST_PROCEDURES)}, and record two drives.
2. The car may have one of these faults, or none: {", ".join(FAULT_SIZES)}. Find it.
3. Calibrate {task.procedure}.
4. Hand in the folder `cars/{task.car}`.

```sh
export DART_HAL_URL='{task.url}'
{first}
dart-hal experiment steps --no-fit --out train.mcap --cars cars
dart-hal experiment weave --no-fit --out test.mcap --cars cars
dart-hal diagnose --train train.mcap --test test.mcap \\
  {only} \\
  --out cars/{task.car}/model.toml --html report.html
dart-hal calibrate {task.procedure} --yes --cars cars
```
"""


def true_fault(task: StudentTask) -> str:
    """Return the fault of a car as in ``effect=``, empty for a healthy one."""
    return unseal(Url.parse(task.url).options["sealed"]).effect


def mark_class(classroom: Classroom, cars: Path) -> tuple[StudentMark, ...]:
    """Mark what was handed in: the folders of all cars, in one folder.

    Raises UsageError for a folder without any car of the class.
    """
    if not any((cars / task.car).is_dir() for task in classroom.tasks):
        raise UsageError(f"{cars} has no car of this class", found=", ".join(
            sorted(path.name for path in cars.iterdir())[:MAX_LISTED_FOLDERS]) or "an empty folder",
            expected=f"folders such as {classroom.tasks[0].car}, one for each student",
            remedy="copy the folders that were handed in into one folder, without a level between")
    return tuple(_mark_student(task, classroom.secret, cars) for task in classroom.tasks)


def _mark_student(task: StudentTask, secret: bytes, cars: Path) -> StudentMark:
    folder = cars / task.car
    sheet = None
    unreadable = ""
    if any((folder / name).is_file() for name in ("calibration.toml", "model.toml")):
        try:
            sheet = mark_car(Url.parse(task.url), [cars], secret)
        except DartHalError as error:  # the others are marked nevertheless
            unreadable = f"{error.what}: {error.found}" if error.found else error.what
    found = sheet.causes if sheet is not None else None
    return StudentMark(task.student, task.car, true_fault(task), found, sheet, unreadable)
