"""One owner of a chip: refused by bus and address, let go by the kernel."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dart_hal.core.errors import PcaBusy, PcaClaimed
from dart_hal.core.process import locks
from dart_hal.devices.actuation import owner
from dart_hal.devices.actuation.owner import lock_chip, lock_path, refuse_claimed

OWNER = """
import sys, time
from pathlib import Path
from dart_hal.devices.actuation import owner
owner.FOLDERS = (Path(sys.argv[2]),)
release = owner.lock_chip(sys.argv[1], 0x40)
print("owner", flush=True)
time.sleep(60)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(owner, "FOLDERS", (tmp_path,))
    return tmp_path


def test_a_second_owner_is_refused_in_the_same_process_and_from_a_thread() -> None:
    release = lock_chip("1", 0x40)
    with pytest.raises(PcaBusy, match=r"0x40 of i2c=1 is driven already") as caught:
        lock_chip("1", 0x40)
    assert f"pid {os.getpid()}" in caught.value.found
    assert "this process" in caught.value.found
    assert "dart-hal stop" in caught.value.remedy
    refused = []

    def other() -> None:
        try:
            lock_chip("1", 0x40)
        except PcaBusy as error:
            refused.append(error)

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert len(refused) == 1
    release()
    release()
    lock_chip("1", 0x40)()


def test_another_address_and_another_bus_are_other_chips(folder: Path) -> None:
    held = [lock_chip("1", 0x40), lock_chip("1", 0x41), lock_chip("7", 0x40),
            lock_chip(f"unix:{folder}/a", 0x40), lock_chip(f"unix:{folder}/b", 0x40)]
    for release in held:
        release()


def test_one_socket_by_two_names_is_one_bus(folder: Path) -> None:
    (folder / "link").symlink_to(folder / "i2c")
    assert lock_path(f"unix:{folder}/link", 0x40) == lock_path(f"unix:{folder}/i2c", 0x40)
    assert lock_path("01", 0x40) == lock_path("1", 0x40)


def test_the_holder_is_named_and_a_killed_one_has_let_go(folder: Path) -> None:
    program = subprocess.Popen([sys.executable, "-c", OWNER, "1", str(folder)],
                               stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    assert program.stdout.readline() == "owner\n"
    with pytest.raises(PcaBusy) as caught:
        lock_chip("1", 0x40)
    assert f"pid {program.pid} ({os.path.basename(sys.executable)}" in \
        caught.value.found.replace(os.path.dirname(sys.executable) + "/", "")
    program.kill()
    program.wait()
    program.stdout.close()
    lock_chip("1", 0x40)()


def test_a_child_of_the_owner_does_not_keep_the_chip() -> None:
    release = lock_chip("1", 0x40)
    ready, done = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        os.write(ready[1], b"x")
        os.read(done[0], 1)
        os._exit(0)
    os.read(ready[0], 1)
    with pytest.raises(PcaBusy):
        lock_chip("1", 0x40)                                  # the fork has not unlocked it either
    release()
    again = lock_chip("1", 0x40)                              # and the child does not hold it
    again()
    os.write(done[1], b"x")
    os.waitpid(child, 0)
    for fd in (*ready, *done):
        os.close(fd)


def test_what_another_user_left_can_be_locked(folder: Path) -> None:
    path = lock_path("1", 0x40)
    path.touch()
    path.chmod(0o444)
    lock_chip("1", 0x40)()
    assert path.exists(), "never removed: a second owner may have it open already"


def test_a_folder_that_is_not_everybodys_is_not_taken(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine, all_of_us = tmp_path / "mine", tmp_path / "all"
    for path, mode in ((mine, 0o755), (all_of_us, 0o1777)):
        path.mkdir()
        path.chmod(mode)
    monkeypatch.setattr(owner, "FOLDERS", (mine, all_of_us))
    assert lock_path("1", 0x40).parent == all_of_us


def sysfs(root: Path, *, bound: bool) -> Path:
    device = root / "bus" / "i2c" / "devices" / "1-0040"
    device.mkdir(parents=True)
    (device / "name").write_text("ina3221\n")
    if bound:
        driver = root / "bus" / "i2c" / "drivers" / "ina3221"
        driver.mkdir(parents=True)
        (device / "driver").symlink_to(driver)
    return root


def test_an_address_of_the_kernel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PcaClaimed, match="belongs to the kernel") as caught:
        lock_chip("1", 0x40, sysfs(tmp_path / "sys", bound=True))
    assert caught.value.found == "ina3221, driver ina3221"
    assert "i2c=7 on an Orin Nano" in caught.value.remedy
    assert not list(tmp_path.glob("dart-hal-*")), "nothing is locked on the way"


def test_a_device_without_a_driver_and_other_addresses_are_free(tmp_path: Path) -> None:
    root = sysfs(tmp_path / "sys", bound=False)
    refuse_claimed("1", 0x40, root)
    refuse_claimed("7", 0x40, root)
    refuse_claimed("1", 0x41, root)
    refuse_claimed(f"unix:{tmp_path}/i2c", 0x40, root)


def test_a_process_without_a_number_is_described_so() -> None:
    assert "does not tell" in locks.describe_process(0)
    assert locks.describe_process(2 ** 22 + 1) == f"pid {2 ** 22 + 1}"
