"""Sources of external poses by URL: ``udp://:5005``, ``file://poses.csv``."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from dart_hal.errors import UsageError
from dart_hal.ports import PoseSource
from dart_hal.poses import line
from dart_hal.poses.file import open_file
from dart_hal.poses.reading import OPTIONS, Convention, convention
from dart_hal.poses.udp import UdpSource

EXPECTED = "udp://:5005, file://poses.csv"


def open_poses(text: str) -> PoseSource:
    """Open the source of a URL. Raises UsageError and what the source raises.

    Options behind ``?``: ``units`` m, cm, mm; ``angle`` rad, deg; ``time`` s,
    ms, us, ns; ``hand`` right, left; ``turn`` deg from the body's x axis to the
    car's nose; ``body`` name (default: the first that is told).
    """
    try:
        parts = urlsplit(text)
        port = parts.port if parts.scheme != "file" else None
    except ValueError as why:
        raise UsageError(f"{text!r} is not a source of poses", found=str(why),
                         expected=EXPECTED) from why
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    options = dict(pairs)
    unknown = sorted(set(options) - set(OPTIONS))
    if unknown or len(options) < len(pairs):
        raise UsageError(f"{text}: options of a source of poses", expected=", ".join(OPTIONS),
                         found=", ".join(unknown) or "one given twice")
    how = convention(options)
    if parts.scheme == "file":
        return open_file(Path(parts.netloc + parts.path), how)
    if parts.scheme == "udp":
        return _udp(text, parts.hostname or "", port, how)
    raise UsageError(f"{text!r} is not a source of poses", found=parts.scheme or "no scheme://",
                     expected=EXPECTED)


def _udp(text: str, host: str, port: int | None, how: Convention) -> UdpSource:
    if port is None:
        raise UsageError(f"{text} names no port", found=text, expected="udp://:5005")
    return UdpSource(host, port, line.parse, how, text)
