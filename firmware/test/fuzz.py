"""libFuzzer on the Nano's decoder, commands and parameter store.

    python test/fuzz.py [--runs 10000000] [--jobs 2] [--only params]

Builds each harness with clang, seeds it with the frames of tests/wire/vectors.json,
runs it, shrinks what it has learnt to the inputs that reach new code, and prints
executions, speed and findings. A finding is kept in build/fuzz and named with
the command that repeats it.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parents[1]
VECTORS = FIRMWARE.parent / "tests/wire/vectors.json"
LONGEST = {"decoder": 64, "params": 32, "commands": 32}
"""Bytes of an input: some frames; some sets and power cuts; a link, a drive and a trip."""
COMMANDS = ("HELLO_REQ", "HEARTBEAT", "TIME_PING", "PARAM_GET", "PARAM_SET", "REBOOT",
            "EDGES_REQ", "CAPTURE_REQ")
"""In the order of wire::kDown: the harness knows a command by its index."""


@dataclass(frozen=True, slots=True)
class Result:
    """``finding``: the input that breaks a law, None = none; ``speed`` in executions/s."""

    name: str
    runs: int
    speed: float
    corpus: int
    seconds: float
    finding: Path | None
    said: str


def seeds(name: str) -> list[bytes]:
    """First inputs, from the golden frames of the wire."""
    frames = json.loads(VECTORS.read_text(encoding="utf-8"))["frames"]
    if name == "decoder":
        return [bytes.fromhex(f["wire"]) for f in frames]
    if name == "params":
        return [bytes([2, 0x80, 50, 0, 6, 0x80, 144, 1]), bytes([0x8A, 0x80, 1, 0, 5])]
    boot = bytes(3)
    live = bytes([0x1F, 0, 2, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0])
    return [boot + live, *(
        boot + bytes([COMMANDS.index(f["message"]), f["seq"]]) + bytes.fromhex(f["payload"])
        for f in frames if f["message"] in COMMANDS)]


def run(name: str, runs: int, seed: int = 1) -> Result:
    """So many executions of one harness, which must be built."""
    home = FIRMWARE / "build/fuzz"
    corpus, small = home / f"{name}.corpus", home / f"{name}.small"
    corpus.mkdir(exist_ok=True)
    for number, data in enumerate(seeds(name)):
        (corpus / f"seed-{number:02}").write_bytes(data)
    program = [str(home / name), f"-max_len={LONGEST[name]}", f"-artifact_prefix={home}/{name}-"]
    begin = time.monotonic()
    done = subprocess.run([*program, f"-runs={runs}", f"-seed={seed}", "-print_final_stats=1",
                           str(corpus)], capture_output=True, text=True, check=False)
    seconds = time.monotonic() - begin
    shutil.rmtree(small, ignore_errors=True)
    small.mkdir()
    subprocess.run([*program, "-merge=1", str(small), str(corpus)], capture_output=True,
                   check=False)
    if done.returncode == 0:
        shutil.rmtree(corpus)
        small.rename(corpus)
    executed = re.search(r"number_of_executed_units: (\d+)", done.stderr)
    kept = re.search(r"Test unit written to (\S+)", done.stderr)
    count = int(executed[1]) if executed else 0
    return Result(name, count, count / seconds, len(list(corpus.iterdir())), seconds,
                  Path(kept[1]) if kept else None, done.stderr)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10_000_000, help="of each harness (1e7)")
    parser.add_argument("--jobs", type=int, default=2, help="how many harnesses at a time (2)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=sorted(LONGEST))
    wish = parser.parse_args(arguments)
    names = wish.only or list(LONGEST)
    print(f"{'harness':10} {'executions':>12} {'per s':>9} {'corpus':>7} {'min':>6}  finding")
    failed = 0
    with ThreadPoolExecutor(wish.jobs) as pool:
        for r in pool.map(lambda name: run(name, wish.runs, wish.seed), names):
            failed += r.finding is not None or r.runs < wish.runs
            print(f"{r.name:10} {r.runs:12,} {r.speed:9,.0f} {r.corpus:7} {r.seconds / 60:6.1f}  "
                  + (f"{r.finding}; repeat it by build/fuzz/{r.name} {r.finding}"
                     if r.finding else "none"), flush=True)
            if r.finding or r.runs < wish.runs:
                print(r.said[-3000:])
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
