"""What the set-up refuses, and the command that it suggests."""

from __future__ import annotations

import subprocess

import pytest
from setup_box import DATA, Box, list_announced
from setup_laws import second_run_does_nothing


@pytest.mark.parametrize(("options", "message"), [
    (["--bogus"], "no option '--bogus'"), (["setup"], "no option 'setup'"),
    (["--car"], "--car wants"), (["--car", "a b"], "found 'a b'"), (["--car", "../x"], "../x"),
    (["--car", "a\nb"], "--car wants"),
    (["--i2c", "one"], "/dev/i2c-N"), (["--i2c", "-1"], "/dev/i2c-N"),
    (["--uv", "uv"], "whole path"),
])
def test_a_command_line_that_cannot_be_meant(box: Box, options: list[str], message: str) -> None:
    done = box.run(*options)
    assert done.returncode == 2
    assert message in done.stderr
    assert "try: sh " in done.stderr
    assert box.deeds == []


@pytest.mark.parametrize(("environment", "message", "try_"), [
    ({"UNAME_S": "Darwin"}, "runs Darwin", "make setup"),
    ({"ID_U": "0"}, "not as root", "setup.sh"),
    ({"HOME": "/srv/a b"}, "'/srv/a b'", "mv it"),
    ({"HOME": ""}, "the path ''", "mv it"),
    ({"UNAME_M": "x86_64"}, "STOP  processor", "make setup"),
    ({"UNAME_M": "armv7l"}, "32-bit", "64-bit"),
    ({"GLIBC": "2.23"}, "STOP  glibc", "JetPack 4.2"),
    ({"YEAR": "1970"}, "no certificate", "date -s"),
    ({"GLIBC": "2.4"}, "STOP  glibc", "JetPack 4.2"),
    ({"SUDO_N": "1"}, "STOP  sudo", "sudoers"),
    ({"FREE_KB": "300000"}, "292 MB free", "apt-get clean"),
])
def test_a_computer_that_cannot_be(box: Box, environment: dict[str, str], message: str,
                                   try_: str) -> None:
    done = box.run(**environment)
    assert done.returncode == 1
    assert message in done.stdout + done.stderr
    assert try_ in done.stdout + done.stderr
    assert box.deeds == []
    assert list_announced(done.stdout) == []


def run_refused(box: Box, check: str, *options: str) -> str:
    done = box.run(*options)
    assert done.returncode == 1, done.stdout
    assert f"STOP  {check}" in done.stdout
    assert box.deeds == []
    planned = box.run("--dry-run", *options)
    assert planned.returncode == 1, "a plan that cannot be carried out is reported"
    assert "what would follow then" in planned.stdout
    assert list_announced(planned.stdout), "and shows what would follow"
    return done.stdout


@pytest.mark.slow
def test_no_bus(box: Box) -> None:
    (box.root / "dev" / "i2c-1").unlink()
    box.put("dev/i2c-0", "")
    assert "there:  i2c-0" in run_refused(box, "i2c")


@pytest.mark.slow
def test_no_driver_for_the_bridge(box: Box) -> None:
    box.set("drivers", "ftdi_sio")
    assert "--ft232" in run_refused(box, "bridge")
    assert box.run("--ft232").returncode == 0
    box.put("lib/modules/4.9.337-tegra/modules.builtin", "kernel/drivers/usb/serial/ch341.ko\n")
    assert box.run().returncode == 0, "built in is as good"


@pytest.mark.slow
@pytest.mark.parametrize("rule", [
    'ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="brltty_usb_run"\n',
    'ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523", ENV{ID_BRLTTY}="1"\n',
])
def test_brltty_takes_the_nano(box: Box, rule: str) -> None:
    path = box.put("lib/udev/rules.d/85-brltty.rules", rule)
    assert "apt-get remove brltty" in run_refused(box, "brltty")
    assert box.run("--ft232", "--dry-run").returncode == 0
    path.write_text("# " + rule)
    assert box.run("--dry-run").returncode == 0, "a rule that is commented out takes nothing"


@pytest.mark.slow
def test_a_foreign_command_of_that_name_is_not_overwritten(box: Box) -> None:
    theirs = box.put("usr/local/bin/dart-hal", "theirs")
    done = box.run()
    assert done.returncode == 1
    assert "another program's" in done.stderr
    assert theirs.read_text() == "theirs"


def test_without_sudo_or_apt(box: Box) -> None:
    box.change("setup.sh", "PATH=$PATH:/usr/sbin:/sbin", "")
    box.remove_command("sudo")
    box.remove_command("apt-get")
    done = box.run()
    assert done.returncode == 1
    assert "there is no sudo here" in done.stdout
    assert "no apt-get" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["packages", "uv", "python", "package"])
def test_without_a_network_the_step_states_so_and_what_is_done_stays(box: Box, lost: str) -> None:
    if lost != "packages":
        box.set("packages", "curl", "i2c-tools", "avrdude", "ca-certificates")
    uv = ["--uv", str(box.folder / "uv")] if lost in ("python", "package") else []
    if lost == "package":
        box.set("python")
    cut = box.run(*uv, OFFLINE="1")
    assert cut.returncode == 1
    assert "needed the network" in cut.stderr
    assert "nmcli device wifi connect" in cut.stderr
    assert not (box.home / DATA / "current").exists()
    assert box.run(*uv).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("refused", ["systemctl enable*", "mv -f *80-dart.rules"])
def test_a_command_that_fails_is_named_and_the_next_run_goes_on(box: Box, refused: str) -> None:
    cut = box.run(REFUSE=refused)
    assert cut.returncode == 1
    assert "error: this did not succeed: " in cut.stderr
    assert "the same command again" in cut.stderr
    second_run_does_nothing(box)


@pytest.mark.slow
def test_two_at_once(box: Box) -> None:
    box.run()
    with subprocess.Popen(["flock", str(box.home / DATA / "setup" / "lock"), "sh", "-c",
                           "echo held; read x"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        done = box.run()
        assert done.returncode == 1
        assert "another run" in done.stderr
        other.communicate("\n")
    assert box.run().returncode == 0
