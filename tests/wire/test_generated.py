"""Generated files match their source, and reproduce from the vectors."""

import json
import shutil
import subprocess

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.wire import cobs, emit
from dart_hal.wire.codec import encode, pack
from dart_hal.wire.crc import crc16
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import BY_NAME, MESSAGES
from tests.common import ROOT

VECTORS = json.loads((ROOT / "tests/wire/vectors.json").read_text(encoding="utf-8"))
HEADER = ROOT / "firmware/src/core/messages.h"
WARNINGS = ["-std=gnu++11", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wshadow",
            "-Werror"]


def test_nothing_drifted():
    assert emit.list_stale(ROOT) == []


def test_drift_is_detected_and_repaired(tmp_path):
    assert sorted(emit.list_stale(tmp_path)) == sorted(emit.GENERATED_FILES)
    emit.write_all(tmp_path)
    assert emit.list_stale(tmp_path) == []
    stale = tmp_path / "docs/reference/wire.md"
    stale.write_text(stale.read_text().replace("STATE", "STATUS", 1))
    assert emit.list_stale(tmp_path) == ["docs/reference/wire.md"]
    assert emit.write_all(tmp_path) == ["docs/reference/wire.md"]
    assert emit.write_all(tmp_path) == []


def test_a_seed_of_the_checkout_is_refused(tmp_path):
    """A definition whose text changed while its seed did not must not be written."""
    emit.write_all(tmp_path)
    path = tmp_path / emit.VECTORS
    path.write_text(path.read_text().replace("STATE 0x10 up; t_ck:", "STATE 0x10 up; time:"))
    with pytest.raises(UsageError, match="retired"):
        emit.write_all(tmp_path)


def test_damaged_vectors_are_named(tmp_path):
    (tmp_path / "tests/wire").mkdir(parents=True)
    (tmp_path / emit.VECTORS).write_text("{")
    with pytest.raises(UsageError, match="vectors"):
        emit.write_all(tmp_path)


@pytest.mark.parametrize("case", VECTORS["frames"], ids=lambda c: f"{c['message']}-{c['seq']}")
def test_frame_vectors(case):
    message = BY_NAME[case["message"]]
    wire = bytes.fromhex(case["wire"])
    assert pack(message, case["values"]).hex() == case["payload"]
    assert encode(message, case["seq"], case["values"]) == wire
    (frame,) = FrameDecoder().feed(wire)
    assert (frame.message, frame.seq, frame.payload.hex()) == (message, case["seq"],
                                                               case["payload"])


def test_crc_and_cobs_vectors():
    for case in VECTORS["crc"]:
        assert crc16(bytes.fromhex(case["data"]), case["seed"]) == case["crc"]
    for case in VECTORS["cobs"]:
        assert cobs.encode(bytes.fromhex(case["raw"])).hex() == case["block"]
        assert cobs.decode(bytes.fromhex(case["block"])).hex() == case["raw"]


def test_the_pattern_distinguishes_every_byte_from_every_other():
    for case in VECTORS["frames"]:
        if case["seq"] == 0x5A:
            payload = bytes.fromhex(case["payload"])
            assert len(set(payload)) == len(payload)


def test_header_is_narrow_and_names_every_message():
    lines = HEADER.read_text().splitlines()
    assert max(map(len, lines)) <= 80
    for m in MESSAGES:
        assert any(f"kSeed = 0x{m.seed:04X}u;" in line for line in lines)


@pytest.mark.slow_except("avr-g++")
@pytest.mark.parametrize("compiler", [["g++"], ["avr-g++", "-mmcu=atmega328p", "-Os"]],
                         ids=lambda c: c[0])
def test_header_compiles_without_a_warning(compiler, tmp_path):
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"{compiler[0]} is not installed")
    source = tmp_path / "use.cpp"
    source.write_text(f'#include "{HEADER}"\n'
                      "bool f(uint8_t const* p, uint8_t* q) {\n"
                      "  dart::wire::State s;\n"
                      "  bool ok = dart::wire::unpack(p, 38, s);\n"
                      "  dart::wire::pack(s, q);\n"
                      "  return ok;\n}\n")
    subprocess.run([*compiler, *WARNINGS, "-c", str(source), "-o", str(tmp_path / "use.o")],
                   check=True)
