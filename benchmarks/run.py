"""Every figure of the benchmarks page, measured here and now.

    python benchmarks/run.py [--only NAME ...] [--quick] [--json] [--strict] [--max-worse TIMES]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from math import isfinite

import bench_calibration
import bench_clock
import bench_decode
import bench_diagnose
import bench_emulation
import bench_encoder
import bench_estimation
import bench_evaluate
import bench_firmware
import bench_identify
import bench_import
import bench_jax
import bench_joint
import bench_lidar
import bench_light
import bench_mpc
import bench_ratios
import bench_recording
import bench_room
import bench_solver
import bench_vehicle
from figures import Figure, machine
from rich.console import Console
from rich.table import Table

from dart_hal.core.errors import EmulatorMissing

QUICK = 0.2
"""Share of the full lengths; figures come out a little less exact."""


def estimation(scale: float = 1.0) -> list[Figure]:
    """CPU time of the estimators, from their own benchmark."""
    costs = bench_estimation.cost()
    total = sum(best for best, _ in costs.values())
    parts = ", ".join(f"{name} {best:.1f}" for name, (best, _) in costs.items())
    rows = [Figure("estimators, CPU per frame", total, "us", note=parts)]
    for rate in (10, 100):
        room = bench_estimation.cost_in_a_room(rate)
        rows.append(Figure(f"with poses at {rate} Hz: more", room["room"][0], "us",
                           note=f"of it which to believe: {room['tracking'][0]:.0f}"))
    return rows


BENCHES: dict[str, Callable[..., list[Figure]]] = {
    "encoder": bench_encoder.figures,
    "decode": bench_decode.figures,
    "recording": bench_recording.figures,
    "import": bench_import.figures,
    "estimation": estimation,
    "room": bench_room.figures,
    "vehicle": bench_vehicle.figures,
    "light": bench_light.figures,
    "jax": bench_jax.figures,
    "mpc": bench_mpc.figures,
    "lidar": bench_lidar.figures,
    "emulation": bench_emulation.figures,
    "ratios": bench_ratios.figures,
    "clock": bench_clock.figures,
    "firmware": bench_firmware.figures,
    "calibration": bench_calibration.figures,
    "identify": bench_identify.figures,
    "evaluate": bench_evaluate.figures,
    "joint": bench_joint.figures,
    "solver": bench_solver.figures,
    "diagnose": bench_diagnose.figures,
}


def main(arguments: list[str] | None = None) -> int:
    """Run and print; with --strict the exit status says whether all targets hold."""
    options = _parser().parse_args(arguments)
    console = Console(stderr=True)
    rows: dict[str, list[Figure]] = {}
    missing: dict[str, str] = {}
    bounds = {"ratios": {"max_worse": options.max_worse}}
    for name in options.only or BENCHES:
        with console.status(f"measuring: {name}"):
            try:
                rows[name] = BENCHES[name](QUICK if options.quick else 1.0,
                                           **bounds.get(name, {}))
            except EmulatorMissing as why:
                missing[name] = why.what
    if options.json:
        print(json.dumps(_document(rows, missing), indent=1))
    else:
        _show(rows, missing)
    short = [f for figures in rows.values() for f in figures if f.ok is False]
    return 1 if options.strict and (short or missing) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description="Measure every figure of docs/results/benchmarks.md.")
    parser.add_argument("--only", nargs="+", choices=list(BENCHES), metavar="NAME",
                        help=f"some of: {', '.join(BENCHES)}")
    parser.add_argument("--quick", action="store_true", help="a fifth of the lengths")
    parser.add_argument("--json", action="store_true", help="JSON on standard output")
    parser.add_argument("--strict", action="store_true", help="exit 1 when a target is missed")
    parser.add_argument("--max-worse", type=float, metavar="TIMES",
                        default=bench_ratios.MAX_WORSE,
                        help="limit of a ratio over the committed one (%(default)s)")
    return parser


def _document(rows: dict[str, list[Figure]], missing: dict[str, str]) -> dict[str, object]:
    figures = [{"bench": name, **asdict(f), "value": f.value if isfinite(f.value) else None,
                "ok": f.ok} for name, row in rows.items() for f in row]
    return {**machine(), "figures": figures, "missing": missing}


def _show(rows: dict[str, list[Figure]], missing: dict[str, str]) -> None:
    console = Console(width=None if sys.stdout.isatty() else 140)
    console.print(", ".join(f"{key} {value}" for key, value in machine().items()),
                  highlight=False)
    table = Table(caption="times are CPU times, the best of several rounds")
    for title, side in (("figure", "left"), ("measured", "right"), ("target", "right"),
                        ("ok", "center"), ("beside it", "left")):
        table.add_column(title, justify=side)  # type: ignore[arg-type]
    marks = {True: "[green]yes[/]", False: "[red]NO[/]", None: ""}
    for figures in rows.values():
        for f in figures:
            table.add_row(f.name, f.measured, f.target, marks[f.ok], f"[dim]{f.note}[/]")
        table.add_section()
    for name, why in missing.items():
        table.add_row(name, "not here", "", "", f"[dim]{why}[/]")
    console.print(table)
    console.print(_verdict(rows, missing))


def _verdict(rows: dict[str, list[Figure]], missing: dict[str, str]) -> str:
    judged = [f for figures in rows.values() for f in figures if f.ok is not None]
    short = [f.name for f in judged if not f.ok]
    if short:
        return f"{len(short)} of {len(judged)} figures fall short: {'; '.join(short)}."
    without = f" (without {', '.join(missing)})" if missing else ""
    return f"All {len(judged)} figures reach their targets{without}."


if __name__ == "__main__":
    sys.exit(main())
