"""The computers of a car: the set-up and the host find the same bus, and never the monitor's."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from setup_box import Box
from trees import TREE_NAMES, plant

from dart_hal.core.errors import BusMissing, PcaClaimed
from dart_hal.core.url import Url
from dart_hal.devices.actuation.owner import refuse_claimed
from dart_hal.devices.links.computers import computer, find_bus, resolve_bus

BUS = {"jetson_nano_jetpack4": 1, "jetson_orin_nano_jetpack6": 7, "raspberry_pi_5_debian12": 1,
       "raspberry_pi_5_debian13": None, "laptop_debian13": 8}
"""What the documents state; None: switched off as it comes."""
BOARDS = [name for name in TREE_NAMES if not name.startswith("laptop")]


@pytest.fixture
def make_box(tmp_path):
    """``boxed(name)``: the set-up on that computer, made of fakes."""
    def make(name: str) -> Box:
        box = Box(tmp_path)
        for old in ("dev", "etc", "proc"):
            shutil.rmtree(box.root / old)
        (box.root / "dev").mkdir()
        plant(name, box.root)
        return box

    return make


def test_every_computer_of_the_guide_has_a_tree():
    assert set(BUS) == set(TREE_NAMES)


@pytest.mark.parametrize("name", TREE_NAMES)
def test_the_bus_is_found_by_the_name_of_the_board(name: str, tmp_path: Path) -> None:
    root = plant(name, tmp_path)
    if BUS[name] is None:
        with pytest.raises(BusMissing, match=r"Raspberry Pi 5 Model B") as caught:
            find_bus(root)
        assert "i2c-13" in caught.value.found
        assert "raspi-config" in caught.value.remedy
        return
    assert find_bus(root) == BUS[name]
    url = resolve_bus(Url.parse("serial:///dev/dart-nano?i2c=auto"), root)
    assert url.options["i2c"] == str(BUS[name])


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.slow_except("raspberry*")
def test_the_set_up_and_the_host_agree(name: str, make_box) -> None:
    box = make_box(name)
    here = computer(box.root)
    assert here is not None
    done = box.run("--dry-run", "--car", "mine")
    assert done.returncode == 0, done.stdout
    assert re.search(r"ok    system +\S", done.stdout), "a system that this was written for"
    assert f'DART_HAL_URL="serial:///dev/dart-nano?i2c={here.bus}"' in done.stdout
    assert "STOP" not in done.stdout


@pytest.mark.slow
def test_a_pi_as_it_comes_gets_its_bus_switched_on(make_box) -> None:
    box = make_box("raspberry_pi_5_debian13")
    assert "off; will be switched on" in box.run("--check").stdout
    assert box.run("--car", "mine").returncode == 0
    assert any(call.startswith("raspi-config nonint do_i2c 0") for call in box.calls)


def test_the_bus_of_the_power_monitor_is_refused_before_anything_is_done(make_box) -> None:
    box = make_box("jetson_orin_nano_jetpack6")
    done = box.run("--i2c", "1")
    assert done.returncode == 1
    assert "STOP  i2c            0x40 on /dev/i2c-1 belongs to the kernel (ina3221)" in done.stdout
    assert "try: --i2c 7" in done.stdout
    assert box.deeds == []
    with pytest.raises(PcaClaimed, match="belongs to the kernel") as caught:
        refuse_claimed("1", 0x40, box.root / "sys")
    assert caught.value.found == "ina3221, driver ina3221"
    refuse_claimed("7", 0x40, box.root / "sys")


def test_without_the_look_at_the_driver_the_set_up_takes_the_monitors_bus(make_box) -> None:
    """The negative control."""
    box = make_box("jetson_orin_nano_jetpack6")
    box.change("checks.sh", "if claimed; then", "if false; then")
    done = box.run("--dry-run", "--i2c", "1")
    assert done.returncode == 0
    assert "pins 3 and 5 of this board are bus 7" in done.stdout, "it only wonders"


def test_the_settings_of_a_wrong_bus_are_not_kept_in_silence(make_box) -> None:
    box = make_box("jetson_orin_nano_jetpack6")
    box.put("etc/dart-hal.env", 'DART_HAL_URL="serial:///dev/dart-nano?i2c=1"\n')
    assert "belongs to the kernel" in box.run().stdout


def test_a_board_that_is_not_known_is_not_guessed_in_silence(box: Box) -> None:
    box.put("proc/device-tree/model", "Khadas VIM4\0")
    output = box.run("--check").stdout
    assert "warn  i2c            /dev/i2c-1; which bus is at pins 3 and 5 of this board" in output
    with pytest.raises(BusMissing, match="Khadas VIM4"):
        find_bus(box.root)


@pytest.mark.parametrize(("model", "bus"), [
    ("NVIDIA Jetson Nano 2GB Developer Kit", 1),
    ("NVIDIA Jetson Orin NX Engineering Reference Developer Kit", 7),
    ("NVIDIA Jetson AGX Orin Developer Kit", 7),
    ("NVIDIA Jetson Xavier NX Developer Kit", 8),
    ("NVIDIA Jetson AGX Xavier Developer Kit", 8), ("Jetson-AGX", 8)])
def test_further_modules_are_known_to_host_and_set_up_by_their_names(box: Box, model: str,
                                                                     bus: int) -> None:
    box.put("proc/device-tree/model", f"{model}\0")
    here = computer(box.root)
    assert here is not None
    assert here.bus == bus
    box.put(f"dev/i2c-{bus}", "")
    output = box.run("--check").stdout
    assert f"/dev/i2c-{bus}, pins 3 and 5 of the header" in output
    for number in (0, 1, bus):
        box.put(f"sys/class/i2c-dev/i2c-{number}/name", "an adapter\n")
    assert find_bus(box.root) == bus


def test_a_pc_without_a_bridge_or_with_two_names_what_is_there(tmp_path: Path) -> None:
    root = plant("laptop_debian13", tmp_path)
    (root / "sys/class/i2c-dev/i2c-1/name").write_text("CP2112 SMBus Bridge on hidraw3\n")
    with pytest.raises(BusMissing) as two:
        find_bus(root)
    assert two.value.found.startswith("2 such; buses: i2c-1 CP2112")
    for number in (1, 8):
        shutil.rmtree(root / f"sys/class/i2c-dev/i2c-{number}")
    with pytest.raises(BusMissing) as none:
        find_bus(root)
    assert none.value.found == "0 such; buses: i2c-0 SMBus I801 adapter at efa0"
    assert "MCP2221" in none.value.expected


def test_a_laptop_is_no_computer_for_the_set_up(make_box) -> None:
    done = make_box("laptop_debian13").run(UNAME_M="x86_64")
    assert done.returncode == 1
    assert "STOP  processor" in done.stdout
