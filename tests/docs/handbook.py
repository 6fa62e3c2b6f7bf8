"""The handbook as data: its pages, their code blocks, their links.

A fenced block is run unchanged. A comment on the line above states otherwise:

    <!-- run: slow -->               among the slow tests
    <!-- run: no, WHY -->            not run; its commands and options must exist
    <!-- file: NAME -->              a file that the reader saves
    <!-- output -->                  what the block before prints, its numbers within 10 %;
                                     "..." = any rest of a line, any lines
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"(?:^<!-- (?P<mark>[^\n]*?) -->\n)?^```(?P<kind>\w*)\n(?P<text>.*?)^```$",
                   re.MULTILINE | re.DOTALL)
NUMBER_PATTERN = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?![\w]*\.\d)")
MAX_RELATIVE_DIFFERENCE = 0.1
"""Of a number that a page shows and the one that is printed; a unit of its last digit is allowed
as well, because pages and programs round."""
CODE_PATTERN = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
IMAGE = re.compile(r"^```\{image\} (\S+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Block:
    """kind: sh, python, text..; mark: the comment above it, or nothing; line: where it begins."""

    kind: str
    mark: str
    text: str
    line: int

    @property
    def file(self) -> str:
        """Name under which the reader saves it, or nothing."""
        return self.mark.removeprefix("file: ") if self.mark.startswith("file: ") else ""

    @property
    def runs(self) -> bool:
        return self.kind in ("sh", "python") and not self.mark.startswith("run: no")

    @property
    def slow(self) -> bool:
        return self.mark == "run: slow"

    def commands(self) -> list[str]:
        """Lines of a shell block, continued ones joined, without comments."""
        text = self.text.replace("\\\n", " ")
        lines = (re.sub(r"\s+#.*", "", x).strip() for x in text.splitlines())
        return [part.strip() for x in lines if x and not x.startswith("#")
                for part in x.split("&&")]


def blocks(text: str) -> list[Block]:
    """Fenced blocks in reading order."""
    return [Block(m["kind"], m["mark"] or "", m["text"], text[:m.start()].count("\n") + 1)
            for m in BLOCK.finditer(text)]


def pages() -> list[Path]:
    """Every page that a reader may open: the handbook and the other Markdown files."""
    built = DOCS / "build"
    other_pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "hardware" / "README.md",
                   ROOT / "hardware" / "cad" / "README.md",
                   ROOT / "firmware" / "emulator" / "README.md"]
    return [p for p in sorted(DOCS.rglob("*.md")) if built not in p.parents] + other_pages


def as_shown(shown: str, printed: str, *, any_numbers: bool = False) -> bool:
    """Whether the text of an output block is in what was printed, its numbers within 10 %."""
    pattern = ""
    numbers = []
    for line in filter(None, (x.strip() for x in shown.splitlines())):
        if line == "...":
            pattern += r"(?:.*\n)*?"
            continue
        words = []
        for word in line.split():
            if word == "...":
                words.append(".*")
                continue
            # Text between the numbers is literal, each number becomes a group.
            numbers += NUMBER_PATTERN.findall(word)
            words.append(r"([-+]?\d+(?:\.\d+)?)".join(map(re.escape, NUMBER_PATTERN.split(word))))
        pattern += r"[ \t]*" + r"\s+".join(words) + r"[ \t]*\n+"
    return any(any_numbers or all(map(is_near, numbers, found.groups()))
               for found in re.finditer(pattern, printed + "\n"))


def is_near(shown: str, printed: str) -> bool:
    """Whether a printed number is within 10 %, or one unit of the last digit, of the shown one."""
    digits = len(shown.partition(".")[2])
    most = max(MAX_RELATIVE_DIFFERENCE * abs(float(shown)), 1.001 * 10.0 ** -digits)
    return abs(float(printed) - float(shown)) <= most


def anchors(text: str) -> set[str]:
    """Of a page's headings, as GitHub and the handbook make them."""
    heads = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in heads}


def broken_links(page: Path, text: str) -> list[str]:
    """Links and pictures of a page that lead nowhere, anchors into other pages included."""
    found = LINK.findall(CODE_PATTERN.sub("", text)) + IMAGE.findall(text)
    out = []
    for link in found:
        name, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = (page.parent / name).resolve() if name else page
        there = target.exists() or (DOCS / "reference" / "api") in target.parents
        if there and anchor and target.suffix == ".md":
            there = anchor in anchors(target.read_text(encoding="utf-8") if name else text)
        if not there:
            out.append(link)
    return out
