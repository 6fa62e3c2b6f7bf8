# ruff: noqa: N999 - the module has the name of its verb
"""``dart-hal class``: hidden cars for a class, and its marks."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click

from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import print_json, print_line
from dart_hal.core.errors import UsageError
from dart_hal.core.text_file import read_text
from dart_lab.sim.classroom import (
    MAX_STUDENTS,
    Classroom,
    StudentMark,
    make_class,
    mark_class,
    read_class,
    true_fault,
    write_class,
)


@click.command("class")
@click.option("--students", type=click.IntRange(1, MAX_STUDENTS), default=None, metavar="N",
              help="set up a car and a task for each of N students")
@click.option("--names", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              default=None, metavar="FILE", help="the same for the names in a file, one a line")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("class"),
              metavar="FOLDER", show_default=True,
              help="write the result: lecturer/class.json, students/NNN.md")
@click.option("--mark", type=click.Path(path_type=Path, exists=True, file_okay=False),
              default=None, metavar="CARS",
              help="mark the cars' folders that the students handed in")
@click.option("--lecturer", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              default=None, metavar="FILE",
              help="the file of the class: print its truth, or --mark by it")
@json_option
def command(students: int | None, names: Path | None, out: Path, mark: Path | None,
            lecturer: Path | None, as_json: bool) -> None:
    """Set up hidden cars with tasks for a class, or mark what it handed in.

    Give each student one file of students/. Keep lecturer/class.json: only
    with it can the cars be revealed.
    """
    given = [option for option, value in (("--students", students), ("--names", names),
                                          ("--lecturer", lecturer)) if value is not None]
    if len(given) != 1:
        raise UsageError("one task for the class at a time", found=" ".join(given) or "no option",
                         expected="--students N, --names FILE, or --lecturer FILE [--mark CARS]")
    # One of three tasks: set up, print the truth, mark.
    if mark is not None and lecturer is None:
        raise UsageError("--mark needs the file of the class", found="no --lecturer",
                         expected="--lecturer class/lecturer/class.json --mark CARS")
    if lecturer is None:
        _set_up(_read_names(students, names), out, as_json)
    elif mark is None:
        _print_truth(read_class(lecturer), as_json)
    else:
        _print_marks(mark_class(read_class(lecturer), mark), as_json)


def _read_names(students: int | None, names: Path | None) -> list[str]:
    if names is None:
        return [f"student {k}" for k in range(1, (students or 0) + 1)]
    try:
        text = read_text(names)
    except UnicodeDecodeError as error:
        line = error.object[:error.start].count(b"\n") + 1
        raise UsageError(f"{names} is no UTF-8 text", found=f"line {line} has the byte "
                         f"{error.object[error.start]:#04x}", expected="UTF-8 or UTF-16",
                         remedy="save it as UTF-8 text: in Excel, CSV UTF-8") from error
    # Empty lines are no students.
    found = [line.strip() for line in text.splitlines() if line.strip()]
    if not 1 <= len(found) <= MAX_STUDENTS:
        raise UsageError(f"{names} names {len(found)} students", found=str(names),
                         expected=f"1 to {MAX_STUDENTS}, one a line")
    twice = sorted(name for name, count in Counter(found).items() if count > 1)
    if twice:
        raise UsageError(f"{names} names students twice", found=", ".join(twice),
                         expected="another name for each, because marks are listed by name",
                         remedy="add a number or a first name")
    return found


def _set_up(students: list[str], out: Path, as_json: bool) -> None:
    path = write_class(make_class(students), out)
    if as_json:
        print_json({"lecturer": path, "students": out / "students", "count": len(students)})
        return
    print_line(f"{len(students)} tasks: {out / 'students'}")
    print_line(f"keep to yourself: {path}")


def _print_truth(classroom: Classroom, as_json: bool) -> None:
    """Print the car and the fault of each student."""
    if as_json:
        print_json({"tasks": [{"student": t.student, "car": t.car, "url": t.url,
                               "procedure": t.procedure, "fault": true_fault(t)}
                              for t in classroom.tasks]})
        return
    for task in classroom.tasks:
        print_line(f"{task.student}: {task.car}, {true_fault(task) or 'no fault'}")


def _print_marks(marks: tuple[StudentMark, ...], as_json: bool) -> None:
    """Print one line for each student, and the count."""
    if as_json:
        print_json({"marks": [mark.to_json() for mark in marks]})
        return
    for mark in marks:
        if mark.sheet is None:
            print_line(f"{mark.student}: {mark.car}: " + (
                f"cannot be read: {mark.unreadable}" if mark.unreadable else "nothing handed in"))
            continue
        # A model without effects is an answer, too: the car has no fault.
        found = "no model" if mark.found is None else ", ".join(mark.found) or "no fault"
        print_line(f"{mark.student}: {mark.car}: {mark.sheet.inside} of {len(mark.sheet.marks)} "
                   f"inside; {found} {'RIGHT' if mark.fault_right else 'WRONG'} "
                   f"(true: {mark.fault or 'no fault'})")
    # The count comes last, where a terminal shows it.
    right = sum(mark.fault_right for mark in marks)
    print_line(f"{right} of {len(marks)} faults right")
