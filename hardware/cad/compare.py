"""Differences between committed files and rebuilt ones. Needs no CAD kernel.

Rows are (file or part, what, committed, rebuilt).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drawings
import numpy as np
import trimesh
from PIL import Image

VOLUME = 1e-3  # share of the volume by which a rebuilt part may differ
LENGTH = 0.01  # mm
TONE = 4.0  # mean difference of grey, of 255, in the worst sixteenth of a picture
FORMAT = 0.02  # share of width and height
Row = tuple[str, str, str, str]


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[Row]:
    """Rows (part, what, committed, rebuilt) for everything outside the tolerances."""
    found = []
    for name in sorted(set(old["parts"]) | set(new["parts"])):
        a, b = old["parts"].get(name), new["parts"].get(name)
        if a is None or b is None:
            found.append((name, "part", "missing" if a is None else "there",
                          "missing" if b is None else "there"))
            continue
        if abs(a["volume_mm3"] - b["volume_mm3"]) > VOLUME * b["volume_mm3"]:
            found.append((name, "volume mm3", f"{a['volume_mm3']}", f"{b['volume_mm3']}"))
        if np.abs(np.subtract(a["box_mm"], b["box_mm"])).max() > LENGTH:
            found.append((name, "bounding box mm", f"{a['box_mm']}", f"{b['box_mm']}"))
        found += [(name, f"hole {n}", str(x), str(y)) for n, (x, y) in
                  enumerate(_pairs(a["holes"], b["holes"])) if x != y]
    old_at = {q["name"]: q for q in old["placements"]}
    new_at = {q["name"]: q for q in new["placements"]}
    found += [(name, "placement", str(old_at.get(name)), str(new_at.get(name)))
              for name in sorted(set(old_at) | set(new_at)) if old_at.get(name) != new_at.get(name)]
    old_item, new_item = ({i["name"]: [{**i, "shapes": len(i["shapes"])}, *i["shapes"]]
                           for i in report["items"]} for report in (old, new))
    for name in sorted(set(old_item) | set(new_item)):
        pairs = _pairs(old_item.get(name, []), new_item.get(name, []))
        found += [(name, "item", str(x), str(y)) for x, y in pairs if x != y][:1]
    found += [("assembly", key, str(old.get(key)), str(new.get(key)))
              for key in ("assembly", "lidar") if old.get(key) != new.get(key)]
    return found


def _pairs(a: list[Any], b: list[Any]) -> list[tuple[Any, Any]]:
    n = max(len(a), len(b))
    return list(zip(a + [None] * (n - len(a)), b + [None] * (n - len(b)), strict=True))


def stl_differences(old: Path, new: Path) -> list[Row]:
    """Meshes whose volume or box differs, or that exist on one side only."""
    found = []
    for name in sorted({f.name for d in (old, new) for f in d.glob("*.stl")}):
        if not (old / name).is_file() or not (new / name).is_file():
            found.append((name, "file", _there(old / name), _there(new / name)))
            continue
        a, b = trimesh.load_mesh(old / name), trimesh.load_mesh(new / name)
        if abs(a.volume - b.volume) > VOLUME * abs(b.volume):
            found.append((name, "volume mm3", f"{a.volume:.1f}", f"{b.volume:.1f}"))
        if np.abs(a.bounds - b.bounds).max() > LENGTH:
            found.append((name, "bounding box mm", str(a.bounds.tolist()), str(b.bounds.tolist())))
    return found


def dxf_differences(old: Path, new: Path) -> list[Row]:
    """Drawings whose outlines or holes differ, or that exist on one side only."""
    found = []
    for name in sorted({f.name for d in (old, new) for f in d.glob("*.dxf")}):
        if not (old / name).is_file() or not (new / name).is_file():
            found.append((name, "file", _there(old / name), _there(new / name)))
            continue
        a, b = drawings.entities(old / name), drawings.entities(new / name)
        found += [(name, "entity", str(x)[:70], str(y)[:70]) for x, y in _pairs(a, b) if x != y]
    return found


def step_differences(old: Path, new: Path) -> list[Row]:
    """STEP files that are not the same solid, header apart, or exist on one side only."""
    def solid(path: Path) -> str:
        return path.read_text(encoding="utf-8").partition("DATA;")[2] if path.is_file() else ""

    return [(name, "solid", _there(old / name), _there(new / name))
            for name in sorted({f.name for d in (old, new) for f in d.glob("*.step")})
            if solid(old / name) != solid(new / name)]


def text_differences(old: Path, new: Path, suffix: str = ".svg") -> list[Row]:
    """Text files that differ by a character, or exist on one side only."""
    return [(f, "text", _there(old / f), _there(new / f))
            for f in sorted({f.name for d in (old, new) for f in d.glob(f"*{suffix}")})
            if not (old / f).is_file() or not (new / f).is_file()
            or (old / f).read_text(encoding="utf-8") != (new / f).read_text(encoding="utf-8")]


def picture_differences(old: Path, new: Path) -> list[Row]:
    """Pictures that show something else, or exist on one side only.

    Another version of the renderer shades edges otherwise: small pictures are compared, and
    the worst of 4 x 4 fields counts.
    """
    found = []
    for name in sorted({f.name for d in (old, new) for f in d.glob("*.png")}):
        if not (old / name).is_file() or not (new / name).is_file():
            found.append((name, "file", _there(old / name), _there(new / name)))
            continue
        a, b = Image.open(old / name).convert("L"), Image.open(new / name).convert("L")
        if any(abs(x - y) > FORMAT * y for x, y in zip(a.size, b.size, strict=True)):
            found.append((name, "pixels", str(a.size), str(b.size)))
            continue
        tones = [np.asarray(x.resize((64, 64), Image.Resampling.BOX), float) for x in (a, b)]
        fields = np.abs(tones[0] - tones[1]).reshape(4, 16, 4, 16).mean(axis=(1, 3))
        if fields.max() > TONE:
            found.append((name, "grey tone", f"{fields.max():.1f} of 255 away", f"at most {TONE}"))
    return found


def _there(path: Path) -> str:
    return "there" if path.is_file() else "missing"
