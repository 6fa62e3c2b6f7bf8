"""The lidar: converts bytes of an X4, LD19 or RPLidar to scans with a time for every beam."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

from dart_hal.core.added_sensors import list_schemes, open_added_sensor
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import ScanSource
from dart_hal.devices.lidar.models import LIDAR_MODELS, UNKNOWN_MODELS

LIDAR_URLS = "serial:///dev/dart-lidar or hwgrep://10C4:EA60"
LIDAR_SCHEMES = ("serial", "hwgrep")
LIDAR_OPTIONS = ("model", "baud")


def open_lidar(text: str) -> ScanSource:
    """Open the lidar of a URL, also one of another package (``core.added_sensors``).

    Raises UsageError, PortMissing, PortBusy, PortDenied, PluginFailed.

    Options after ``?``: ``model``, x4, ld19 or rplidar; default: it is recognised. ``baud``, the
    line rate; default: those of the models.
    """
    try:
        parts = urlsplit(text, allow_fragments=False)
    except ValueError as why:
        raise UsageError(f"{text!r} is no lidar", found=str(why), expected=LIDAR_URLS) from why
    target = parts.netloc + parts.path
    if parts.scheme not in LIDAR_SCHEMES:
        added: ScanSource | None = open_added_sensor("lidar", text)
        if added is not None:
            return added
    if parts.scheme not in LIDAR_SCHEMES or not target:
        raise UsageError(f"{text!r} is no lidar", found=parts.scheme or "no scheme://",
                         expected=", ".join([LIDAR_URLS, *list_schemes("lidar")]))
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    options = dict(pairs)
    unknown = sorted(set(options) - set(LIDAR_OPTIONS))
    if unknown or len(options) < len(pairs):
        raise UsageError(f"{text}: options of a lidar", expected=", ".join(LIDAR_OPTIONS),
                         found=", ".join(unknown) or "one given twice")
    models = {model.key: model for model in LIDAR_MODELS}
    key = options.get("model")
    if key is not None and key not in models:
        raise UsageError(f"model={key!r} is no lidar with a driver", found=text,
                         expected=", ".join(models))
    model = None if key is None else models[key]
    baud = options.get("baud")
    if baud is not None and not (baud.isascii() and baud.isdigit() and int(baud)):
        bauds = (model.bauds if model else [m.bauds[0] for m in UNKNOWN_MODELS])
        raise UsageError(f"baud={baud!r} is not a line rate", found=text,
                         expected=" or ".join(map(str, bauds)))
    from dart_hal.devices.lidar.port import SerialLidar
    from dart_hal.devices.links.serial_port import find_port

    pattern = target if parts.scheme == "hwgrep" else None
    device = target if pattern is None else find_port(pattern)
    return SerialLidar(device, None if baud is None else int(baud), text, pattern, model)
