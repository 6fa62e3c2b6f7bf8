"""The service: systemd's own checker, and the facts that tie it to rules, script and verbs."""

from __future__ import annotations

import shutil
import subprocess
from configparser import RawConfigParser
from pathlib import Path

import pytest
from setup_box import SETUP, Box
from udev_rules import UdevDevice, apply, parse

from dart_hal.cli.main import VERBS
from dart_hal.devices.actuation.standby import POLL_INTERVAL

TEXT = (SETUP / "dart-hal.service").read_text()
DATA = "/srv/driver/.local/share/dart-hal"


def fill_template(text: str = TEXT, data: str = DATA, user: str = "root") -> str:
    return (text.replace("@USER@", user).replace("@DATA@", data)
            .replace("@CHECKOUT@", "/srv/driver/dart-hal"))


def read(text: str) -> RawConfigParser:
    """Sections and keys; a key that is given twice is an error here."""
    unit = RawConfigParser(strict=True, delimiters=("=",), comment_prefixes=("#",))
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(text)
    return unit


def device_unit(path: str) -> str:
    """systemd's name for a device node: systemd.unit(5), string escaping."""
    name = path.strip("/")
    plain = "".join("-" if c == "/" else c if c.isalnum() or c in "_.:" else f"\\x{ord(c):02x}"
                    for c in name)
    return plain + ".device"


def is_sound(text: str) -> None:
    """What the service must declare; each line has a control below."""
    unit = read(fill_template(text))
    service = unit["Service"]
    assert service["Type"] == "notify"
    assert service["Restart"] == "on-failure"
    assert unit["Unit"]["StartLimitIntervalSec"] == "0", "it never gives up"
    assert 5 * POLL_INTERVAL < float(service["WatchdogSec"]) <= 5.0
    assert service["SuccessExitStatus"] == "143"
    nano = device_unit("/dev/" + symlink())
    assert unit["Unit"]["BindsTo"] == unit["Unit"]["After"] == unit["Install"]["WantedBy"] == nano
    program = f"{DATA}/current/bin/dart-hal"
    assert service["ExecStart"] == f"{program} standby"
    assert service["ExecStopPost"] == f"{program} stop"
    assert {"standby", "stop"} <= set(VERBS)
    assert service["User"] not in ("", "@USER@")
    assert "@" not in "".join(v for s in unit.sections() for v in unit[s].values())


def symlink() -> str:
    rules = parse((SETUP / "80-dart.rules").read_text())
    return apply(rules, UdevDevice("tty", {"idVendor": "1a86", "idProduct": "7523"}))["SYMLINK"]


def test_the_unit_is_sound() -> None:
    is_sound(TEXT)


@pytest.mark.parametrize(("old", "new"), [
    ("Type=notify", "Type=simple"), ("Restart=on-failure", "Restart=no"),
    ("WatchdogSec=2", "WatchdogSec=0"), ("StartLimitIntervalSec=0\n", "StartLimitIntervalSec=9\n"),
    ("BindsTo=dev-dart\\x2dnano.device", "BindsTo=dev-dart-nano.device"),
    ("dart-hal standby", "dart-hal drive"), ("ExecStopPost=", "ExecStop="),
    ("SuccessExitStatus=143\n", "SuccessExitStatus=0\n"),
    ("User=@USER@", "User=@NAME@"),
])
def test_a_weaker_unit_is_found(old: str, new: str) -> None:
    assert old in TEXT
    with pytest.raises((AssertionError, KeyError)):
        is_sound(TEXT.replace(old, new, 1))


@pytest.mark.slow
def test_what_the_script_installs_is_this_unit_and_the_settings_that_it_reads(
        tmp_path: Path) -> None:
    box = Box(tmp_path)
    assert box.run().returncode == 0
    installed = (box.root / "etc/systemd/system/dart-hal.service").read_text()
    data = str(box.home / ".local/share/dart-hal")
    assert installed == fill_template(data=data, user="driver").replace("/srv/driver/dart-hal",
                                                                        str(box.checkout))
    settings = read(installed)["Service"]["EnvironmentFile"]
    assert (box.root / settings.lstrip("/")).is_file()
    shell = subprocess.run(
        ["sh", "-c", f". {box.root}{settings}; echo \"$DART_HAL_URL $DART_HAL_CAR\""],
        capture_output=True, text=True, check=True)
    assert shell.stdout == "serial:///dev/dart-nano?i2c=1 dart-01\n"


def verify_unit(text: str, folder: Path) -> str:
    """Messages of systemd about a unit; "" = nothing."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze here: only the checks above have read the unit")
    program = folder / "current" / "bin" / "dart-hal"
    program.parent.mkdir(parents=True, exist_ok=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    path = folder / "dart-hal.service"
    path.write_text(fill_template(text, data=str(folder)))
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", str(path)],
                          capture_output=True, text=True, check=False)
    return "\n".join(line for line in (done.stdout + done.stderr).splitlines()
                     if "dart-hal.service" in line)


@pytest.mark.slow_except("Type*")
@pytest.mark.parametrize(("old", "new", "message"), [
    ("WatchdogSec=2", "WatchdogSec=soon", "soon"), ("Type=notify", "Type=notifies", "notifies"),
    ("current/bin", "current/bon", "bon"), ("[Install]", "[Instal]", "Instal"),
])
def test_systemd_itself_takes_it(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert verify_unit(TEXT, tmp_path / "good") == ""
    assert message in verify_unit(TEXT.replace(old, new, 1), tmp_path / "bad"), "the control"
