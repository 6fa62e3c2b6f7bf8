"""The commands of README and tutorials work, and prints what they show.

Each page runs in a folder of its own that looks like a checkout, with a home of
its own: on MockNano without its long blocks, and as a whole on the firmware.
Blocks that are not run have commands, options and files that exist.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import handbook
import pytest
from handbook import DOCS, ROOT, Block
from test_guide import unknown_command

PAGES = [ROOT / "README.md", *sorted((DOCS / "tutorials").glob("*.md"))]
READ = ("examples", "hardware", "host", "studies", "tests")
"""Of the checkout; all that a page writes stays in the test's own folder, with a copy of cars/."""


OTHER_ON_MOCK = ("first_controller",)
"""Pages with numbers of the firmware alone: MockNano answers some milliseconds later, and a
controller that swings on a car with a lag swings further there (127 instead of 88 mm)."""
COMMAND_TIMEOUT_S = 2400
"""s for one block; all calibrations on the firmware take two minutes of an idle machine."""


def play(page: Path, folder: Path, *, slow: bool) -> list[Block]:
    """Run the blocks of a page in order; those that ran. AssertionError at the first wrong one."""
    for name in READ:
        (folder / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / "cars" / "dart-01", folder / "cars" / "dart-01")
    home = folder / "home"
    home.mkdir()
    env = {k: v for k, v in os.environ.items() if not k.startswith("DART_")}
    env |= {"HOME": str(home), "XDG_DATA_HOME": str(home),
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{env['PATH']}"}
    if not slow:
        env["DART_HAL_URL"] = "sim://?nano=mock"
    ran = []
    printed = ""
    for block in handbook.blocks(page.read_text(encoding="utf-8")):
        where = f"{page.name}, line {block.line}"
        text = block.text if slow else block.text.replace("sim://?", "sim://?nano=mock&")
        if block.file:
            (folder / block.file).write_text(text, encoding="utf-8")
        elif block.mark == "output":
            if ran and printed:
                any_numbers = not slow and page.stem in OTHER_ON_MOCK
                assert handbook.as_shown(block.text, printed, any_numbers=any_numbers), (
                    f"{where}: printed\n{printed}")
        elif block.runs and (slow or not block.slow):
            words = [sys.executable, "-c", text] if block.kind == "python" else [
                "bash", "-euo", "pipefail", "-c", text]
            done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True,
                                  check=False, timeout=COMMAND_TIMEOUT_S)
            assert done.returncode == 0, f"{where}:\n{done.stdout}\n{done.stderr}"
            printed = done.stdout
            ran.append(block)
        elif block.kind in ("sh", "python"):
            printed = ""
    return ran


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
@pytest.mark.slow_except("README")
def test_the_commands_of_a_page_work(page, tmp_path):
    assert play(page, tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.emulator
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
@pytest.mark.long_except("README")
def test_all_of_it_works_on_the_firmware(page, tmp_path):
    assert play(page, tmp_path, slow=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_what_is_not_run_exists(page):
    text = page.read_text(encoding="utf-8")
    shown = [c for b in handbook.blocks(text) if b.kind == "sh" for c in b.commands()]
    shown += re.findall(r"(?<!`)`((?:dart-hal|python|make) [^`\n]+)`(?!`)", text)
    own = {b.file for b in handbook.blocks(text) if b.file}
    wrong = [f"{c}: {why}" for c in shown if (why := unknown_command(c))
             and c.split()[-1] not in own]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_marks_are_known(page):
    known = re.compile(r"run: slow|run: no, .+|file: [\w.]+|output")
    marks = [b.mark for b in handbook.blocks(page.read_text(encoding="utf-8")) if b.mark]
    assert [m for m in marks if not known.fullmatch(m)] == []


@pytest.mark.slow
def test_a_command_that_fails_and_an_output_that_differs_are_detected(tmp_path):
    """The controls."""
    page = tmp_path / "page.md"
    page.write_text("```sh\ndart-hal docter\n```\n")
    (tmp_path / "a").mkdir()
    with pytest.raises(AssertionError, match=r"page\.md, line 1"):
        play(page, tmp_path / "a", slow=False)
    page.write_text("```sh\necho 7 mm left\n```\n\n<!-- output -->\n```text\n9 mm right\n```\n")
    (tmp_path / "b").mkdir()
    with pytest.raises(AssertionError, match="7 mm left"):
        play(page, tmp_path / "b", slow=False)
    other = tmp_path / f"{OTHER_ON_MOCK[0]}.md"
    for one in (page, other):
        one.write_text(
            "```sh\necho 7 mm left\n```\n\n<!-- output -->\n```text\n9 mm left\n```\n")
    for one, slow in ((page, False), (page, True), (other, False), (other, True)):
        folder = tmp_path / f"{one.stem} {slow}"
        folder.mkdir()
        with nullcontext() if (one, slow) == (other, False) else pytest.raises(AssertionError):
            play(one, folder, slow=slow)


def test_lines_may_be_left_out():
    assert handbook.as_shown("a 1.5 mm\n...\nend", "x\n  a 1.5 mm\nb\nc\nend\n")
    assert not handbook.as_shown("a 1.5 mm\nend", "a 1.5 mm\nb\nend\n")
    assert handbook.as_shown("row 20\n", "row 10\nrow 21\n"), "another line of the same form"


@pytest.mark.parametrize(("shown", "printed", "agree"), [
    ("190 mm", "91 mm", False), ("91 mm", "98 mm", True), ("91 mm", "105 mm", False),
    ("x -0.43 m", "x -0.45 m", True), ("x -0.43 m", "x 0.43 m", False),
    ("x -0.36", "x -0.43", False), ("0 mm", "1 mm", True), ("0 mm", "2 mm", False),
    ("85 %", "77 %", True), ("85 %", "76 %", False),
    ("k 0.0945 +- 0.0048 s", "k 0.0950 +- 0.0049 s", True),
    ("k 0.0945 +- 0.0048 s", "k 0.0945 +- 0.0090 s", False), ("1.00", "nan", False)])
def test_numbers_may_differ_by_a_tenth(shown, printed, agree):
    assert handbook.as_shown(shown, printed) == agree
