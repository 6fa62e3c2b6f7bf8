"""One owner of a PCA9685: a lock per bus and address, and no quarrel with the kernel.

Two programs that drive one chip would both be armed while the pulses alternate;
the port's lock does not help where each has a Nano of its own. So whoever opens
a car locks the chip first. Guard, ``dart-hal stop`` and the service take no lock:
they write neutral alone.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

from dart_hal.core.errors import PcaBusy, PcaClaimed
from dart_hal.core.process.locks import FileLock, describe_process, holder

FOLDERS = (Path("/run/lock"), Path("/tmp"))
"""The first that is everybody's; both forget at a restart of the computer."""
SYSFS = Path("/sys")
SOCKET = "unix:"


def own(spec: str, address: int, sysfs: Path = SYSFS) -> Callable[[], None]:
    """Become the one who drives the chip at ``address`` of bus ``spec``; returns how to let go.

    The kernel lets go by itself when this process ends, however it ends.
    Raises PcaClaimed, PcaBusy with the holder's number and name, OSError.
    """
    refuse_claimed(spec, address, sysfs)
    path = lock_path(spec, address)
    try:
        return FileLock(path).release
    except BlockingIOError:
        pid = holder(path)
        name = describe_process(pid) if pid is not None else "a program that has ended by now"
        raise PcaBusy(f"the PCA9685 at {address:#04x} of i2c={spec} is driven already",
                      found=name + (", this one" if pid == os.getpid() else "")) from None


def lock_path(spec: str, address: int) -> Path:
    """The file that stands for a chip: the same whatever the bus's node is called."""
    if spec.startswith(SOCKET):
        path = os.path.realpath(spec[len(SOCKET):])
        bus = "socket-" + sha256(path.encode()).hexdigest()[:16]
    else:
        bus = f"i2c-{int(spec)}"
    return _folder() / f"dart-hal-pca9685-{bus}-{address:#04x}"


def refuse_claimed(spec: str, address: int, sysfs: Path = SYSFS) -> None:
    """Raise PcaClaimed if a driver of the kernel has bound ``address`` of a real bus.

    Combined transfers (I2C_RDWR), which are all that we do, would pass by it.
    """
    if spec.startswith(SOCKET):
        return
    device = sysfs / "bus" / "i2c" / "devices" / f"{int(spec)}-{address:04x}"
    if (device / "driver").exists():
        driver, name = (device / "driver").resolve().name, device / "name"
        part = f"{name.read_text().strip()}, " if name.is_file() else ""
        raise PcaClaimed(f"{address:#04x} on /dev/i2c-{int(spec)} belongs to the kernel",
                         found=f"{part}driver {driver}")


def _folder() -> Path:
    """Decided by the folder, never by who asks: two users must meet at the same file."""
    for folder in FOLDERS:
        if folder.is_dir() and folder.stat().st_mode & stat.S_IWOTH:
            return folder
    return FOLDERS[-1]
