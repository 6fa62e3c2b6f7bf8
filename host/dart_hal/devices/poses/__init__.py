"""Sources of external poses by URL: UDP lines, NatNet, VRPN, a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import SplitResult, parse_qsl, unquote, urlsplit

from dart_hal.core.added_sensors import list_schemes, open_added_sensor
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import PoseSource
from dart_hal.devices.poses import line
from dart_hal.devices.poses.file import open_file
from dart_hal.devices.poses.natnet_source import COMMAND_PORT, NatNetSource
from dart_hal.devices.poses.reading import PLANE_OPTIONS, SPACE_OPTIONS, Convention, convention
from dart_hal.devices.poses.udp import Datagrams, Port, SharedPort, UdpSource
from dart_hal.devices.poses.vrpn_source import VRPN_PORT, VrpnSource

POSE_URLS = "udp://:5005, natnet://HOST?body=car, vrpn://car@HOST, file://poses.csv"
_OPTIONS = {"udp": PLANE_OPTIONS, "file": PLANE_OPTIONS, "natnet": SPACE_OPTIONS,
            "vrpn": (*SPACE_OPTIONS, "sensor")}


def open_poses(text: str) -> PoseSource:
    """Open the source of a URL. Raises UsageError and what the source raises.

    Options after ``?``: ``units`` m, cm, mm; ``hand`` right, left; ``turn`` deg from the body's x
    axis to the car's nose; ``body`` name (default: the first one received). Of lines and files also
    ``angle`` rad, deg; ``time`` s, ms, us, ns. Of NatNet and VRPN also ``up`` z, y; of VRPN
    ``sensor``.
    """
    return _open(text, {})


def open_fleet_poses(texts: Sequence[str]) -> list[PoseSource]:
    """Open one source for each URL; sources with the same UDP port share it, with a body each.

    Raises what ``open_poses`` raises, after closing the sources that were opened.
    """
    shared: dict[tuple[str, int], SharedPort] = {}
    opened: list[PoseSource] = []
    try:
        for text in texts:
            opened.append(_open(text, shared))
    except BaseException:
        for source in opened:
            source.close()
        raise
    return opened


def _open(text: str, shared: dict[tuple[str, int], SharedPort]) -> PoseSource:
    try:
        parts = urlsplit(text, allow_fragments=False)
        port = parts.port if parts.scheme != "file" else None
    except ValueError as why:
        raise UsageError(f"{text!r} is not a source of poses", found=str(why),
                         expected=POSE_URLS) from why
    if parts.scheme not in _OPTIONS:
        added: PoseSource | None = open_added_sensor("poses", text)
        if added is not None:
            return added
        raise UsageError(f"{text!r} is not a source of poses", found=parts.scheme or "no scheme://",
                         expected=", ".join([POSE_URLS, "lidar:map.yaml", *list_schemes("poses")]))
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    options = dict(pairs)
    known = _OPTIONS[parts.scheme]
    unknown = sorted(set(options) - set(known))
    if unknown or len(options) < len(pairs):
        raise UsageError(f"{text}: options of a source of poses", expected=", ".join(known),
                         found=", ".join(unknown) or "one given twice")
    if parts.scheme == "vrpn":
        return _vrpn(text, parts, port, options)
    how = convention(options)
    if parts.scheme == "file":
        return open_file(Path(parts.netloc + parts.path), how)
    if parts.scheme == "natnet":
        return NatNetSource(_host(text, parts), port or COMMAND_PORT, how, text)
    return _udp(text, parts.hostname or "", port, how, shared)


def _host(text: str, parts: SplitResult) -> str:
    if not parts.hostname:
        raise UsageError(f"{text} names no host", found=text, expected=POSE_URLS)
    return parts.hostname


def _vrpn(text: str, parts: SplitResult, port: int | None, options: dict[str, str]) -> VrpnSource:
    """Open a VRPN source; the body is named before the @, as VRPN names devices, or in ``body``."""
    sensor = options.pop("sensor", "0")
    if not (sensor.isascii() and sensor.isdigit()):
        raise UsageError(f"sensor={sensor!r} of a source of poses", found=sensor,
                         expected="a number from 0")
    if parts.username:
        if "body" in options:
            raise UsageError(f"{text} names two bodies", found=text, expected=POSE_URLS)
        options["body"] = unquote(parts.username)
    return VrpnSource(_host(text, parts), port or VRPN_PORT, int(sensor), convention(options), text)


def _udp(text: str, host: str, port: int | None, how: Convention,
         shared: dict[tuple[str, int], SharedPort]) -> UdpSource:
    if port is None:
        raise UsageError(f"{text} names no port", found=text, expected="udp://:5005")
    if port and (host, port) not in shared:
        shared[host, port] = SharedPort(Port(host, port, text))
    datagrams: Datagrams = shared[host, port].reader() if port else Port(host, port, text)
    return UdpSource(datagrams, line.parse, how, text)
