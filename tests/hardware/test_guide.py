"""The build guide: every part, tool, command, link and figure in it exists."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import click
import pytest
from PIL import ImageFont

from dart_hal.cli.common import checks
from dart_hal.cli.main import cli
from dart_hal.devices.actuation.arming import BY_NAME
from dart_hal.wire.messages import SCHEMA
from tests.common import ROOT

sys.path[:0] = [str(ROOT / "hardware"), str(ROOT / "hardware" / "cad")]

import bom_table  # noqa: E402 - found through the line above
import guide  # noqa: E402
import inserts  # noqa: E402
import labels  # noqa: E402
import legends  # noqa: E402

DOCTOR = re.compile(r"^ *(ok|warn|fail)  (\S.{0,21}?)(?:  +(.*))?$", re.MULTILINE)
"""A line of the doctor's report: verdict, title, what it found."""
CHECKED_BY_HAND = {
    "git", "ls", "echo", "export", "nano", "cp", "cd", "i2cdetect", "ssh", ".", "sudo", "uv",
    "lsusb", "uname", "mkdir", "modinfo", "systemctl", "journalctl", "dmesg", "ping", "scp",
    "cat", "id", "gst-launch-1.0", "rpicam-still",
}
"""Programs of the system, not of this project."""


@pytest.fixture
def copy(tmp_path):
    """``copy(page, old, new)``: a copy of the guide with one thing broken."""
    folder = tmp_path / "guide"
    shutil.copytree(guide.PAGES, folder)

    def broken(page: str, old: str, new: str) -> Path:
        path = folder / page
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
        return folder

    return broken


def find_miscounted(steps: list[guide.Step]) -> dict[str, str]:
    """Parts that the guide takes out of the bag more or less often than the bill buys."""
    wrong = {}
    for row in bom_table.load():
        counts = [s.parts[row.id] for s in steps if row.id in s.parts]
        taken = sum(counts) or (1 if counts else 0)
        if taken != row.quantity:
            wrong[row.id] = f"{taken} in the guide, {row.quantity} in the bill"
    return wrong


def unknown_command(command: str) -> str:
    """Why a command line cannot be right, or nothing."""
    words = command.split()
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words.pop(0)
    name = words[0].rsplit("/", 1)[-1]
    if name == "dart-hal":
        return _unknown_verb(words[1:])
    if name.startswith("python"):
        script = next((w for w in words[1:] if w.endswith(".py")), "")
        own = script.startswith(("examples/", "hardware/", "benchmarks/"))
        return "" if not own or (ROOT / script).is_file() else f"no {script}"
    if name == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        return "" if words[1] in targets else f"no target {words[1]}"
    if name == "sh":
        return "" if (ROOT / words[1]).is_file() else f"no {words[1]}"
    return "" if name in CHECKED_BY_HAND else f"no program {name}"


def _unknown_verb(words: list[str]) -> str:
    node: click.Command = cli
    for word in list(words):
        if not isinstance(node, click.Group) or word.startswith("-"):
            break
        found = node.get_command(click.Context(node), word)
        if found is None:
            return f"no verb {word}" if node is cli else f"no command {word}"
        node = found
        words = words[1:]
    options = [o for p in node.params if isinstance(p, click.Option)
               for o in (*p.opts, *p.secondary_opts)]
    known = {*options, "--help", "-h", "--version"}
    for word in words:
        if word.startswith("-") and word.split("=")[0] not in known:
            return f"{node.name} has no option {word}"
    return ""


def links(text: str) -> list[str]:
    """Files that a page links or shows."""
    found = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text)
    found += re.findall(r"^```\{image\} (\S+)", text, re.MULTILINE)
    return [x for x in found if "://" not in x]


def find_missing_pictures(folder: Path, base: Path = guide.PAGES) -> list[str]:
    return [f"{page}: {link}" for page, text in guide.pages(folder).items()
            for link in links(text) if not (base / link).is_file()]


def test_ten_pages_in_order():
    assert [p[:2] for p in guide.pages()] == [f"{n:02}" for n in range(1, 11)]


def test_the_assembly_is_complete():
    ids = [s.id for s in guide.steps()]
    assert len(ids) == len(set(ids))
    assert {f"S{n:02}" for n in range(1, 16)} <= set(ids)


@pytest.mark.slow
def test_every_part_is_in_the_bill_and_the_reverse():
    named = {p: [s.id for s in guide.steps() if p in s.parts]
             for s in guide.steps() for p in s.parts}
    assert {r.id: list(r.used_in) for r in bom_table.load()} == named


def test_the_guide_uses_up_what_the_bill_buys():
    assert find_miscounted(guide.steps()) == {}


def test_a_part_too_many_is_detected(copy):
    folder = copy("05_deck.md", "8 x `standoff_25`", "9 x `standoff_25`")
    assert find_miscounted(guide.steps(folder)) == {"standoff_25": "9 in the guide, 8 in the bill"}


def test_every_tool_is_in_the_list_and_the_reverse():
    listed = {t.id for t in bom_table.load_tools()}
    assert {t for s in guide.steps() for t in s.tools} == listed


def test_a_step_names_the_tools_of_its_parts():
    """A tool that a row of the bill requires is in at least one step that uses the part."""
    steps = {s.id: s for s in guide.steps()}
    missing = [f"{r.id}: {tool}" for r in bom_table.load() for tool in r.tools
               if not any(tool in steps[s].tools for s in r.used_in)]
    assert missing == []


def test_nothing_is_soldered_outside_the_options():
    assert [s.id for s in guide.steps() if s.skill == "solder" and not s.option] == []
    assert [s.id for s in guide.steps() if s.skill == "solder"], "the control: options do"


def test_a_part_that_is_soldered_is_so_in_its_step():
    steps = {s.id: s for s in guide.steps()}
    assert [r.id for r in bom_table.load() if r.skill == "solder"
            and not any(steps[s].skill == "solder" for s in r.used_in)] == []


def test_the_table_of_the_weekend_adds_up():
    first = guide.pages()["01_parts.md"]
    hours = {int(n): (float(h), skill) for n, h, skill in re.findall(
        r"^\| \[?(\d+)\. [^|]+\| ([\d.]+) \| (\w+) \|$", first, re.MULTILINE)}
    for number, (stated, skill) in hours.items():
        steps = [s for s in guide.steps() if s.page.startswith(f"{number:02}") and not s.option]
        assert abs(sum(s.minutes for s in steps) / 60 - stated) <= 0.051, (number, stated)
        assert skill == max((s.skill for s in steps), key=guide.SKILLS.index), number
    assert len(hours) == 10
    total = f"{sum(stated for stated, _ in hours.values()):.1f} hours by hand"
    assert total in first


def test_every_page_ends_with_a_check_and_with_mistakes():
    for page, text in guide.pages().items():
        assert "**Check.**" in text, page
        assert "\n## When it goes wrong\n" in text, page


def test_every_command_exists():
    wrong = [f"{page}: {command}: {why}" for page, text in guide.pages().items()
             for command in guide.commands(text) if (why := unknown_command(command))]
    assert wrong == []
    assert sum(len(guide.commands(t)) for t in guide.pages().values()) > 20


@pytest.mark.parametrize(("command", "why"), [
    ("dart-hal calibrate streering", "no command streering"),
    ("dart-hal docter", "no verb docter"),
    ("dart-hal drive --keybord", "drive has no option --keybord"),
    ("python examples/follow_figure_of_nine.py", "no examples/follow_figure_of_nine.py"),
    ("make hardwear", "no target hardwear"),
    ("sh host/setup/set-up.sh", "no host/setup/set-up.sh"),
])
def test_a_wrong_command_is_detected(command, why):
    assert unknown_command(command) == why


def test_the_quoted_output_of_the_doctor_is_true():
    source = Path(checks.__file__).read_text(encoding="utf-8") + " ".join(BY_NAME)
    shown = [x for text in guide.pages().values()
             for x in DOCTOR.findall(text)]
    assert {title for _, title, _ in shown} <= set(checks.CHECK_TITLES.values())
    assert len(shown) > 15
    for _, title, found in shown:
        # Figures, names and paths are the reader's own; the words are the doctor's.
        words = [w.strip(",;:") for w in found.split() if not re.search(r"[\d/]", w)]
        assert [w for w in words if w not in source] == [], title


def test_the_figures_shown_are_those_of_this_version():
    source = ROOT / "firmware" / "src" / "app" / "version.h"
    version = re.findall(r"kVersion\w+ = (\d+);", source.read_text(encoding="utf-8"))
    text = "\n".join(guide.pages().values())
    assert set(re.findall(r"message definitions +(\w{8})", text)) == {f"{SCHEMA:08x}"}
    assert set(re.findall(r"firmware +version ([\d.]+)", text)) == {".".join(version)}


def test_links_and_pictures_exist():
    assert find_missing_pictures(guide.PAGES) == []


def test_a_missing_picture_is_detected(copy):
    folder = copy("01_parts.md", "pictures/car.png", "pictures/cart.png")
    assert find_missing_pictures(folder) == ["01_parts.md: ../../hardware/pictures/cart.png"]


PICTURE = re.compile(r"```\{image\} \S+/pictures/(?:step_)?(\w+)\.png\n(?::(?!width).*\n)*"
                     r":width: (\d+)px")
LABELLED = {*legends.LEGENDS, *(one.name for one in inserts.INSERTS)}
LEGIBLE_WIDTH = 640
"""Pixels: the letters of labels.py then have the height of the text."""


def find_illegible(text: str) -> list[str]:
    """Pictures with words in them that are shown too small to read these."""
    return [name for name, width in PICTURE.findall(text)
            if name in LABELLED and int(width) < LEGIBLE_WIDTH]


def test_the_words_in_every_picture_can_be_read():
    shown = {n for t in guide.pages().values() for n, _ in PICTURE.findall(t)}
    assert shown >= LABELLED
    assert [x for t in guide.pages().values() for x in find_illegible(t)] == []


def test_a_small_picture_with_words_is_detected(copy):
    folder = copy("04_sensors.md", ":width: 640px", ":width: 400px")
    assert "S04" in find_illegible((folder / "04_sensors.md").read_text(encoding="utf-8"))


def test_labels_keep_their_order_and_do_not_overlap():
    sizes = [30.0, 10.0, 20.0]
    middles = labels.spread([50.0, 52.0, 53.0], sizes, 0.0, 100.0)
    gaps = [b - a for a, b in pairwise(middles)]
    assert gaps == pytest.approx([20.0, 15.0])
    assert middles[0] >= 15.0
    assert middles[-1] <= 90.0


def test_a_label_is_wrapped_between_words():
    font = ImageFont.load_default(size=10)
    lines = labels.wrap("plug of the `6-wire` cable", font.getlength("plug of the 6"), font)
    assert lines == ["plug of the", "6-wire cable"]


def test_every_step_with_the_screwdriver_has_a_picture():
    """S15 is about plugs and chargers."""
    shown = {n for t in guide.pages().values() for n, _ in PICTURE.findall(t)}
    assert {s.id for s in guide.steps() if s.id.startswith("S")} - shown == {"S15"}


def test_anchors_exist():
    """Anchors into the hardware page: a heading with that name."""
    text = (ROOT / "hardware" / "README.md").read_text(encoding="utf-8")
    heads = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-")
             for h in re.findall(r"^#+ (.+)$", text, re.MULTILINE)}
    required = {a for t in guide.pages().values()
                for a in re.findall(r"hardware/README\.md#([\w-]+)", t)}
    assert required
    assert required <= heads


def test_the_weighing_program_gives_the_published_geometry():
    """Axle loads and wheelbase of one upstream car and the centre of mass published with it."""
    text = guide.pages()["09_weigh_and_describe.md"]
    program = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    with contextlib.redirect_stdout(out := io.StringIO()):
        exec(program, {})
    stated = {k: float(v) for k, v in (x.split(" = ") for x in out.getvalue().splitlines())}
    assert stated["l_r"] == pytest.approx(0.093009, abs=2e-6)
    assert stated["l_f"] == pytest.approx(0.080491, abs=2e-6)
    assert stated["mass"] == pytest.approx(1.580)
    assert stated["metres_per_edge"] == pytest.approx(0.0020646, abs=1e-7)


def test_the_edges_of_one_turn_of_the_wheels_are_those_of_the_gears():
    """20 edges per turn of the main gear, which turns 39/11 times as often as the wheels."""
    text = guide.pages()["04_sensors.md"]
    stated = int(re.search(r"go up by \*\*(\d+)\*\* \(39/11 turns", text)[1])
    per_turn = int(re.search(r"main gear of (\d+) edges each", text)[1])
    teeth = re.search(r"^teeth = \{ value = (\d+)", (ROOT / "hardware" / "cad" / "parameters.toml")
                      .read_text(encoding="utf-8"), re.MULTILINE)
    assert per_turn == 2 * int(teeth[1])
    assert stated == round(per_turn * 39 / 11)


def test_a_step_without_time_names_it(copy):
    folder = copy("03_encoder.md", "- Time: 40 min", "- Time: a while")
    with pytest.raises(guide.GuideError, match=r"03_encoder\.md, S03: 'Time: N min'"):
        guide.steps(folder)


def test_a_step_without_tools_names_it(copy):
    folder = copy("03_encoder.md", "- Tools: `screwdrivers`, `hex_keys`\n", "")
    with pytest.raises(guide.GuideError, match=r"03_encoder\.md, S02: '- Tools: \.\.\.' expected"):
        guide.steps(folder)


CELLS = re.compile(r"(?<![`_\w])(?<!\w-)(\w+(?:\s+\w+){0,2}\s+)?cells?\b(?!`)(?=([^\n]{0,20}))",
                   re.IGNORECASE)
CELL_KINDS = ("18650", "AA")
"""Cells that the guide puts somewhere: four 18650 in the car, four AA in the servo tester."""


def ambiguous_cells(text: str) -> list[str]:
    """Mentions of a cell that do not name which: 18650, AA, or a cell of the LiPo.

    A servo tester that was fed with the 18650 cells of the next step gave a servo of 6.8 V 16 V.
    """
    prose = re.sub(r"```.*?```|\(#[^)]*\)|\]\([^)]*\)", "", text, flags=re.DOTALL)
    return [found.group(0).strip() for found in CELLS.finditer(prose)
            if not any(kind in (found.group(1) or "") for kind in CELL_KINDS)
            and not found.group(2).lower().startswith((" holder", " of the lipo", " [assumed"))]


def test_every_cell_is_named_by_its_kind():
    assert {page: wrong for page, text in guide.pages().items()
            if (wrong := ambiguous_cells(text))} == {}


def test_cells_of_no_kind_are_detected():
    assert ambiguous_cells("Put the four cells into the tester.") == ["Put the four cells"]
    assert ambiguous_cells("Put the four AA cells and the 18650 cells in.") == []


def test_servo_tester_is_never_fed_by_the_cells_of_the_car():
    step = guide.pages()["04_sensors.md"].partition("## S06")[2].partition("## S07")[0]
    assert "AA cells" in step
    assert "Never the 18650" in step
    tools = (guide.PAGES.parents[1] / "hardware" / "tools.csv").read_text(encoding="utf-8")
    assert "never the 18650" in next(x for x in tools.splitlines() if x.startswith("servo_tester"))
