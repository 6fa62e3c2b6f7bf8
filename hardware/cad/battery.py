"""LiPo in its tray below the hold-down bar, both posts with their body clips."""

from __future__ import annotations

from collections.abc import Iterator

from bought import BLACK, SILVER, Item
from collisions import TOUCH, Bodies, shared
from parameters import Parameters
from shapes import Shape, box, cylinder

MIDDLE = 69.5, 58.0
"""Middle of the pack, mm [photo]: left of the speed controller."""
POST = 2.5
SLACK = 2.5
"""mm that the pack may move in any direction before it meets something."""


def battery(p: Parameters) -> list[Item]:
    """Pack, and what holds it: bar, two posts, two clips, the rim of the tray [photo]."""
    b, f = p.battery, p.car.floor_z
    x, y = MIDDLE
    x0, x1, y0, y1 = x - b.length / 2, x + b.length / 2, y - b.width / 2, y + b.width / 2
    top = f + b.height
    pack = [box(x0, x1, y0, y1, f, top, "#2f5aa8"),
            box(x0 + 15, x1 - 15, y0 + 2.5, y1 - 2.5, top, top + 0.3, "#d8b23a")]
    bar = top + 0.3 + b.bar_above
    ends = [(x0 - 1 - POST, y), (x1 + 1 + POST, y)]
    hold: list[Shape] = [box(ends[0][0] - 4, ends[1][0] + 4, y - 4, y + 4, bar, bar + 4, BLACK)]
    for px, py in ends:
        hold += [cylinder((px, py, f), (px, py, bar + 12), POST, BLACK, sides=16),
                 cylinder((px - 7, py - 5, bar + 5.2), (px + 5, py + 4, bar + 5.2), 0.6, SILVER,
                          sides=8),
                 cylinder((px - 7, py - 5, bar + 5.2), (px - 9, py - 1, bar + 5.2), 0.6, SILVER,
                          sides=8),
                 cylinder((px - 9, py - 1, bar + 5.2), (px + 3, py + 7, bar + 5.2), 0.6, SILVER,
                          sides=8)]
    hold += [box(x0 + 3, x1 - 3, y1 + 0.8, y1 + 2.3, f, f + 6, BLACK),
             box(x0 + 3, x1 - 3, y0 - 2.3, y0 - 0.8, f, f + 6, BLACK)]
    return [Item("lipo", "lipo", p.mass.lipo, "S14", tuple(pack)),
            Item("battery_bar", "battery_bar", 6.0, "S14", tuple(hold))]


def loose(bodies: Bodies) -> Iterator[str]:
    """Directions in which the pack moves by `SLACK` without meeting what holds it."""
    pack = bodies["lipo"][0]
    for name, way in (("up", (0, 0, 1)), ("forward", (1, 0, 0)), ("to the rear", (-1, 0, 0)),
                      ("to the left", (0, 1, 0)), ("to the right", (0, -1, 0))):
        moved = pack.copy()
        moved.apply_translation([SLACK * v for v in way])
        if sum(shared(moved, m) for m in bodies.get("battery_bar", [])) <= TOUCH:
            yield f"lipo: nothing holds it {name} within {SLACK:g} mm"
