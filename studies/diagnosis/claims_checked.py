"""Whether claims say the truth about themselves: the interval of their cost, and their probability.

    python -m studies.diagnosis.claims_checked --cases 100 --sets 20 --out FILE

Cars with wrong parameters, as in the row ``wrong`` of the campaign. The cost of each claim on the
recording to judge by (60 s) has a 90 % interval; here it is compared with the cost on a recording
five times as long of the same car, by the same fits. And the probability of each group, from a
search through sets of groups, is compared with that by all 128 sets, each fitted (--sets cases).
Lines of JSON; a case that is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track
from scipy.stats import binomtest

from dart_hal.core.process.jobs import each
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import conclude, diagnose
from dart_lab.diagnosis.parameters.claims import ClaimInputs, find_claims
from dart_lab.diagnosis.parameters.sets import posterior, posterior_of_all_sets
from dart_lab.diagnosis.parameters.unseen import RecordingLosses
from dart_lab.diagnosis.run import make_evidence
from studies.diagnosis.campaign import done
from studies.diagnosis.campaign_cases import Case, car, cases, habits
from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger_files import pair

SECONDS = (60.0, 60.0)
LONG = 300.0  # s; its own error is less than half that of a minute
BELIEVED = {"min_error_ratio": 0.0}
"""Every group that is believed has a cost here: those picked for a large one would be biased."""


def run(case: Case, sets: bool = False) -> dict[str, Any]:
    """One line: by claimed group its cost, interval, and cost on the long recording."""
    rng = np.random.default_rng(case.number)
    how, what = habits(case, rng), car(case, rng)
    with tempfile.TemporaryDirectory() as folder:
        train, test = pair(Path(folder), what, how, SECONDS, case.number)
        _, long = pair(Path(folder), what, how, (1.0, LONG), case.number + 1)
        recordings = [read(path) for path in (train, test, long)]
    asked = _asked(*recordings[:2])
    evidence, _ = make_evidence(recordings[2:], asked.logged.body.l_r)
    out: dict[str, Any] = {"key": case.key, "hidden": case.hidden}
    if sets:
        groups = asked.groups
        ways = (posterior(groups, asked.seed), posterior_of_all_sets(groups, asked.seed))
        out["sets"] = {g: [way.probability(g) for way in ways] for g in sorted(groups.all_groups)}
    shown = {c.group for c in find_claims(asked)}
    policy = asked.groups.policy
    asked.groups.policy = replace(policy, claims=replace(policy.claims, **BELIEVED))
    there_seen = RecordingLosses(evidence, asked.losses.last, policy)
    here, there = ({c.group: c.cost for c in find_claims(replace(asked, losses=seen))}
                   for seen in (asked.losses, there_seen))
    out["costs"] = {g: {"shown": g in shown, "ratio": here[g][0], "ci90": here[g][1:],
                        "long": there[g][0]} for g in here}
    return out


def _asked(train: Any, test: Any) -> ClaimInputs:
    """What the diagnosis asks of its claims."""
    kept: list[ClaimInputs] = []

    def keep(asked: ClaimInputs) -> Any:
        kept.append(asked)
        return find_claims(asked)

    real, conclude.find_claims = conclude.find_claims, keep
    try:
        diagnose(*find_model("paper"), [train], [test])
    finally:
        conclude.find_claims = real
    return kept[-1]


def report(found: Mapping[str, Any]) -> None:
    """Print shares with their intervals."""
    costs = [c for line in found.values() for c in line["costs"].values()]
    for what, some in (("believed", costs), ("shown", [c for c in costs if c["shown"]])):
        if not some:
            continue
        inside = [c["ci90"][0] <= c["long"] <= c["ci90"][1] for c in some]
        above = sum(c["long"] > c["ci90"][1] for c in some)
        low, high = binomtest(sum(inside), len(inside)).proportion_ci(0.9, "wilson")
        print(f"cost of a {what} group within its 90 % interval: {np.mean(inside):.2f} of "
              f"{len(inside)} ({low:.2f} to {high:.2f}), above {above}, "
              f"below {len(inside) - sum(inside) - above}")
    apart = [(abs(a - b), line["key"], g) for line in found.values()
             for g, (a, b) in line.get("sets", {}).items()]
    if apart:
        print(f"probability by the search against all sets, {len(apart)} groups: at most "
              f"{max(apart)[0]:.3f} apart ({max(apart)[2]} of {max(apart)[1]})")


def main() -> None:
    """Run what is missing, print both tables."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--cases", type=int, default=100)
    p.add_argument("--sets", type=int, default=20, help="cases of which all sets are fitted")
    p.add_argument("--first-seed", type=int, default=2000)
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--out", type=Path, required=True)
    o = p.parse_args()
    found = done(o.out)
    every = cases(["wrong"], (), o.first_seed)[:o.cases]
    with o.out.open("a", encoding="utf-8") as file:
        for wanted, sets in ((every[:o.sets], True), (every[o.sets:], False)):
            missing = [c for c in wanted if c.key not in found]
            lines = each(partial(run, sets=sets), missing, o.jobs, parts=len(missing))
            for line in track(lines, "asking", len(missing)):
                found[line["key"]] = line
                file.write(json.dumps(line) + "\n")
                file.flush()
    report(found)


if __name__ == "__main__":
    main()
