"""Table of the printed parts: grams, hours, how they lie. Masses from the built parts."""

from __future__ import annotations

import json
from pathlib import Path

from bom_table import load

BUILT = Path(__file__).resolve().parent / "cad" / "built.json"
SPEED = 7.0
"""cm3 of plastic an hour at layers of 0.2 mm and 50 mm/s [assumed: a slicer knows better]."""
START = 5
"""Minutes to heat and to lay the first layer, for each part [assumed]."""
DENSITY = {"PETG": 1.27, "PLA": 1.24}
PETG = ("sensor_gate", "hall_holder", "magnet_ring", "shock_ring")
LIES = {
    "magnet_ring": "holes up", "sensor_gate": "roof down", "hall_holder": "plate down",
    "board_holder": "one leg down", "small_board_holder": "one leg down",
    "camera_bracket": "on its side", "lidar_mount": "frame down", "nano_imu_mount": "flat",
    "cutoff_holder": "flat", "shock_ring": "upright", "fit_coupon": "flat",
}
"""How a part lies in its file, which is how it is printed."""


def rows() -> list[tuple[str, int, str, float, int, str]]:
    """(part, pieces, material, g each, minutes each, how it lies), in the order of the CAD."""
    parts = json.loads(BUILT.read_text(encoding="utf-8"))["parts"]
    pieces = {r.id: r.quantity for r in load()}
    found = []
    for name, row in parts.items():
        if row["process"] == "printed":
            material = "PETG" if name in PETG else "PLA"
            grams = row["mass_g"] * DENSITY[material] / DENSITY["PLA"]
            minutes = START + 60 * grams / DENSITY[material] / SPEED
            found.append((name, pieces[name], material, round(grams, 1), round(minutes),
                          LIES[name]))
    return found


def table() -> str:
    """Markdown, with the sum of everything."""
    lines = ["| part | pieces | material | g each | min each | lies |",
             "|---|---:|---|---:|---:|---|"]
    lines += [f"| `{n}` | {q} | {m} | {g} | {t} | {lies} |" for n, q, m, g, t, lies in rows()]
    grams = sum(q * g for _, q, _, g, _, _ in rows())
    hours = sum(q * t for _, q, _, _, t, _ in rows()) / 60
    return "\n".join([*lines, f"| together | | | {grams:.0f} | {hours:.1f} h | |"])
