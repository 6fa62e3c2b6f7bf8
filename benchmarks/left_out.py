"""Every recording of the car predicted by models fitted without it, one left out at a time.

    python benchmarks/left_out.py FOLDER --only cornering_drag steering_compliance

For each recording that is left out, a diagnosis of all others from the paper's
model, with the effects that may be named (none: the whole catalogue, some
minutes each). --given puts effects into the model, fitted but not judged, and
nothing is searched. Errors after 1 s, pooled over the windows of all recordings.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from dart_hal.car.runs import read_any
from dart_hal.core.errors import DartHalError
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose

OF_ONE_CAR = ("60_", "80_", "81_throttle", "91_free", "steering_identification_25", "circles_27")
"""July to September 2024: the same tyres, floor and weight."""
CHANNELS = ("vx", "vy", "yaw_rate", "position", "yaw_deg")


def main() -> None:
    """Ask, pool, print."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("data", type=Path, help="folder of the recordings")
    p.add_argument("--only", nargs="*", default=[], metavar="EFFECT", help="that may be named")
    p.add_argument("--given", nargs="*", default=[], metavar="EFFECT", help="that are in the model")
    o = p.parse_args()
    model, vehicle = find_model("paper")
    for effect in o.given:
        vehicle = apply(vehicle, effect)
    # nothing may be named, and the one effect that is looked at costs little
    searched = {"max_causes": 0, "only": ["gyro_bias"]} if o.given else {"only": o.only}
    folders = [f for f in sorted(o.data.iterdir()) if f.name.startswith(OF_ONE_CAR)]
    every = [r for r in read_any(folders)[0] if r.mocap is not None]
    squares: dict[str, list[np.ndarray]] = defaultdict(list)
    windows = []
    for left in track(every, "leaving one out"):
        others = [r for r in every if r is not left]
        try:
            d = diagnose(model, vehicle, others, [left], **searched)
        except DartHalError as err:
            Console(stderr=True).print(f"{left.name}: {err.what}")
            continue
        rows = {"constant velocity (CTRV)": d.ctrv, "paper": d.stages[0].horizons,
                "all that is in it estimated anew": d.stages[1].horizons}
        if not o.given:
            rows["with the causes found"] = d.stages[-1].horizons
        windows.append(rows["paper"]["1.0"]["pooled"]["n"])
        for name, horizons in rows.items():
            pooled = horizons["1.0"]["pooled"]
            squares[name].append(np.array([pooled[c] for c in CHANNELS])**2)
    table = Table("model", *CHANNELS, title=f"RMSE at 1 s, {sum(windows)} windows")
    for name, of in squares.items():
        error = np.sqrt(np.average(of, axis=0, weights=windows))
        table.add_row(name, *(f"{e:.3f}" for e in error))
    Console().print(table)


if __name__ == "__main__":
    main()
