"""``dart-hal class``: sealed cars that a student cannot reveal, and right marks."""

from __future__ import annotations

import json
import re
import shutil
import stat
from pathlib import Path

import msgspec
import pytest

from dart_hal.car import Car
from dart_hal.core.config import (
    Calibration,
    EffectEntry,
    Quantity,
    save_calibration,
    save_model,
)
from dart_hal.core.config.calibration import ImuCalibration
from dart_hal.core.url import Url
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.file import model_of
from dart_lab.sim.classroom import FAULT_SIZES, make_class, read_class, true_fault, write_class
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.sealed import unseal
from dart_lab.sim.truth import reveal_url
from studies.diagnosis.classroom import follow_page

SECRET_OF_TEST = bytes(range(32))
# Of a class of two with these faults.
SECRET_OF_PAIR = bytes(32)
PAIR_FAULTS = ["gyro_latency", "battery_fade"]


@pytest.fixture
def lecturer(verb):
    """File of a class of twelve."""
    answer = verb("class", "--students", 12, "--json").json
    assert answer["count"] == 12
    return Path(answer["lecturer"])


def url_in(page: Path) -> str:
    return re.search("'(sim://[^']*)'", page.read_text(encoding="utf-8"))[1]


def true_parts(url):
    """Texts that would give a sealed car away."""
    car = unseal(Url.parse(url).options["sealed"])
    return car, (str(car.seed), f"{car.seed:x}", *([car.effect] if car.effect else []))


def test_names_in_latin_1_are_refused_with_the_line(verb, tmp_path):
    names = tmp_path / "names.txt"
    names.write_bytes("Ada\nJörg\n".encode("latin-1"))
    answer = verb("class", "--names", names)
    assert answer.code == 2
    assert "line 2 has the byte 0xf6" in answer.err
    assert "save it as UTF-8" in answer.err


def test_one_task_at_a_time(verb, tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("Ada\n", encoding="utf-8")
    answer = verb("class", "--names", names, "--students", 3)
    assert answer.code == 2
    assert "--students --names" in answer.err


def test_two_students_of_one_name_are_refused(verb, tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("Ada\nAlan\nAda\n", encoding="utf-8")
    answer = verb("class", "--names", names)
    assert answer.code == 2
    assert "students twice" in answer.err
    assert "Ada" in answer.err
    assert not Path("class").exists()


def test_each_student_has_a_task_of_their_own(lecturer):
    pages = sorted(Path("class/students").iterdir())
    urls = {url_in(page) for page in pages}
    assert len(urls) == len(pages) == 12
    assert len({len(url) for url in urls}) == 1  # its length does not show the fault
    classroom = read_class(lecturer)
    assert len({task.car for task in classroom.tasks}) == 12
    faults = {true_fault(task).partition(":")[0] for task in classroom.tasks}
    assert len(faults) > 1
    assert faults <= {"", *FAULT_SIZES}
    assert stat.S_IMODE(lecturer.stat().st_mode) == 0o600


def test_two_classes_have_no_car_in_common():
    one, other = make_class(["a", "b"]), make_class(["a", "b"])
    assert not {task.car for task in one.tasks} & {task.car for task in other.tasks}
    assert make_class(["a"], SECRET_OF_TEST) == make_class(["a"], SECRET_OF_TEST)


def test_what_a_student_gets_does_not_hold_the_truth(lecturer):
    for page in Path("class/students").iterdir():
        text = page.read_text(encoding="utf-8")
        car, parts = true_parts(url_in(page))
        assert not any(part in text for part in parts)
        assert f"sim-{car.seed}" not in text


@pytest.mark.slow
def test_a_seed_is_not_found_by_trying(lecturer):
    """It has 128 bits, and no car of a small seed is the sealed one."""
    cars = [reveal_url(Url.parse(task.url), read_class(lecturer).secret)
            for task in read_class(lecturer).tasks]
    assert sum(car["seed"] >> 64 > 0 for car in cars) == len(cars)
    sealed = {car["sensors"]["pwm.oscillator_hz"] for car in cars}
    assert not sealed & {hidden_car(seed).oscillator_hz for seed in range(3000)}
    # Negative control: the search does find a car of a small seed.
    assert {hidden_car(7).oscillator_hz} & {hidden_car(seed).oscillator_hz for seed in range(10)}


@pytest.mark.parametrize("arguments", [
    ["sim", "--reveal"], ["sim", "--reveal", "--against", "."], ["demo"]])
def test_a_student_cannot_reveal(verb, lecturer, arguments):
    url = url_in(Path("class/students/001.md"))
    refused = verb(*arguments, "--url", url, "--json")
    assert refused.code == 2
    assert "only its lecturer" in refused.error["what"]
    _, parts = true_parts(url)
    assert not any(part in refused.out + refused.err for part in parts)


def test_the_file_of_another_class_does_not_reveal(verb, lecturer):
    url = url_in(Path("class/students/001.md"))
    other = verb("class", "--students", 1, "--out", "other", "--json").json["lecturer"]
    error = verb("sim", "--reveal", "--url", url, "--lecturer", other, "--json").error
    assert "another class" in str(error["found"])


def test_the_lecturer_reveals(verb, lecturer):
    """Negative control of the refusals."""
    url = url_in(Path("class/students/001.md"))
    shown = verb("sim", "--reveal", "--url", url, "--lecturer", lecturer, "--json").json
    car, _ = true_parts(url)
    assert shown["seed"] == car.seed
    assert [e["name"] for e in shown["effects"]] == [
        text.partition(":")[0] for text in [car.effect] if text]


@pytest.mark.parametrize("option", ["seed=3", "effect=mass:0.1", "vehicle=paper",
                                    "physics=kinematic", "ring=even"])
def test_a_sealed_car_takes_no_option_that_replaces_it(verb, lecturer, option):
    url = url_in(Path("class/students/001.md"))
    refused = verb("record", "--url", f"{url}&{option}", "--duration", 0.1, "--json")
    assert "a sealed car is complete" in refused.error["what"]


def test_a_changed_token_is_refused_in_words(verb):
    refused = verb("record", "--url", "sim://?sealed=abcdef", "--json")
    assert "no token of a class" in refused.error["what"]


def test_a_recording_does_not_hold_the_truth(tmp_path):
    faulty = next(t for t in make_class(["a"] * 9, SECRET_OF_TEST).tasks if true_fault(t))
    path = tmp_path / "run.mcap"
    with Car.open(faulty.url, cars=tmp_path, record=path) as car:
        for _ in car.states(duration=0.3):
            pass
        assert car.files.config.name == faulty.car
        written = repr(car.files)
    _, parts = true_parts(faulty.url)
    raw = path.read_bytes()
    assert faulty.car.encode() in raw
    assert not any(part.encode() in raw or part in written for part in parts)


def test_the_marks_are_right(verb):
    classroom = make_class([str(k) for k in range(6)], SECRET_OF_TEST)
    lecturer = write_class(classroom, Path("class"))
    tasks = classroom.tasks
    # Cars whose fault does not change what the IMU measures.
    right, wrong = [t for t in tasks if true_fault(t).startswith("battery_fade")]
    secret = read_class(lecturer).secret
    for task, error in ((right, 0.0), (wrong, 5.0)):
        true = reveal_url(Url.parse(task.url), secret)["sensors"]["imu.gyro_scale"]
        save_calibration(Calibration(car=task.car, imu=ImuCalibration(
            gyro_scale=Quantity(true + error * 1e-3, 1e-3))), Path("handed_in") / task.car)
    name, _, size = true_fault(right).partition(":")
    model = msgspec.structs.replace(model_of(PAPER), effects=(
        EffectEntry(name, {"k": Quantity(float(size), 0.01 * abs(float(size)))}),))
    save_model(model, Path("handed_in") / right.car / "model.toml")
    save_model(model_of(PAPER), Path("handed_in") / wrong.car / "model.toml")
    answer = verb("class", "--lecturer", lecturer, "--mark", "handed_in", "--json").json
    marks = {mark["car"]: mark for mark in answer["marks"]}
    assert marks[right.car]["fault_right"]
    assert marks[right.car]["sheet"]["inside"] == marks[right.car]["sheet"]["count"] == 2
    assert not marks[wrong.car]["fault_right"]
    assert marks[wrong.car]["sheet"]["inside"] == 0
    assert sum(mark["sheet"] is None for mark in marks.values()) == len(tasks) - 2
    lines = verb("class", "--lecturer", lecturer, "--mark", "handed_in").out.splitlines()
    assert len(lines) == len(tasks) + 1
    assert lines[-1] == f"1 of {len(tasks)} faults right"


def test_a_healthy_car_is_right_without_a_fault(verb, lecturer):
    healthy = next(k for k in range(50) if not true_fault(
        make_class([str(i) for i in range(50)], SECRET_OF_TEST).tasks[k]))
    classroom = make_class([str(i) for i in range(healthy + 1)], SECRET_OF_TEST)
    task = classroom.tasks[healthy]
    path = Path("one.json")
    path.write_text(json.dumps({"secret": SECRET_OF_TEST.hex(), "tasks": [{
        "student": task.student, "car": task.car, "url": task.url,
        "procedure": task.procedure}]}), encoding="utf-8")
    save_model(model_of(PAPER), Path("handed_in") / task.car / "model.toml")
    mark = verb("class", "--lecturer", path, "--mark", "handed_in", "--json").json["marks"][0]
    assert mark["fault_right"]


def test_a_file_that_cannot_be_read_leaves_the_others_marked(verb, lecturer):
    tasks = read_class(lecturer).tasks
    for task in tasks[:2]:
        save_model(model_of(PAPER), Path("handed_in") / task.car / "model.toml")
    (Path("handed_in") / tasks[0].car / "model.toml").write_text("[body", encoding="utf-8")
    lines = verb("class", "--lecturer", lecturer, "--mark", "handed_in").out.splitlines()
    assert "cannot be read" in lines[0]
    assert "model.toml is not valid TOML" in lines[0]
    assert "no fault" in lines[1]
    assert lines[2].endswith("nothing handed in")


@pytest.mark.parametrize("causes", ["3", "[1]", '"battery_fade"'])
def test_causes_that_are_no_names_leave_the_others_marked(verb, lecturer, causes):
    tasks = read_class(lecturer).tasks
    for task in tasks[:2]:
        save_model(model_of(PAPER), Path("handed_in") / task.car / "model.toml")
    with (Path("handed_in") / tasks[0].car / "model.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n[provenance]\ncauses = {causes}\n")
    lines = verb("class", "--lecturer", lecturer, "--mark", "handed_in").out.splitlines()
    assert "names no effects" in lines[0]
    assert "no fault" in lines[1]


def test_a_folder_without_any_car_of_the_class_is_refused(verb, lecturer):
    (Path("handed_in") / "monday" / read_class(lecturer).tasks[0].car).mkdir(parents=True)
    error = verb("class", "--lecturer", lecturer, "--mark", "handed_in", "--json").error
    assert error["found"] == "monday"
    assert "has no car of this class" in error["what"]


def test_a_class_is_not_overwritten(verb, lecturer):
    assert "has a class already" in verb("class", "--students", 3, "--json").error["what"]


@pytest.mark.long
def test_a_student_who_follows_the_page_is_marked_right(verb, tmp_path):
    """Each command of the page, as it is printed; who copies the answer of another is wrong."""
    classroom = make_class(["diligent", "copying"], SECRET_OF_PAIR)
    assert [true_fault(task).partition(":")[0] for task in classroom.tasks] == PAIR_FAULTS
    lecturer = write_class(classroom, tmp_path / "class")
    work = tmp_path / "work"
    work.mkdir()
    follow_page(tmp_path / "class" / "students" / "001.md", work)
    diligent, copying = (task.car for task in classroom.tasks)
    shutil.copytree(work / "cars", "handed_in")
    shutil.copytree(work / "cars" / diligent, Path("handed_in") / copying)
    (Path("handed_in") / copying / "calibration.toml").unlink()
    # What the student has does not hold the truth.
    _, parts = true_parts(classroom.tasks[0].url)
    for path in work.rglob("*"):
        if path.is_file():
            assert not [part for part in parts if part.encode() in path.read_bytes()], path
    marks = verb("class", "--lecturer", lecturer, "--mark", "handed_in", "--json").json["marks"]
    assert [mark["fault_right"] for mark in marks] == [True, False]
    assert marks[0]["sheet"]["count"] > 1
