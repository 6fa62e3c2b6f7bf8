"""The page that flashes, in headless chromium, against the real bootloaders in an emulated Nano.

What is emulated is Web Serial itself: no USB, no driver, and no DTR line of a real board.
"""

from __future__ import annotations

import shutil
import subprocess
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge, emulator
from dart_hal.devices.links.image import BOOT_START, BOOTLOADER, load_image, with_bootloader
from dart_lab.live.view.flash_page import serve_flash_page
from tests.live.view.browser import DESK, PHONE
from tests.live.view.web_serial import Relay, web_serial

pytestmark = [pytest.mark.realtime, pytest.mark.slow, pytest.mark.emulator]

PREBUILT_HEX = Path(__file__).parents[3] / "firmware" / "prebuilt" / "dart_nano.hex"
OPTIBOOT = BOOTLOADER.parents[1] / "optiboot" / "optiboot.c"
OPTIBOOT_START = 0x7E00
BEFORE = b"\xff\xcf"
"""A program that does nothing (rjmp .-2): only a reset leads to the bootloader."""


@pytest.fixture(scope="module")
def old():
    """Flash of a Nano with ATmegaBOOT (57600), and where it starts."""
    try:
        bridge.load()
    except EmulatorMissing as why:
        pytest.skip(f"emulator bridge: {why.what}")
    if not BOOTLOADER.is_file():
        pytest.skip("Debian's arduino-core-avr is not installed")
    return with_bootloader(BEFORE), BOOT_START


@pytest.fixture(scope="module")
def new(old, tmp_path_factory):
    """The same with Optiboot 4.4 (115200), from Debian's source in the 512 bytes that it has."""
    if shutil.which("avr-gcc") is None:
        pytest.skip("avr-gcc is not installed")
    out = tmp_path_factory.mktemp("optiboot") / "optiboot.elf"
    subprocess.run(["avr-gcc", "-std=gnu90", "-Os", "-mmcu=atmega328p", "-DF_CPU=16000000L",
                    "-DBAUD_RATE=115200", "-DLED_START_FLASHES=3", "-fwhole-program", "-mrelax",
                    "-fno-tree-scev-cprop", "-nostartfiles", "-nostdlib",
                    f"-Wl,--section-start=.text={OPTIBOOT_START:#x}", OPTIBOOT, "-o", out],
                   check=True, capture_output=True)
    return with_bootloader(BEFORE, out), OPTIBOOT_START


@contextmanager
def nano_of(flash, start, monkeypatch):
    """A Nano that starts at ``start`` and has run into its program."""
    monkeypatch.setattr(emulator, "BOOT_START", start)
    monkeypatch.setattr(emulator, "with_bootloader", lambda image: image)
    with emulator.EmulatedNano(flash, bootloader=True) as nano:
        nano.run(2.0)
        yield nano


@pytest.fixture
def page(browsers):
    """``page(relay)``: the page, served and opened, with that behind its ports."""
    server = serve_flash_page(PREBUILT_HEX)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    one = browsers()

    @contextmanager
    def open_page(relay, *, size=DESK, **more):
        with web_serial(one, relay, **more):
            one.open(f"http://localhost:{server.server_port}/", size)
            one.until("bytes", "chosen")
            yield one

    yield open_page
    server.shutdown()
    thread.join()
    server.server_close()


def is_programmed(nano):
    image = load_image(PREBUILT_HEX)
    return nano.flash[:len(image)] == image


@pytest.mark.parametrize(("sold", "speeds", "size"), [
    ("old", [115200, 57600, 500000], DESK), ("new", [115200, 500000], PHONE)])
def test_it_flashes_and_the_firmware_answers(page, request, monkeypatch, sold, speeds, size):
    with nano_of(*request.getfixturevalue(sold), monkeypatch) as nano:
        relay = Relay(nano)
        with page(relay, size=size) as one:
            assert not is_programmed(nano)
            one.press("go")
            one.until("the firmware answers", "status", within=60.0)
            assert f"at {speeds[-2]} baud" in one.text("done")
            assert "0.1.0" in one.text("done")
            assert one["go"].is_enabled()
            assert one.run("return document.documentElement.scrollWidth") <= size[0]
            names = one.run("return performance.getEntriesByType('resource').map((e) => e.name)")
            assert all(name.startswith(one.run("return location.origin")) for name in names)
            assert [x for x in one.driver.get_log("browser") if x["level"] == "SEVERE"] == []
        assert is_programmed(nano)
        assert relay.speeds == speeds


def one_bit(where, messages):
    """Flips a bit of the ``where``-th page that is written."""
    def damage_message(message):
        if message[:1] != b"\x64":
            return message
        messages.append(message)
        return message[:40] + bytes([message[40] ^ 4]) + message[41:] \
            if len(messages) == where else message
    return damage_message


class OtherFlashChip:
    """Turns the signature of an ATmega328P into that of an ATmega168, in pieces of any size."""

    def __init__(self):
        self._last = b""

    def __call__(self, message):
        other = {b"\x1e\x95": 0x94, b"\x95\x0f": 0x06}
        pairs = zip(self._last[-1:].rjust(1, b"\0") + message, message, strict=False)
        self._last = message or self._last
        return bytes(other.get(bytes(pair), pair[1]) for pair in pairs)


def fails(one, kind, within=60.0):
    one.press("go")
    one.until("Not flashed", "status", within=within)
    assert one["failure"].get_attribute("data-kind") == kind
    assert one.text("remedy")
    assert one["go"].is_enabled()
    return one.text("what")


def test_a_bit_that_came_out_wrong_is_found(page, old, monkeypatch):
    """The negative control of verifying: the flash does differ there, and nowhere else."""
    with nano_of(*old, monkeypatch) as nano:
        with page(Relay(nano, down=one_bit(5, []))) as one:
            at = 4 * 128 + 36
            assert f"address {at:#x}" in fails(one, "mismatch")
        image = load_image(PREBUILT_HEX)
        assert [i for i, byte in enumerate(image) if nano.flash[i] != byte] == [at]


@pytest.mark.parametrize(("kind", "wrong"), [
    ("chip", {"up": OtherFlashChip()}), ("pulled", {"pulled_after": 3000}),
    ("silent", {"deaf": True})])
def test_what_is_wrong_at_the_port_is_named(page, old, monkeypatch, kind, wrong):
    """silent: without its reset no bootloader answers, so the pulse is what leads there."""
    with nano_of(*old, monkeypatch) as nano:
        with page(Relay(nano, **wrong)) as one:
            fails(one, kind)
        assert not is_programmed(nano)
        assert (nano.flash[:2] == BEFORE) is (kind != "pulled")


@pytest.mark.parametrize(("kind", "relay", "present"), [
    ("busy", None, True), ("unchosen", None, False)])
def test_a_port_that_is_busy_or_not_chosen(page, kind, relay, present):
    with page(relay, present=present) as one:
        fails(one, kind)


def test_another_file_and_one_that_is_none(page, old, monkeypatch, tmp_path):
    with nano_of(*old, monkeypatch) as nano, page(Relay(nano)) as one:
        bad = tmp_path / "bad.hex"
        other = tmp_path / "other.hex"
        bad.write_text(PREBUILT_HEX.read_text()[:400])
        other.write_text(":02000000FECF31\n:00000001FF\n")
        one["file"].send_keys(str(bad))
        one.until("no firmware", "what")
        assert not one["go"].is_enabled()
        one["file"].send_keys(str(other))
        one.until("other.hex, 2 bytes", "chosen")
        one.press("go")
        one.until("sends no HELLO", "status", within=60.0)
        assert nano.flash[:2] == b"\xfe\xcf"


@pytest.mark.parametrize(("secure", "kind"), [("true", "unsupported"), ("false", "insecure")])
def test_a_browser_without_serial_ports(browsers, secure, kind):
    one = browsers()
    one.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": f"""
        Object.defineProperty(Navigator.prototype, "serial", {{ value: undefined }});
        Object.defineProperty(window, "isSecureContext", {{ value: {secure} }});"""})
    with serve_flash_page(PREBUILT_HEX) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        one.open(f"http://localhost:{server.server_port}/")
        one.until("Not flashed", "status")
        assert one["failure"].get_attribute("data-kind") == kind
        assert not one["go"].is_enabled()
        server.shutdown()
        thread.join()
