"""The table of what was built: `built.json`, read by tests and pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from assembly import balance, item_mesh, items, placements
from collisions import lidar_view, overlaps
from geometry import Bore, Part
from parameters import Parameters


def rounded(values: Any, digits: int = 4) -> list[float]:
    return [round(float(v), digits) + 0.0 for v in values]


def hole_row(bore: Bore) -> dict[str, Any]:
    row = {"at": rounded(bore.at), "axis": rounded(bore.axis),
           "diameter": round(bore.diameter, 4), "length": round(bore.length, 4),
           "screw": bore.screw, "use": bore.use}
    if bore.slot:
        row |= {"slot": round(bore.slot, 4), "slot_axis": rounded(bore.slot_axis)}
    return row


def part_row(p: Parameters, part: Part) -> dict[str, Any]:
    """Volume, box, holes and mass of one part in its own frame."""
    box, volume = part.solid.bounding_box(), part.solid.volume
    centre = part.solid.center()
    density = (p.printer.density * p.printer.fill if part.process == "printed"
               else p.sheet.density)
    return {"process": part.process, "wall_min": part.wall_min, "colour": part.colour,
            "volume_mm3": round(volume, 2), "box_mm": [rounded(box.min), rounded(box.max)],
            "mass_g": round(volume * density / 1000, 3), "centre_mm": rounded(centre, 3),
            "marks": [[rounded(q) for q in m] for m in (part.sheet.marks if part.sheet else ())],
            "holes": [hole_row(b) for b in part.bores]}


def table(p: Parameters, made: list[Part], stl: Path) -> dict[str, Any]:
    """Everything the tests and the pictures need; meshes are read back from the folder `stl`."""
    rows = {part.name: part_row(p, part) for part in made}
    placed = [{"name": q.name, "part": q.part, "step": q.step, "lift_mm": list(q.lift),
               "matrix": [rounded(r, 6) for r in q.matrix]} for q in placements(p)]
    bought = items(p)
    bodies = {i.name: item_mesh(i) for i in bought}
    weighed = [(i.mass, bodies[i.name]) for i in bought]
    for q in placed:
        mesh = trimesh.load_mesh(stl / f"{q['part']}.stl")
        mesh.apply_transform(np.array(q["matrix"]))
        bodies[q["name"]] = [mesh]
        weighed.append((rows[q["part"]]["mass_g"], [mesh]))
    lidar = lidar_view(bodies, (p.lidar.axis_x, 0.0), p.lidar.scan_z)
    return {"parts": rows, "placements": placed,
            "items": [{"name": i.name, "bom": i.bom, "mass_g": i.mass, "step": i.step,
                       "shapes": list(i.shapes)} for i in bought],
            "assembly": balance(weighed) | {"rear_axle_x_mm": p.car.rear_axle_x,
                                            "wheelbase_mm": p.car.wheelbase},
            "overlaps_mm3": overlaps(bodies), "lidar": lidar}


def dump(report: dict[str, Any]) -> str:
    """JSON with one line per part, hole, placement and shape, so that changes can be read."""
    def short(value: Any) -> str:
        return json.dumps(value)

    lines = ["{"]
    parts = []
    for name, row in report["parts"].items():
        head = short({k: v for k, v in row.items() if k != "holes"})[:-1]
        holes = ",\n    ".join(short(h) for h in row["holes"])
        parts.append(f'  {short(name)}: {head}, "holes": [' + (f"\n    {holes}]" if holes else "]")
                     + "}")
    lines.append('"parts": {\n' + ",\n".join(parts) + "},")
    lines.append('"placements": [\n' + ",\n".join("  " + short(q) for q in report["placements"])
                 + "],")
    things = []
    for item in report["items"]:
        head = short({k: v for k, v in item.items() if k != "shapes"})[:-1]
        shapes = ",\n    ".join(short(s) for s in item["shapes"])
        things.append(f'  {head}, "shapes": [\n    {shapes}]}}')
    lines.append('"items": [\n' + ",\n".join(things) + "],")
    lines.append(",\n".join(f'"{key}": {short(report[key])}'
                            for key in ("assembly", "overlaps_mm3", "lidar")))
    return "\n".join([*lines, "}"]) + "\n"
