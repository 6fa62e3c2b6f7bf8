"""Write a parameter of the Nano, for example what hardware is fitted.

    python hardware/set_parameter.py safety_out mux         the car of $DART_HAL_URL
    python hardware/set_parameter.py ring_b 1 serial:///dev/ttyUSB0

`safety_out` also takes none, oe, mux. Nothing is sent for an unknown name or a value out of
bounds. The Nano confirms a value once its last byte is stored, 0.1 s later; one that it refuses
(wdt_reset without Optiboot) is said at once. safety_out and ring_b count from the next boot: unplug
the Nano and plug it in again.
"""

from __future__ import annotations

import os
import sys

from dart_hal.core.errors import DartHalError, LinkLost, UsageError
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.wire.codec import encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import PARAM_BY_NAME, PARAM_SET, PARAM_STATUS, Param
from dart_lab.sim.cutoff import CUTOFFS

USAGE = "python hardware/set_parameter.py NAME VALUE [URL]"
BOOT = 2.0
"""s that the Nano needs after its port was opened."""
TRIES = 4
REFUSED = (PARAM_STATUS["UNKNOWN_ID"], PARAM_STATUS["OUT_OF_RANGE"])
"""Final; EEPROM_BUSY is not: the value asked for before is still being stored."""
ANSWER = 0.5
"""s to wait for the answer to one request."""


def wanted(name: str, value: str) -> tuple[Param, int]:
    """The parameter and the number to write. Raises UsageError that says what exists."""
    if name not in PARAM_BY_NAME:
        raise UsageError(f"there is no parameter {name!r}", expected=", ".join(PARAM_BY_NAME),
                         remedy=USAGE)
    param = PARAM_BY_NAME[name]
    words = CUTOFFS if name == "safety_out" else {}
    try:
        number = words.get(value, None) if value in words else int(value)
    except ValueError:
        number = None
    if number is None or not param.low <= number <= param.high:
        names = f" ({', '.join(words)})" if words else ""
        raise UsageError(f"{name} cannot be {value!r}", remedy=USAGE,
                         expected=f"{param.low} to {param.high}{names}: {param.doc}")
    return param, number


def write(backend: Backend, param: Param, value: int) -> int:
    """Ask until the Nano confirms that it is stored; the value. Raises LinkLost, UsageError."""
    decoder = FrameDecoder()
    ready = backend.clock.now() + BOOT
    for seq in range(TRIES):
        until = ready if seq == 0 else backend.clock.now() + ANSWER
        if seq:
            backend.link.write(encode(PARAM_SET, seq, {"id": param.id, "reserved": 0,
                                                       "value": value}))
        while backend.clock.now() < until:
            chunk = backend.link.read(0.1)
            for frame in decoder.feed(chunk.data if chunk else b""):
                answer = frame.as_dict()
                if frame.message.name != "PARAM_VALUE" or answer["id"] != param.id:
                    continue
                if answer["status"] == PARAM_STATUS["OK"] and answer["value"] == value:
                    return value
                if answer["status"] in REFUSED:
                    raise UsageError(f"the Nano refuses {param.name} = {value}",
                                     found=f"it stays {answer['value']}", expected=param.doc,
                                     remedy="dart-hal doctor names its bootloader and version")
    raise LinkLost(f"the Nano did not confirm {param.name}", found=f"{TRIES - 1} requests",
                   remedy="dart-hal doctor, then try again")


def main() -> int:
    """Write, and say what is in force."""
    args = sys.argv[1:]
    if args in (["-h"], ["--help"]):
        sys.stdout.write(__doc__ or "")
        return 0
    url = args[2] if len(args) == 3 else os.environ.get("DART_HAL_URL", "sim://")
    try:
        if len(args) not in (2, 3):
            raise UsageError("a name and a value are needed", found=" ".join(args),
                             expected=", ".join(PARAM_BY_NAME), remedy=USAGE)
        param, value = wanted(args[0], args[1])
        backend = open_backend(url)
        try:
            now = write(backend, param, value)
        finally:
            backend.close()
    except DartHalError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{param.name} = {now}; unplug the Nano and plug it in again\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
