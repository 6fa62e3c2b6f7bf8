"""The flasher's modules in node, against Python's own and a Nano that does things wrong."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryFile

import pytest

from dart_hal.devices.links.image import BOOT_START, ImageError, parse_hex
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HELLO, HELLO_REQ, PROTO, SCHEMA
from tests.common import ROOT

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

PAGE = ROOT / "host" / "dart_lab" / "live" / "view" / "flash"
PREBUILT = ROOT / "firmware" / "prebuilt" / "dart_nano.hex"
GIVEN = """import { readFileSync } from "node:fs"; import { exit } from "node:process";
const given = JSON.parse(readFileSync(0));
const finish = (it) => { console.log(JSON.stringify(it)); exit(0); };
"""
WHO = {"proto": PROTO, "req_seq": 0, "schema": SCHEMA, "fw_version": (3, 1, 4), "build": 4,
       "git": 0x1234, "board_id": 0x3F0052A1, "boot_count": 258, "reset_cause": 2, "bootloader": 1,
       "boot_nonce": 77, "edges_per_rev": (20, 10), "caps": 0, "clock_hz": 2_000_000,
       "param_crc": 0xBEEF}


def node(script, given, *modules):
    """What ``script`` gives to ``finish``; modules: (names, file)."""
    imports = "".join(f'import {{ {names} }} from "{path.as_uri()}";' for names, path in modules)
    # node may not wait at a pipe
    with TemporaryFile("w+") as request, TemporaryFile("w+") as answer:
        json.dump(given, request)
        request.seek(0)
        done = subprocess.run(["node", "--input-type=module", "-e", imports + GIVEN + script],
                              stdin=request, stdout=answer, stderr=subprocess.PIPE, text=True,
                              timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        answer.seek(0)
        return json.load(answer)


def record(kind, address, data):
    raw = bytes([len(data), address >> 8, address & 0xFF, kind]) + data
    return f":{(raw + bytes([-sum(raw) & 0xFF])).hex().upper()}\n"


END = record(1, 0, b"")


def hex_files(seed=1):
    """Good ones and damaged ones."""
    rng = random.Random(seed)
    good = [PREBUILT.read_text(), PREBUILT.read_text().replace("\n", "\r\n"),
            record(0, 0x100, b"abc") + record(3, 0, bytes(4)) + record(0, 0, b"x") + END,
            record(2, 0, b"\x01\x00") + record(0, 0, b"seg") + END,
            record(4, 0, b"\x00\x00") + record(0, 0x77FF, b"!") + END]
    bad = ["", END, record(0, 0, b"cut off"), record(0, 0x77FF, b"!!") + END,
           record(4, 0, b"\xff\xff") + record(0, 0, b"far") + END, record(6, 0, b"") + END,
           "no hex at all", record(2, 0, b"\x00") + END]
    for _ in range(60):
        text = list(good[2])
        text[rng.randrange(len(text))] = rng.choice("0123456789ABCDEF:xg\n")
        bad.append("".join(text))
    return good + bad


def by_python(text):
    try:
        return parse_hex(text, size=BOOT_START).hex()
    except ImageError:
        return None


@pytest.mark.slow
def test_hex_files_are_read_and_refused_as_python_does():
    files = hex_files()
    script = """finish(given.map((text) => {
        try { return Buffer.from(parse(text)).toString("hex"); }
        catch (why) { if (why.kind !== "hex") throw why; return null; } }))"""
    read = node(script, files, ("parse", PAGE / "hex.mjs"))
    expected = [by_python(text) for text in files]
    assert read == expected
    assert None not in expected[:5]
    assert expected.count(None) > 40


def test_hello_is_read_and_nothing_else_is():
    hello = encode(HELLO, 9, WHO)
    streams = [hello, b"\x00noise\x00" + hello, b"x" * 999 + b"\x00" + hello,
               *(hello[:i] + bytes([hello[i] ^ 1]) + hello[i + 1:] for i in range(len(hello))),
               hello[:-1], encode(HELLO_REQ, 0, {"proto": PROTO, "schema": 0, "flags": 0})]
    script = """finish({ req: HELLO_REQ, read: given.map((bytes) => {
        const whole = new Listener().feed(bytes), slow = new Listener();
        const single = bytes.map((byte) => slow.feed([byte])).find((hello) => hello) ?? null;
        if (JSON.stringify(whole) !== JSON.stringify(single)) throw new Error("pieces");
        return whole; }) })"""
    hellos = node(script, [list(s) for s in streams], ("HELLO_REQ, Listener", PAGE / "hello.mjs"))
    assert bytes(hellos["req"]) == encode(HELLO_REQ, 0, {"proto": PROTO, "schema": 0, "flags": 0})
    expected = {"schema": SCHEMA, "version": [3, 1, 4], "board": 0x3F0052A1,
                "boots": 258, "bootloader": 1}
    assert hellos["read"][:3] == [expected] * 3
    assert hellos["read"][3:] == [None] * (len(hello) + 2)


def flash_all(cases):
    """Outcome of a flash of 300 bytes by each Nano, at the same time."""
    script = """
    const image = Uint8Array.from({ length: 300 }, (_, i) => i * 7 + 3 & 0xff);
    const named = (why) => ({ kind: why.kind, said: why.message });
    const one = async (options) => {
        const nano = new FakeNano(options);
        const done = await flash(nano, image, () => {}).catch(named);
        return { ...done, speeds: nano.speeds, open: !!nano.readable,
                 pages: nano.asked.filter((command) => command === 0x64).length,
                 same: image.every((byte, i) => nano.flash[i] === byte) };
    };
    finish(await Promise.all(given.map(one)))"""
    return node(script, cases, ("flash", PAGE / "flash.mjs"),
                ("FakeNano", Path(__file__).parent / "fake_nano.mjs"))


@pytest.mark.realtime
def test_it_flashes_at_both_speeds_and_names_what_fails():
    hello = list(encode(HELLO, 1, WHO))
    old, new, chip, worn, mute, pulled, busy = flash_all([
        {"hello": hello, "noisy": True}, {"hello": hello, "speed": 115200},
        {"signature": [0x1E, 0x94, 0x06]},
        {"worn": 0x101}, {"mute": 0x64}, {"pulled": 7}, {"busy": True}])
    for done, speeds in ((old, [115200, 57600, 500000]), (new, [115200, 500000])):
        assert (done["speed"], done["bytes"], done["same"]) == (speeds[-2], 300, True)
        assert (done["speeds"], done["pages"], done["open"]) == (speeds, 3, False)
        assert done["hello"]["version"] == [3, 1, 4]
    assert (chip["kind"], chip["pages"]) == ("chip", 0)
    assert "1e 94 06" in chip["said"]
    assert (worn["kind"], worn["same"]) == ("mismatch", False)
    assert "0x101: ff, expected 0a" in worn["said"]
    assert (mute["kind"], pulled["kind"], busy["kind"]) == ("garbled", "pulled", "busy")
    assert not any(done["open"] for done in (chip, worn, mute, pulled, busy))


@pytest.mark.slow
@pytest.mark.realtime
def test_no_answer_or_another_program():
    silent, other = flash_all([{"speed": 19200}, {}])
    assert (silent["kind"], silent["pages"]) == ("silent", 0)
    assert silent["speeds"] == [115200, 57600]
    assert (other["hello"], other["same"], other["open"]) == (None, True, False)
