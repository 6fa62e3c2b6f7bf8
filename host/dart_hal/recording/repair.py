"""Write the index of a run that was not closed, so that every tool opens it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from dart_hal.core.errors import RecordingError
from dart_hal.recording.mcap_records import (
    MESSAGE,
    PREFIX,
    McapFile,
    iterate_records,
    parse_record,
    read_mcap,
)
from dart_hal.recording.run_file import make_mcap_writer


@dataclass(frozen=True, slots=True)
class Repaired:
    """Result of a repair: messages kept, bytes left out, the old file (None: not repaired)."""

    path: Path
    messages: int
    left_out: int
    old: Path | None


def repair(path: Path | str) -> Repaired:
    """Write a new file with all complete records of a run; keep the old one as ``NAME.old``.

    A complete file is not changed. A run of version 0.1 gets chunks. Raises RecordingError if it
    is no MCAP file, or NAME.old exists.
    """
    path = Path(path)
    found = read_mcap(path)
    left_out = found.length - found.used + sum(d.skipped for d in found.damages)
    if found.complete and not found.damages:
        return Repaired(path, found.count, 0, None)
    # Until the end, the damaged file is the only one: write a new file completely, then exchange
    # both names.
    old = path.with_name(path.name + ".old")
    if old.exists():
        raise RecordingError(f"{path}: the old file of an earlier repair exists", found=str(old),
                             read=str(path), expected="no such file", remedy=f"move {old} away")
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            writer = make_mcap_writer(file)
            copy(found, writer)
            writer.finish()  # type: ignore[no-untyped-call]
            file.flush()
            os.fsync(file.fileno())
        path.rename(old)
        part.rename(path)
    finally:
        part.unlink(missing_ok=True)
    return Repaired(path, found.count, left_out, old)


def copy(found: McapFile, writer: Writer) -> None:
    """Copy every complete record into ``writer``, one chunk for each chunk.

    Schemas and channels get new numbers.
    """
    # Records repeat schemas and channels, once in each chunk: register each number once.
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for block in found.blocks:
        for opcode, start, end in iterate_records(block):
            body = block[start:end]
            if opcode == Opcode.SCHEMA:
                s = parse_record(Schema, body)
                if s.id not in schemas:
                    schemas[s.id] = writer.register_schema(s.name, s.encoding, s.data)
            elif opcode == Opcode.CHANNEL:
                c = parse_record(Channel, body)
                if c.id not in channels:
                    channels[c.id] = writer.register_channel(
                        c.topic, c.message_encoding, schemas.get(c.schema_id, 0), c.metadata)
            elif opcode == Opcode.MESSAGE:
                channel, sequence, logged, published = MESSAGE.unpack_from(body)
                if channel in channels:
                    writer.add_message(channels[channel], logged, body[MESSAGE.size:],
                                       published, sequence)
            elif opcode == Opcode.METADATA:
                facts = parse_record(Metadata, body)
                writer.add_metadata(facts.name, facts.metadata)
            elif opcode == Opcode.ATTACHMENT:
                a = parse_record(Attachment, body)
                writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        if len(block) > end - start + PREFIX.size:  # a block of several records was a chunk
            writer.flush()  # type: ignore[no-untyped-call]
