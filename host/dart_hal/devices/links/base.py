"""Interface of a backend: a link to a Nano, an I2C bus, a clock.

Backends register under the entry-point group ``dart_hal.backends`` by URL scheme. Each entry is a
function ``open(url: Url) -> Backend``. Code that uses a backend does not depend on whether the car
is real, emulated or recorded. How to write one: docs/how_to/backend.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dart_hal.core.errors import PluginFailed, UnknownScheme
from dart_hal.core.plugins import attribute_errors, describe, list_plugins, load_entry
from dart_hal.core.ports import Bus, Clock, ImageSource, Link, PoseSource, ScanSource, Workshop
from dart_hal.core.types import Contact
from dart_hal.core.url import Url

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


@dataclass
class Backend:
    """An opened backend: ``url``, ``link`` and ``clock`` are required, the rest has defaults.

    ``bus``: I2C bus of the PCA9685; None = commands are accepted and reported as not sent (replay).
    ``virtual``: time advances only inside ``link.read`` and ``clock.sleep``.
    ``simulated``: the car is simulated by this program, in virtual or real time.
    ``car``: name of the car of this backend (``sim-7``), None = the caller's.
    ``car_toml``: text of a car file that the backend provides.
    ``measured``: texts of its calibration.toml and model.toml from a recorded run.
    ``notices``: messages to show to the user once (for example: mock in use).
    ``resets``: opening restarted the Nano, so it sends HELLO without a request.
    ``closers``: functions that ``close`` calls, the last one first.
    ``candidates``: ports where the board may be after it was unplugged.
    ``workshop``: answers the questions of a calibration; None = the user answers them.
    ``poses``, ``lidar``, ``camera``: external poses, scans and images of the backend;
    ``cameras``: its cameras by name, opened by ``camera=NAME``.
    ``battery``: readings of its voltage (time [s], V) in a recording.
    ``contacts``: contacts so far in a world of several cars.
    """

    url: Url
    link: Link
    clock: Clock
    bus: Bus | None = None
    virtual: bool = False
    simulated: bool = False
    car: str | None = None
    car_toml: str | None = None
    measured: Mapping[str, str] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    resets: bool = True
    closers: tuple[Callable[[], None], ...] = ()
    candidates: Callable[[], list[str]] = list
    workshop: Workshop | None = None
    poses: PoseSource | None = None
    lidar: ScanSource | None = None
    camera: ImageSource | None = None
    cameras: Mapping[str, Callable[[], ImageSource]] = field(default_factory=dict)
    battery: tuple[tuple[float, float], ...] = ()
    contacts: Callable[[], tuple[Contact, ...]] = tuple

    def close(self) -> None:
        """Close link and bus, each of them even if another one raises."""
        with ExitStack() as steps:
            for closer in reversed(self.closers):
                steps.callback(closer)
            steps.callback(self.link.close)


def schemes() -> dict[str, EntryPoint]:
    """Return the entry points of all installed backends by URL scheme."""
    return list_plugins("dart_hal.backends")


def open_backend(text: str) -> Backend:
    """Open the backend of a URL.

    Raises UnknownScheme, the catalogue errors of the backend, and PluginFailed for any other
    exception of a backend of another package.
    """
    url = Url.parse(text)
    loaders = schemes()
    if url.scheme not in loaders:
        raise UnknownScheme(f"no backend for {url.scheme}://", found=text,
                            expected=", ".join(f"{s}://" for s in sorted(loaders)))
    entry = loaders[url.scheme]
    opener: Callable[[Url], Backend] = load_entry(entry)
    with attribute_errors(entry):
        opened = opener(url)
    if not isinstance(opened, Backend):
        raise PluginFailed(f"{describe(entry)} returned no backend", found=type(opened).__name__,
                           expected="an object of dart_hal.devices.links.base.Backend")
    return opened
