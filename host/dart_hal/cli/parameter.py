"""``dart-hal parameter``: store a parameter in the Nano, for example what hardware is fitted."""

from __future__ import annotations

import click

from dart_hal.car.car import DEFAULT_URL
from dart_hal.car.identity import CUTOFF_KINDS
from dart_hal.cli.common.options import json_option, url_option
from dart_hal.cli.common.output import print_json, print_line
from dart_hal.core.errors import LinkLost, UsageError
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.wire.codec import encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import PARAM_BY_NAME, PARAM_SET, PARAM_STATUS, PARAMS, Param

USAGE = "dart-hal parameter NAME VALUE; --help lists the names"
# s that the Nano needs after its port was opened: its bootloader waits for a sketch first.
BOOT_TIME = 2.0
# Requests until the link counts as lost: one damaged frame is rare, three are no accident.
MAX_REQUESTS = 3
# s to wait for the answer to one request.
ANSWER_TIMEOUT = 0.5
# Final answers. EEPROM_BUSY is not: the value requested before is still being stored.
REFUSALS = (PARAM_STATUS["UNKNOWN_ID"], PARAM_STATUS["OUT_OF_RANGE"])
CUTOFF_WORDS = {word: number for number, word in CUTOFF_KINDS.items()}


@click.command("parameter", epilog="\b\n" + "\n".join(
    f"{p.name:<16} {p.low} to {p.high}: {p.doc}" for p in PARAMS))
@click.argument("name")
@click.argument("value")
@url_option
@json_option
def command(name: str, value: str, url: str | None, as_json: bool) -> None:
    """Store a parameter in the Nano, which confirms it.

    safety_out and ring_b, what is fitted, apply from the next boot: unplug the Nano and plug it in
    again. safety_out also takes none, oe, mux. Nothing is sent for an unknown name or a value out
    of bounds.
    """
    param, number = parse_parameter(name, value)
    backend = open_backend(url or DEFAULT_URL)
    try:
        stored = write_parameter(backend, param, number)
    finally:
        backend.close()
    if as_json:
        print_json({"url": backend.url.text, "parameter": param.name, "value": stored})
        return
    print_line(f"{param.name} = {stored}; unplug the Nano and plug it in again")


def parse_parameter(name: str, value: str) -> tuple[Param, int]:
    """Return the parameter and the number to store.

    Raises UsageError with the names or values that exist.
    """
    if name not in PARAM_BY_NAME:
        raise UsageError(f"there is no parameter {name!r}", expected=", ".join(PARAM_BY_NAME),
                         remedy=USAGE)
    param = PARAM_BY_NAME[name]
    words = CUTOFF_WORDS if name == "safety_out" else {}
    try:
        number = words[value] if value in words else int(value)
    except ValueError:
        number = None
    if number is None or not param.low <= number <= param.high:
        names = f" ({', '.join(words)})" if words else ""
        raise UsageError(f"{name} cannot be {value!r}", remedy=USAGE,
                         expected=f"{param.low} to {param.high}{names}: {param.doc}")
    return param, number


def write_parameter(backend: Backend, param: Param, value: int) -> int:
    """Request until the Nano confirms that the value is stored in its EEPROM; return the value.

    Raises UsageError if the Nano refuses it, LinkLost without an answer.
    """
    decoder = FrameDecoder()
    # 1. Let the Nano boot: opening its port resets it.
    end = backend.clock.now() + BOOT_TIME
    for request in range(MAX_REQUESTS + 1):
        # 2. Request, and read the answers for a while.
        if request:
            backend.link.write(encode(PARAM_SET, request,
                                      {"id": param.id, "reserved": 0, "value": value}))
            end = backend.clock.now() + ANSWER_TIMEOUT
        while backend.clock.now() < end:
            chunk = backend.link.read(0.1)
            for frame in decoder.feed(chunk.data if chunk else b""):
                answer = frame.as_dict()
                if frame.message.name != "PARAM_VALUE" or answer["id"] != param.id:
                    continue
                # 3. The Nano reports all parameters at its boot: OK alone is no confirmation.
                if answer["status"] == PARAM_STATUS["OK"] and answer["value"] == value:
                    return value
                if answer["status"] in REFUSALS:
                    raise UsageError(f"the Nano refuses {param.name} = {value}",
                                     found=f"it stays {answer['value']}", expected=param.doc,
                                     remedy="dart-hal doctor names its bootloader and version")
    raise LinkLost(f"the Nano did not confirm {param.name}", found=f"{MAX_REQUESTS} requests",
                   remedy="dart-hal doctor, then try again")
