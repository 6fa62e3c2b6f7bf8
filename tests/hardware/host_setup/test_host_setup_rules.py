"""The udev rules: taken by udev's own parser, and what they order for each device."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from setup_box import SETUP
from udev_rules import BadRule, UdevDevice, apply, parse

TEXT = (SETUP / "80-dart.rules").read_text()


def tty(vendor: str, product: str, action: str = "add") -> UdevDevice:
    return UdevDevice("tty", {"idVendor": vendor, "idProduct": product}, action=action)


@pytest.mark.parametrize(("vendor", "product"), [("1a86", "7523"), ("0403", "6001")])
def test_a_nano_has_a_name_a_unit_and_an_owner(vendor: str, product: str) -> None:
    given = apply(parse(TEXT), tty(vendor, product))
    assert given["SYMLINK"] == "dart-nano"
    assert given["TAG"] == "systemd", "the service binds to it"
    assert (given["GROUP"], given["MODE"]) == ("dialout", "0660")
    assert given["ENV{ID_MM_DEVICE_IGNORE}"] == "1"


def test_the_lidar_has_names_of_its_own() -> None:
    given = apply(parse(TEXT), tty("10c4", "ea60"))
    assert given["SYMLINK"].split() == ["dart-lidar", "ydlidar"]
    assert "TAG" not in given


def test_an_ft232_hands_its_bytes_on_at_once() -> None:
    given = apply(parse(TEXT), UdevDevice("usb-serial", driver="ftdi_sio"))
    assert given == {"ATTR{latency_timer}": "1"}
    assert apply(parse(TEXT), UdevDevice("usb-serial", driver="ch341-uart")) == {}


@pytest.mark.parametrize("device", [
    tty("2341", "0043"), tty("1a86", "7522"), tty("1a86", "7523", action="remove"),
    UdevDevice("usb", {"idVendor": "1a86", "idProduct": "7523"}), UdevDevice("tty"),
])
def test_other_devices_are_left_alone(device: UdevDevice) -> None:
    assert apply(parse(TEXT), device) == {}


@pytest.mark.parametrize(("old", "new"), [
    ('ATTRS{idVendor}=="1a86"', 'ATTRS{idVendor}="1a86"'),
    ('SYMLINK+="dart-nano"', 'SYMLINK=="dart-nano"'),
    ('SYMLINK+="dart-nano"', 'SYMLINK="dart-nano"'),
    ('SUBSYSTEM=="tty"', 'SUBSYSTM=="tty"'), ('LABEL="dart_end"', 'LABEL="end"'),
    ('TAG+="systemd"', "TAG+=systemd"), ('ATTRS{idVendor}=="1a86"', 'ATTRS=="1a86"'),
])
def test_a_slip_is_found(old: str, new: str) -> None:
    assert old in TEXT
    with pytest.raises(BadRule):
        parse(TEXT.replace(old, new, 1))


def complaints(text: str, folder: Path) -> str:
    """Messages of udev itself about the rules: `udevadm verify`, or its parser at a test device."""
    folder.mkdir()
    (folder / "80-dart.rules").write_text(text)
    tool = shutil.which("udevadm") or shutil.which("udevadm", path="/usr/sbin:/sbin")
    if tool is None:
        pytest.skip("no udevadm here: only our own parser has read the rules")
    version = subprocess.run([tool, "--version"], capture_output=True, text=True, check=True).stdout
    if int(version) < 254:
        return by_test_device(tool, folder)
    done = subprocess.run([tool, "verify", str(folder / "80-dart.rules")], capture_output=True,
                          text=True, check=False)
    return done.stdout + done.stderr if done.returncode else ""


def by_test_device(tool: str, folder: Path) -> str:
    """Before systemd 254: let it load the rules in a mount namespace of its own."""
    inside = (f"mount -t tmpfs none /run && mkdir -p /run/udev && "
              f"cp -r {folder} /run/udev/rules.d && {tool} test /sys/class/tty/tty0 2>&1")
    done = subprocess.run(["unshare", *([] if os.getuid() == 0 else ["-r"]), "-m", "sh", "-c",
                           inside], capture_output=True, text=True, check=False)
    if "Reading rules file: /run/udev/rules.d/80-dart.rules" not in done.stdout:
        pytest.skip("udevadm of this computer cannot read rules in a namespace of their own")
    return "\n".join(line for line in done.stdout.splitlines()
                     if "80-dart.rules:" in line)


def test_udev_itself_takes_them(tmp_path: Path) -> None:
    assert complaints(TEXT, tmp_path / "rules") == ""
    broken = TEXT.replace("SYMLINK+=", "SYMLINKS+=", 1)
    assert "SYMLINKS" in complaints(broken, tmp_path / "broken"), "the control"
