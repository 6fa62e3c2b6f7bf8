"""An independent reader of CDR, driven by the definitions that a recording holds."""

from __future__ import annotations

import struct

from mcap.reader import make_reader

SIZES = {"float64": 8, "float32": 4, "int32": 4, "uint32": 4, "uint8": 1}


def walk(definition, data):
    """Independent CDR reader driven by the embedded ros2msg text."""
    parts = definition.split("=" * 80 + "\n")
    types = {"": parts[0]}
    for part in parts[1:]:
        head, _, body = part.partition("\n")
        types[head.removeprefix("MSG: ")] = body
    values = {}
    at = 4

    def align(size):
        nonlocal at
        at += -(at - 4) % size

    def take(kind):
        nonlocal at
        if kind == "string":
            align(4)
            (n,) = struct.unpack_from("<I", data, at)
            text = data[at + 4:at + 3 + n].decode()
            at += 4 + n
            return text
        align(SIZES[kind])
        code = {"float64": "d", "float32": "f", "int32": "i", "uint32": "I", "uint8": "B"}[kind]
        (value,) = struct.unpack_from("<" + code, data, at)
        at += SIZES[kind]
        return value

    def message(name, prefix):
        for line in types[name].splitlines():
            kind, field = line.split()[:2]
            base, bracket, count = kind.partition("[")
            count = count.rstrip("]")
            repeat = None
            if bracket:
                repeat = int(count) if count else take("uint32")
            if base in types:
                for _ in range(1 if repeat is None else repeat):
                    message(base, prefix + field + ".")
            elif repeat is None:
                values[prefix + field] = take(base)
            else:
                values[prefix + field] = [take(base) for _ in range(repeat)]

    message("", "")
    assert at == len(data)
    return values


def decode_messages(path, topic):
    with path.open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages(topics=[topic]):
            yield walk(schema.data.decode(), message.data)
