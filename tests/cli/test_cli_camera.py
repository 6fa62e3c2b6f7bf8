"""What ``doctor`` reports of a camera, verbs of one that --camera names, exports that leave it
out."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from tests.common import KINEMATIC_1_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


def find_check(ran):
    return next((c for c in ran.json["checks"] if c["id"] == "camera"), None)


@pytest.mark.slow
def test_the_doctor_looks_at_it(verb):
    good = find_check(verb("doctor", "--url", KINEMATIC_1_URL, "--camera", "top", "--seconds", 1,
                           "--json"))
    assert good["verdict"] == "ok"
    assert good["found"].startswith("320 x 240, 12.5 per second")
    assert find_check(verb("doctor", "--url", KINEMATIC_1_URL, "--seconds", 1, "--json")) is None


@pytest.mark.slow
def test_one_that_is_not_there_is_named_and_the_rest_is_looked_at(verb, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", ModuleType("cv2"))
    result = verb("doctor", "--url", f"{KINEMATIC_1_URL}&pace=1", "--camera", "usb:/dev/no-camera",
                  "--seconds", 1, "--json")
    assert find_check(result)["verdict"] == "fail"
    assert "/dev/no-camera" in find_check(result)["found"]
    assert {c["id"]: c["verdict"] for c in result.json["checks"]}["hello"] != "fail"


@pytest.mark.parametrize(("camera", "words"), [("side", "is no camera"), ("usb:0?fps=x", "fps=x")])
def test_a_camera_that_cannot_be_is_named(verb, camera, words):
    result = verb("record", "--url", f"{KINEMATIC_1_URL}&pace=1", "--camera", camera,
                  "--json").error
    assert words in result["what"]


@pytest.mark.slow
def test_exports_name_what_they_omit_and_a_bag_has_it(verb, tmp_path):
    run = tmp_path / "run.mcap"
    verb("record", "--url", KINEMATIC_1_URL, "--camera", "top", "--duration", 0.3, "--out", run)
    left = verb("export", "csv", run, "--out", tmp_path / "run.csv")
    assert "images of the camera are not exported" in left.err
    kept = verb("export", "ros2", run, "--out", tmp_path / "bag")
    assert "left out" not in kept.err
    verb("record", "--url", KINEMATIC_1_URL, "--duration", 0.3, "--out", tmp_path / "none.mcap")
    none = verb("export", "csv", tmp_path / "none.mcap", "--out", tmp_path / "none.csv")
    assert "left out" not in none.err
