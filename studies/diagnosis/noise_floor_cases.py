"""Count how near the noise floor is to the error of a faultless model, and which drives exceed it.

    python -m studies.diagnosis.noise_floor_cases --jobs 2

drives cars that hide nothing and cars to which something happens, 60 s to learn from and 40 s to
judge by, and diagnoses them. A row for each kind of car: the floor over the RMSE 1 s ahead (median,
10 % and 90 % quantile), in how many drives an error exceeds the floor, single moments and late
commands are flagged, and how many end as ``nothing_wrong`` or ``parameters_only``. Results are
lines of JSON; a drive that is there is not repeated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from dart_hal.core.process.jobs import each
from dart_lab.diagnosis.error_summaries import MAX_OVER_FLOOR
from dart_lab.identification.evaluation.prediction import CHANNELS
from studies.diagnosis.campaign import ask
from studies.diagnosis.campaign_cases import BASES, Case, car, habits, model_file
from studies.diagnosis.events import add_gusts, lift_rear_axle, lose_commands
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_files import COMMANDS, Habits, pair

SECONDS = (60.0, 40.0)
"""To learn from, to judge by."""
STYLES = ("steps", "waves", "prbs", "gentle", "ramps", "laps")
EVENTS: dict[str, Callable[[Car, int], Any]] = {
    "nothing": lambda car, seed: None,
    "gusts 1.2 N": lambda car, seed: add_gusts(car, 1.2, seed),
    "gusts 2 N": lambda car, seed: add_gusts(car, 2.0, seed),
    "lifted axle": lambda car, seed: lift_rear_axle(car, 0.5, seed),
    "lost 20 %": lambda car, seed: lose_commands(car, 0.2, seed),
    "lost 35 %": lambda car, seed: lose_commands(car, 0.35, seed)}
"""What happens to a car of the paper in six kinds of driving."""
GROUPS = ("null", "null fixed", "null disturbed", "null paper", "null rough")
"""Groups of the campaign that hide nothing."""
SILENT = ("nothing_wrong", "parameters_only")
OUT = Path(__file__).resolve().parents[2] / "build" / "noise_floor.jsonl"


@dataclass(frozen=True)
class Drive:
    """One diagnosis; kind: of EVENTS or GROUPS."""

    kind: str
    seed: int

    @property
    def key(self) -> str:
        """Unique."""
        return f"{self.kind}/{self.seed}"


def drives(kinds: Sequence[str], count: int, first: int) -> list[Drive]:
    """So many drives of each kind."""
    return [Drive(kind, first + i) for kind in kinds for i in range(count)]


def run(drive: Drive) -> dict[str, Any]:
    """Simulate and diagnose one drive."""
    model, refit = "paper", True
    with tempfile.TemporaryDirectory() as folder:
        if drive.kind in EVENTS:
            driven, number = Car(), zlib.crc32(drive.key.encode())
            EVENTS[drive.kind](driven, drive.seed)
            how = Habits(style=STYLES[drive.seed % len(STYLES)],
                         commands=COMMANDS[(drive.seed + drive.seed // 6) % len(COMMANDS)])
        else:
            case = Case(drive.kind, drive.seed, ())
            rng, number = np.random.default_rng(case.number), case.number
            how, driven = habits(case, rng), car(case, rng)
            refit = case.known != "fixed"
            if BASES[case.known]:
                model = str(Path(folder) / "stated.toml")
                Path(model).write_text(model_file(BASES[case.known]))
        train, test = pair(Path(folder), driven, how, SECONDS, number)
        answer = ask(model, train, test, refit)
    error = answer["extended"]["errors"]["1.0"]["pooled"]
    return {"key": drive.key, "kind": drive.kind, "verdict": answer["verdict"],
            "commands": how.commands, "style": how.style,
            "error": {c: error[c] for c in CHANNELS}, "floor": answer["noise_floor"],
            "late": (answer["late_commands"] or {}).get("log_likelihood", 0.0),
            "outliers": {o["channel"]: o["ratio"] for o in answer["outliers"]},
            "structure": [u["channel"] for u in answer["unexplained"]],
            "causes": [c["effect"] for c in answer["causes"]]}


def make_table(found: Sequence[dict[str, Any]]) -> Table:
    """One row for each kind, and one for all that hide nothing."""
    table = Table("kind", "drives", *CHANNELS, "above floor", "single moments",
                  "late commands", "any", "nothing wrong")
    kinds = list(dict.fromkeys(one["kind"] for one in found))
    rows = {kind: [one for one in found if one["kind"] == kind] for kind in kinds}
    rows["all that hide nothing"] = [one for one in found if one["kind"] in (*GROUPS, "nothing")]
    for kind, of_it in rows.items():
        ratios = [np.array([one["floor"][c] / one["error"][c] for c in CHANNELS])
                  for one in of_it if one["floor"]]
        if not ratios:
            continue
        low, middle, high = np.quantile(ratios, (0.1, 0.5, 0.9), axis=0)
        above = [bool(one["floor"]) and any(one["error"][c] > MAX_OVER_FLOOR * one["floor"][c]
                                            for c in CHANNELS) for one in of_it]
        moments = [bool(one["outliers"]) for one in of_it]
        late = [one["late"] > 0.0 for one in of_it]
        table.add_row(kind, str(len(of_it)), *(
            f"{m:.2f} [{a:.2f}, {b:.2f}]" for a, m, b in zip(low, middle, high, strict=True)),
            str(sum(above)), str(sum(moments)), str(sum(late)),
            str(sum(map(any, zip(above, moments, late, strict=True)))),
            str(sum(one["verdict"] in SILENT for one in of_it)))
    return table


def main() -> None:
    """Run what is missing and print the table."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--kinds", nargs="+", choices=[*GROUPS, *EVENTS], default=[*GROUPS, *EVENTS])
    p.add_argument("--count", type=int, default=24, help="drives of each kind")
    p.add_argument("--first-seed", type=int, default=400)
    p.add_argument("--jobs", type=int, default=2, help="cores")
    p.add_argument("--out", type=Path, default=OUT, help="lines of JSON, resumed")
    o = p.parse_args()
    o.out.parent.mkdir(parents=True, exist_ok=True)
    lines = o.out.read_text(encoding="utf-8").splitlines() if o.out.is_file() else []
    before = {one["key"]: one for one in map(json.loads, lines)}
    wanted = drives(o.kinds, o.count, o.first_seed)
    missing = [d for d in wanted if d.key not in before]
    with o.out.open("a", encoding="utf-8") as file:
        for one in each(run, missing, o.jobs, parts=max(len(missing), 1)):
            file.write(json.dumps(one) + "\n")
            file.flush()
            before[one["key"]] = one
    Console(width=170).print(make_table([before[d.key] for d in wanted]))


if __name__ == "__main__":
    main()
