"""Rows of the line alone: bytes in, frames out; nothing moves."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from random import Random

import wire_samples as samples

from dart_hal.estimation.frames import FrameReader
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE, TICKS_PER_SECOND
from dart_hal.wire.plausible import Gates
from dart_lab.sim.faults import LineFaults
from fault_table.bench import Bench
from fault_table.row import Measured, Row, case

MILLION = 1_000_000
SAMPLE_BYTES = 12_000
WIRE_FRAMES = samples.drive(2.0, seed=3)
SENT = {(f.seq, f.payload) for f in FrameDecoder(UP).feed(b"".join(WIRE_FRAMES))}
ONE_BYTE = ("changed", "dropped", "doubled")
BITS = ("1 bit", "2 bits", "3 bits")


def wrong(names: tuple[str, ...], bench: Bench) -> Measured:
    """Frames accepted that were never sent; each hurt frame between two good ones."""
    trials = MILLION if bench.full else SAMPLE_BYTES
    states = [f for f in WIRE_FRAMES if len(f) == STATE.wire_size]
    rng = Random(2)
    count = 0
    for trial in range(trials):
        at = rng.randrange(1, len(states) - 1)
        hurt = samples.SMALL_FAULTS[names[trial % len(names)]](states[at], rng)
        got = FrameDecoder(UP).feed(states[at - 1] + hurt + states[at + 1])
        count += sum((f.seq, f.payload) not in SENT for f in got)
    return Measured(count, f"{trials} faults")


def flips(bits: int, gates: bool) -> Callable[[Bench], Measured]:
    """Share of frames with so many flipped bits that are believed."""
    def measure(bench: Bench) -> Measured:
        trials = 400_000 if bench.full else SAMPLE_BYTES
        states = [f for f in WIRE_FRAMES if len(f) == STATE.wire_size]
        rng = Random(4)
        fault = samples.flip_bits(bits)
        count = 0
        for _ in range(trials):
            at = rng.randrange(1, len(states) - 1)
            decoder = FrameDecoder(UP, Gates() if gates else None)
            got = decoder.feed(states[at - 1] + fault(states[at], rng) + states[at + 1])
            count += sum((f.seq, f.payload) not in SENT for f in got)
        return Measured(count / trials, f"{count} of {trials}")
    return measure


def count_lost_frames(names: tuple[str, ...], bench: Bench) -> Measured:
    """Frames lost to one fault, the worst; one more is allowed where a delimiter is gone."""
    rng = Random(8)
    worst = 0
    at_delimiter = 0
    for trial in range(60_000 if bench.full else 3_000):
        at = rng.randrange(1, len(WIRE_FRAMES) - 3)
        hurt = samples.SMALL_FAULTS[names[trial % len(names)]](WIRE_FRAMES[at], rng)
        decoder = FrameDecoder(UP)
        decoder.feed(WIRE_FRAMES[at - 1] + hurt + WIRE_FRAMES[at + 1] + WIRE_FRAMES[at + 2])
        gone = 4 - decoder.counters.ok
        at_delimiter = max(at_delimiter, gone)
        worst = max(worst, gone - (not hurt.endswith(b"\0")))
    return Measured(worst, f"{at_delimiter} where a delimiter is gone")


def count_uncounted(bench: Bench) -> Measured:
    """Frames missing but not counted, over a stream with bursts of 8 B and holes of 20 B."""
    rng = Random(5)
    stream = b""
    whole = 0
    frames = samples.drive(60.0 if bench.full else 20.0, seed=9)
    for frame in frames:
        roll = rng.random()
        if roll < 0.02 and len(frame) > 28:
            frame = samples.burst(8)(frame, rng)
        elif roll < 0.04 and len(frame) > 28:
            frame = frame[:4] + frame[24:]
        stream += frame
        whole += 1
    decoder = FrameDecoder(UP)
    decoder.feed(stream)
    counters = decoder.counters
    return Measured(abs(whole - counters.ok - counters.gaps),
                    f"{counters.gaps} lost of {whole}, all but {whole - counters.ok} arrived")


def wraps(bench: Bench) -> Measured:
    """Largest glitch over every wrap: device time (35.8 min), edge count, stamp [edges, 10 ms]."""
    reader = FrameReader()
    glitch = 0.0
    before = None
    edges_per_frame = 60_000
    start = 2**32 - 10 * TICKS_PER_SECOND
    for k in range(4000):
        t = (start + k * TICKS_PER_SECOND // 100) % 2**32
        count = (2**32 - 1_000_000 + k * edges_per_frame) % 2**32
        sample = reader.read((t, count, t, 500, count & 0xFFFF, t, *[0] * 6, 400, 0xFF, 1, 10),
                             k * 0.01)
        if before is not None:
            glitch = max(glitch, hypot((sample.t_dev - before.t_dev) - 0.01,
                                       sample.ticks - before.ticks - edges_per_frame))
        before = sample
    return Measured(glitch if glitch > 1e-6 else 0.0, "4000 frames across the wraps")


def bit_errors(bench: Bench) -> Measured:
    """Distance driven by odometry over a line of 1e-4 bit errors, against a clean line [%]."""
    way = []
    for rate in (0.0, 1e-4):
        drive = bench.drive().arm()       # a car that loses 3 % of its frames does not arm
        drive.backend.link._up.faults = LineFaults(bit_error=rate)
        loop = [(0.1, 0.6), (-0.1, 1.0)]
        for k in range(30 if bench.full else 2):
            steering, speed = loop[k % 2]
            drive.run(2.0, lambda car, state, s=steering, v=speed:  # type: ignore[misc]
                      car.drive_speed(steering=s, speed=v))
        drive.run(1.5)
        way.append((drive.car._engine.telemetry.speed.distance, drive.world.distance,
                    drive.car.timing.damaged))
    scale = [measured / true for measured, true, _ in way]
    return Measured(100 * abs(scale[1] / scale[0] - 1),
                    f"{way[1][0]:.1f} m, {way[1][2]} frames damaged")


def impossible(bench: Bench) -> Measured:
    """Frames with a right checksum that no Nano can have sent, and that were believed."""
    believed = 0
    for field, value in (("t_ck", 5), ("enc_count", 2**31), ("gyro", (0, 0, 32767))):
        decoder = FrameDecoder(UP, Gates())
        decoder.feed(b"".join(WIRE_FRAMES[:40]))
        last = FrameDecoder(UP).feed(WIRE_FRAMES[40])[0]
        assert last.message is STATE
        hurt = encode(STATE, last.seq, last.as_dict() | {field: value})
        believed += len(decoder.feed(hurt))
    return Measured(believed, "time backwards, edges no wheel makes, gyro beyond its range")


ROWS = (
    Row(1, "bit flips in a frame", "dropped, counted, the next good frame delivered", (
        case("wire", "1 to 3 bits, wrong", lambda b: wrong(BITS, b), 0, "frames", "crc",
             fast=True),
        case("wire", "1 to 3 bits, lost", lambda b: count_lost_frames(BITS, b), 1, "frames",
             "delimiter",
             fast=True),
        case("wire", "4 bits", flips(4, False), 1.5e-5, "share", "crc"),
        case("wire", "6 bits, behind the gates", flips(6, True), 5e-6, "share", "crc"),
        case("wire", "impossible, right checksum", impossible, 0, "frames", "frame_gates",
             fast=True),
    )),
    Row(2, "byte dropped, doubled or changed, 8 B burst, 20 B hole", "as 1, gaps counted exactly", (
        case("wire", "one byte, wrong", lambda b: wrong(ONE_BYTE, b), 0, "frames", "crc",
             fast=True),
        case("wire", "one byte, lost", lambda b: count_lost_frames(ONE_BYTE, b), 1, "frames",
             "delimiter"),
        case("wire", "not counted", count_uncounted, 0, "frames", "ledger", fast=True),
    )),
    Row(3, "bit error rate 1e-4 for 60 s", "usable, odometry against a clean run", (
        case("mock", "distance", bit_errors, 0.1, "%", "crc"),
    )),
    Row(10, "wraps of device time, counts, sequence", "no glitch", (
        case("wire", "time and edges", wraps, 0.0, "edges", "unwrap", fast=True),
    )),
)
