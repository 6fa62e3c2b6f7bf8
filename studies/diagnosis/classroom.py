"""Follow the task pages of a class of hidden cars, command by command, and print its marks.

    .venv/bin/python -m studies.diagnosis.classroom --students 8

Each student does what the page states, in a folder of their own. The secret of the class is drawn
from ``--seed``, so that a run can be repeated.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from dart_lab.sim.classroom import make_class, mark_class, read_class, write_class


def read_commands(page: str) -> Iterator[list[str]]:
    """Yield the commands of the shell block of a page, as arguments."""
    block = re.search("```sh\n(.*?)```", page, re.DOTALL)
    assert block is not None
    for line in block[1].replace("\\\n", " ").splitlines():
        if line.strip():
            yield shlex.split(line)


def follow_page(page: Path, folder: Path) -> None:
    """Run the commands of a page in a folder."""
    environment = dict(os.environ)
    program = Path(sys.executable).with_name("dart-hal")
    for name, *arguments in read_commands(page.read_text(encoding="utf-8")):
        if name == "export":
            key, _, value = arguments[0].partition("=")
            environment[key] = value
            continue
        assert name == "dart-hal", name
        subprocess.run([program, *arguments], cwd=folder, env=environment, check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main() -> None:
    """Print the mark of each student, and the count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--students", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=1, help="number of the first student")
    options = parser.parse_args()
    secret = hashlib.sha256(f"class {options.seed}".encode()).digest()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        names = [str(k + 1) for k in range(options.students)]
        classroom = read_class(write_class(make_class(names, secret), folder))
        right = 0
        for k in range(options.first, options.students + 1):
            work = folder / f"work-{k}"
            work.mkdir()
            follow_page(folder / "students" / f"{k:03d}.md", work)
            shutil.copytree(work / "cars", folder / "cars", dirs_exist_ok=True)
            mark = mark_class(classroom, folder / "cars")[k - 1]
            right += mark.fault_right
            print(f"{mark.car}: true {mark.fault or 'no fault'}, found "
                  f"{', '.join(mark.found or ()) or 'no fault'}, "
                  f"{'RIGHT' if mark.fault_right else 'WRONG'}", flush=True)
        print(f"{right} of {options.students - options.first + 1} right")


if __name__ == "__main__":
    main()
