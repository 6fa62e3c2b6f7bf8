"""Text below each picture of the guide, from the legends of the pictures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent / "cad"))
import inserts
import legends

PICTURE = re.compile(r"(```\{image\} \S+/pictures/(?:step_)?(\w+)\.png\n(?::.*\n)*```\n\n)(.*)")


def lines() -> dict[str, str]:
    """Name of every picture with numbers -> what they mean, as one sentence."""
    return ({name: legends.line(name) for name in legends.LEGENDS}
            | {i.name: inserts.line(i) for i in inserts.INSERTS})


def with_legends(text: str) -> str:
    """A page with the line below each numbered picture as the picture has it."""
    known = lines()
    return PICTURE.sub(lambda m: m[1] + known.get(m[2], m[3]), text)
