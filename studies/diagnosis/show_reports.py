"""Write five reports of the diagnosis to read: one cause, two, none, one unknown, no mocap.

    python -m studies.diagnosis.show_reports --out build/reports

Each is made from two files by the command line, as a user makes it; ``truth.txt`` says what was
hidden.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from rich.progress import track

from studies.diagnosis.campaign import HOME, write_case
from studies.diagnosis.campaign_cases import Case
from studies.diagnosis.policy_sensitivity import drawn

REPORTS = {"one": ("fixed", "cornering_drag"), "two": ("pair", ""), "none": ("null", ""),
           "unknown": ("far", ""), "onboard": ("onboard", "encoder_slip")}
"""By report: row of the campaign, and the cause that is hidden ("": any)."""


def choose(row: str, cause: str, first_seed: int) -> Case:
    """The first case of a row with a cause."""
    cases = drawn(row, 60, first_seed)
    return next(c for c in cases if not cause or cause in {name for name, _ in c.hidden})


def write_report(name: str, case: Case, folder: Path) -> None:
    """Write the files of a case, its page NAME.html and its terminal text NAME.txt."""
    files = folder / name
    files.mkdir(parents=True, exist_ok=True)
    model, train, test, _ = write_case(case, files)
    words = ["diagnose", "--model", model, "--train", str(train), "--test", str(test),
             "--html", str(folder / f"{name}.html")]
    if case.known == "fixed":
        words.append("--no-refit")
    done = subprocess.run([str(Path(sys.executable).parent / "dart-hal"), *words],
                          capture_output=True, text=True, check=True)
    (folder / f"{name}.txt").write_text(done.stdout + done.stderr, encoding="utf-8")


def main() -> int:
    """Write all reports."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--out", type=Path, default=HOME / "build" / "reports", metavar="FOLDER")
    p.add_argument("--first-seed", type=int, default=7100, metavar="N")
    o = p.parse_args()
    chosen = {name: choose(*REPORTS[name], o.first_seed) for name in REPORTS}
    for name in track(chosen, "reports"):
        write_report(name, chosen[name], o.out)
    (o.out / "truth.txt").write_text("".join(
        f"{name}: {case.hidden or 'nothing hidden'}\n" for name, case in chosen.items()),
        encoding="utf-8")
    print(o.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
