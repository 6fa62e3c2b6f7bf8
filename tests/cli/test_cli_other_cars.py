"""Recordings of other cars than DART's through the verbs."""

from __future__ import annotations

import gzip

import pytest


@pytest.mark.slow
def test_frame_of_a_published_car_leaves_the_side_slip_of_another_car_small(other_cars, verb):
    """v_y of the zheng car at 1 s with the fitted frame as with the one of an independent fit."""
    day = other_cars / "zheng2022" / "day1.csv.gz"
    base = other_cars / "zheng2022" / "base.toml"
    fitted = verb("evaluate", "--json", "--model", base, day).json
    given = verb("evaluate", "--json", "--model", base, "--reference", "0.21,-0.0117,0", day).json
    dart = verb("evaluate", "--json", "--model", base, "--reference", "0.093,0.01,0", day).json
    v_y = [got["horizons"]["1.0"]["pooled"]["vy"] for got in (fitted, given, dart)]
    assert v_y[0] == pytest.approx(v_y[1], rel=0.05)
    assert v_y[2] > 2.0 * v_y[1], "negative control: the frame of another car"
    (frame,) = fitted["references"].values()
    assert set(frame["std"]) == {"lx", "theta", "ly"}
    (use,) = dart["files"].values()
    assert "differs" in use["why"][0]


@pytest.mark.slow
def test_a_second_that_is_missing_changes_no_error_of_a_prediction(other_cars, verb, tmp_path):
    """The rows from 60 to 61 s, in a turn, are taken out: the windows around them go with them."""
    day = other_cars / "zheng2022" / "day1.csv.gz"
    base = other_cars / "zheng2022" / "base.toml"
    head, *rows = gzip.decompress(day.read_bytes()).decode().splitlines()
    start = float(rows[0].split(",")[0])
    kept = [row for row in rows if not 60.0 <= float(row.split(",")[0]) - start < 61.0]
    gap = tmp_path / "gap.csv"
    gap.write_text("\n".join([head, *kept]) + "\n")
    whole, holed = (verb("evaluate", "--json", "--model", base, path).json["horizons"]["1.0"][
        "pooled"] for path in (day, gap))
    assert 10 <= whole["n"] - holed["n"] <= 20
    for channel in ("vx", "vy", "yaw_rate", "position"):
        assert holed[channel] == pytest.approx(whole[channel], rel=0.03)
