"""Writes the index of a run that was not closed, so that every tool opens it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from dart_hal.core.errors import RecordingError
from dart_hal.recording.mcap_records import MESSAGE, PREFIX, McapFile, content, read_mcap, records
from dart_hal.recording.run_file import mcap_writer


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was done: ``messages`` kept, bytes left out, where the old file is (None: no need)."""

    path: Path
    messages: int
    left_out: int
    old: Path | None


def repair(path: Path | str) -> Repaired:
    """Write a run anew from all that is whole in it; the old file is kept as ``NAME.old``.

    A whole file stays as it is. A run of version 0.1 gets chunks. Raises
    RecordingError when it is no MCAP file, or NAME.old is in the way.
    """
    path = Path(path)
    found = read_mcap(path)
    left_out = found.length - found.used + sum(d.skipped for d in found.damages)
    if found.complete and not found.damages:
        return Repaired(path, found.count, 0, None)
    old = path.with_name(path.name + ".old")
    if old.exists():
        raise RecordingError(f"{path}: an older repair is not put away", found=str(old),
                             read=str(path), expected="no such file", remedy=f"move {old} away")
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            writer = mcap_writer(file)
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
    """Every whole record into ``writer``, a chunk for a chunk."""
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for block in found.blocks:
        for opcode, start, end in records(block):
            body = block[start:end]
            if opcode == Opcode.SCHEMA:
                s = content(Schema, body)
                if s.id not in schemas:
                    schemas[s.id] = writer.register_schema(s.name, s.encoding, s.data)
            elif opcode == Opcode.CHANNEL:
                c = content(Channel, body)
                if c.id not in channels:
                    channels[c.id] = writer.register_channel(
                        c.topic, c.message_encoding, schemas.get(c.schema_id, 0), c.metadata)
            elif opcode == Opcode.MESSAGE:
                channel, sequence, logged, published = MESSAGE.unpack_from(body)
                if channel in channels:
                    writer.add_message(channels[channel], logged, body[MESSAGE.size:],
                                       published, sequence)
            elif opcode == Opcode.METADATA:
                noted = content(Metadata, body)
                writer.add_metadata(noted.name, noted.metadata)
            elif opcode == Opcode.ATTACHMENT:
                a = content(Attachment, body)
                writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        if len(block) > end - start + PREFIX.size:  # of several records: what was a chunk is one
            writer.flush()  # type: ignore[no-untyped-call]
