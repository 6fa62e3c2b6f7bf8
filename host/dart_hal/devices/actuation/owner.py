"""One owner of a PCA9685: a lock per bus and address, and no conflict with a kernel driver.

Two programs that drive one chip would both be armed while the pulses alternate. The lock of the
serial port does not prevent it where each program has its own Nano. A program that opens a car
therefore locks the chip first. Guard, ``dart-hal stop`` and the service take no lock: they only
write neutral.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

from dart_hal.core.errors import PcaBusy, PcaClaimed
from dart_hal.core.process.locks import FileLock, describe_process, holder

# Folders for the lock file: the first one that all users can write to. Both are emptied when the
# computer restarts.
FOLDERS = (Path("/run/lock"), Path("/tmp"))
SYSFS = Path("/sys")
SOCKET_PREFIX = "unix:"


def lock_chip(spec: str, address: int, sysfs: Path = SYSFS) -> Callable[[], None]:
    """Lock the chip at ``address`` of bus ``spec`` for this process; return the unlock function.

    The kernel releases the lock when this process ends, however it ends. Raises PcaClaimed,
    PcaBusy with the number and name of the process that holds it, OSError.
    """
    refuse_claimed(spec, address, sysfs)
    path = lock_path(spec, address)
    try:
        return FileLock(path).release
    except BlockingIOError:
        pid = holder(path)
        name = describe_process(pid) if pid is not None else "a program that has ended by now"
        raise PcaBusy(f"the PCA9685 at {address:#04x} of i2c={spec} is driven already",
                      found=name + (", this process" if pid == os.getpid() else "")) from None


def lock_path(spec: str, address: int) -> Path:
    """Return the lock file of a chip; it does not depend on the path of the bus's device node."""
    if spec.startswith(SOCKET_PREFIX):
        from hashlib import sha256

        path = os.path.realpath(spec[len(SOCKET_PREFIX):])
        bus = "socket-" + sha256(path.encode()).hexdigest()[:16]
    else:
        bus = f"i2c-{int(spec)}"
    return _folder() / f"dart-hal-pca9685-{bus}-{address:#04x}"


def refuse_claimed(spec: str, address: int, sysfs: Path = SYSFS) -> None:
    """Raise PcaClaimed if a kernel driver has bound ``address`` of a real bus.

    The transfers of this package (I2C_RDWR) would not notice such a driver.
    """
    if spec.startswith(SOCKET_PREFIX):
        return
    device = sysfs / "bus" / "i2c" / "devices" / f"{int(spec)}-{address:04x}"
    if (device / "driver").exists():
        driver = (device / "driver").resolve().name
        name = device / "name"
        part = f"{name.read_text().strip()}, " if name.is_file() else ""
        raise PcaClaimed(f"{address:#04x} on /dev/i2c-{int(spec)} belongs to the kernel",
                         found=f"{part}driver {driver}")


def _folder() -> Path:
    """Return the folder of the lock files."""
    # The choice must not depend on the user: two users need the same file.
    for folder in FOLDERS:
        if folder.is_dir() and folder.stat().st_mode & stat.S_IWOTH:
            return folder
    return FOLDERS[-1]
