"""Base, upper and back plate, cut from 3 mm sheet."""

from __future__ import annotations

import layout
from geometry import Part, from_sheet
from parameters import Parameters

CLEAR = "#a9d3e6"


def parts(p: Parameters) -> list[Part]:
    return [from_sheet(sheet, CLEAR, p.sheet.web_min)
            for sheet in (layout.base_plate(p), layout.upper_plate(p), layout.back_plate(p))]
