"""``dart-hal flash``: avrdude at both bootloader speeds, then the firmware's HELLO.

``--browser`` serves a page that does the same by Web Serial, without avrdude.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import click
from serial.tools import list_ports

from dart_hal.car.handshake import identify_port
from dart_hal.car.viewers import open_viewer
from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import console, print_json, results
from dart_hal.core.errors import FlashFailed, PortMissing, UsageError
from dart_hal.core.text_file import read_text
from dart_hal.devices.links.image import find_image
from dart_hal.devices.links.serial_port import holders, is_port

# Optiboot ("new") first, then ATmegaBOOT ("old"). The wrong speed fails within seconds.
BAUDS = (115_200, 57_600)
# USB vendors of serial bridges: CH340, FT232, Arduino, CP210x, PL2303.
USB_BRIDGES = "1A86:|0403:|2341:|10C4:|067B:"


@click.command("flash")
@click.argument("image", required=False, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--port", default=None, help="serial port; found automatically if there is only one")
@click.option("--avrdude", default="avrdude", show_default=True,
              help="program that writes the flash")
@click.option("--baud", type=int, default=None, help="try only this bootloader speed")
@click.option("--browser", is_flag=True,
              help="serve a page that flashes from Chrome or Edge, without avrdude")
@json_option
def command(image: Path | None, port: str | None, avrdude: str, baud: int | None, browser: bool,
            as_json: bool) -> int:
    """Write IMAGE (default: the firmware of this version) to a Nano and wait for its HELLO."""
    path = image or find_image().with_suffix(".hex")
    _check_image(path)
    if browser:
        if port or baud:
            raise UsageError("--browser chooses port and speed on the page",
                             remedy="dart-hal flash --browser without --port and --baud, or with "
                                    "them and "
                             "without --browser")
        return _serve_page(path, as_json)
    if shutil.which(avrdude) is None:
        raise FlashFailed(f"{avrdude} is not installed",
                          remedy="sudo apt-get install avrdude, name it with --avrdude, or "
                                 "dart-hal flash --browser")
    device = port or _find_port()
    if not is_port(device):
        trouble = f"{device} is no serial port" if Path(device).exists() else \
            f"there is no port {device}"
        raise PortMissing(trouble, found=_describe_ports())
    # A second program on the port would mix its bytes with those of the bootloader.
    for pid, name in holders(device):
        raise FlashFailed(f"{device} is in use", found=f"pid {pid} ({name})",
                          remedy="close that program, then flash again")
    rate, report = _write_image(avrdude, device, path, (baud,) if baud else BAUDS)
    hello = identify_port(device)
    result: dict[str, Any] = {"port": device, "baud": rate, **report, "hello": hello.as_json()}
    if as_json:
        print_json(result)
    else:
        version = ".".join(map(str, hello.version))
        results.print(f"{report['bytes']} bytes written and verified at {rate} baud; "
                      f"firmware {version} answers on {device}")
    return 0


def _serve_page(path: Path, as_json: bool) -> int:
    with open_viewer("flash", path) as server:
        url = f"http://localhost:{server.server_port}/"
        if as_json:
            print_json({"url": url})
        else:
            results.print(f"open {url} in Chrome or Edge on this computer; Ctrl-C ends it")
        server.serve_forever()
    return 0


def _check_image(path: Path) -> None:
    """Check that the file is an Intel hex file with the checksum next to it."""
    if not path.is_file():
        raise UsageError(f"no firmware image at {path}", expected="an Intel hex file",
                         remedy="make firmware, or give the path of dart_nano.hex")
    if not path.read_bytes().startswith(b":"):
        raise UsageError(f"{path} is not an Intel hex file", expected="lines that begin with ':'")
    checksum = path.with_suffix(path.suffix + ".sha256")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if checksum.is_file() and read_text(checksum).split()[0] != digest:
        raise FlashFailed(f"{path} does not match {checksum.name}", found=digest,
                          likely="a broken download or a local build in its place",
                          remedy="make firmware, then dart-hal flash firmware/build/dart_nano.hex")


def _find_port() -> str:
    """Return the only USB serial port. Raises PortMissing for none or several."""
    ports = list(list_ports.grep(USB_BRIDGES))
    if len(ports) == 1:
        return str(ports[0].device)
    raise PortMissing("the port of the Nano is not unique: name it", found=_describe_ports(),
                      expected="one USB serial port",
                      remedy="dart-hal flash --port /dev/ttyUSB0")


def _describe_ports() -> str:
    ports = ", ".join(f"{p.device} ({p.description})" for p in list_ports.grep(USB_BRIDGES))
    return f"USB serial ports: {ports or 'none'}"


# Lines of avrdude's report that name a cause.
COMPLAINT = re.compile(r"error|can.?t|cannot|not in sync|mismatch|not respond|no such|denied|"
                       r"expected signature", re.IGNORECASE)
SIGNATURE = re.compile(r"device signature = *(?:0x)?((?:[0-9a-f]{2} ?){3})", re.IGNORECASE)
# Chips of boards that look like a Nano, by the signature in their data sheets.
CHIPS = {"1E950F": "ATmega328P", "1E9516": "ATmega328PB", "1E9514": "ATmega328",
         "1E9406": "ATmega168", "1E940B": "ATmega168P", "1E9307": "ATmega8",
         "1E9651": "ATmega4809 (Nano Every)"}
CHIP = "ATmega328P"


def find_cause(report: str) -> str:
    """Return the line of avrdude's report that names the cause: the first that complains.

    Lines after it are consequences, such as attempts to synchronise again.
    """
    lines = [line.strip() for line in report.splitlines() if line.strip()]
    complaints = [line for line in lines if COMPLAINT.search(line)]
    return (complaints or lines[-1:] or ["avrdude printed nothing"])[0]


def has_answered(report: str) -> bool:
    """Return whether a bootloader answered: avrdude read the signature of a chip.

    A signature of zeros or ones only is read from a line without a bootloader.
    """
    match = SIGNATURE.search(report)
    if match is not None:
        return not set(match.group(1).lower()) <= set("0 ") and not set(
            match.group(1).lower()) <= set("f ")
    return "expected signature" in report.lower()


def find_chip(report: str) -> str:
    """Return the name of the chip that avrdude found, its signature if unknown, or nothing."""
    match = SIGNATURE.search(report)
    if match is None:
        return ""
    signature = match.group(1).replace(" ", "").upper()
    return CHIPS.get(signature, f"a chip with the signature {signature}")


def _write_image(avrdude: str, port: str, path: Path, bauds: tuple[int, ...]
                 ) -> tuple[int, dict[str, Any]]:
    """Write the image; return speed and report. Raises FlashFailed with the first cause.

    1. Try the bootloaders one speed after the other, until one answers.
    2. If one answered, what went wrong after that is the cause: no other speed is tried.
    3. If none answered, the cause is that of the first speed.
    """
    causes: dict[int, str] = {}
    for baud in bauds:
        console.print(f"trying the bootloader at {baud} baud")
        args = [avrdude, "-c", "arduino", "-p", "m328p", "-P", port, "-b", str(baud), "-D",
                "-U", f"flash:w:{path}:i"]
        try:
            run = subprocess.run(args, capture_output=True, text=True, errors="replace",
                                 timeout=120, check=False)
        except subprocess.TimeoutExpired:
            causes[baud] = "no answer within 120 s"
            continue
        verified = re.search(r"(\d+) bytes of flash verified", run.stderr)
        if run.returncode == 0 and verified:
            return baud, {"bytes": int(verified.group(1)), "verified": True}
        causes[baud] = find_cause(run.stderr)
        if has_answered(run.stderr):
            raise _bootloader_error(port, baud, run.stderr)
    raise FlashFailed(f"avrdude could not write to {port}",
                      found="; ".join(f"at {baud} baud: {cause}" for baud, cause in causes.items()),
                      expected=f"a bootloader at {' or '.join(map(str, bauds))} baud")


def _bootloader_error(port: str, baud: int, report: str) -> FlashFailed:
    """Return the error for a bootloader that answered at ``baud``."""
    chip = find_chip(report)
    cause = f"at {baud} baud: {find_cause(report)}"
    # avrdude names another chip by its signature, or complains about the expected one.
    if (chip and chip != CHIP) or "expected signature" in report.lower():
        return FlashFailed(f"the chip behind {port} is not an {CHIP}; nothing was written",
                           found=f"{chip or 'another chip'} ({cause})",
                           expected=f"an {CHIP}, signature 1E 95 0F",
                           likely="a clone of the Nano with another chip, or another board",
                           remedy=f"use a Nano with an {CHIP}, or name its port with --port")
    return FlashFailed(f"avrdude could not write to {port}", found=cause,
                       expected="flash that is written and verified",
                       remedy="dart-hal flash again, with a shorter cable and without a hub")
