"""What a backend offers: bytes to and from a Nano, an I2C bus, a clock.

Backends register under the entry-point group ``dart_hal.backends`` by URL
scheme; each entry is a function ``open(url: Url) -> Backend``. Nothing above
this file knows whether the car is real, emulated or recorded.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from urllib.parse import parse_qsl

from dart_hal.core.errors import UnknownScheme, UsageError
from dart_hal.core.ports import Bus, Clock, ImageSource, Link, PoseSource, ScanSource, Workshop
from dart_hal.core.types import Contact

SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*")
URLS = "what each option means: docs/reference/urls.md"


@dataclass(frozen=True)
class Url:
    """A parsed backend URL: ``scheme://target?key=value``."""

    text: str
    scheme: str
    target: str
    options: dict[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> Url:
        """Split ``text``. A target is taken as it is: a path may contain ``#``, ``%`` and ``[``.

        Raises UnknownScheme, UsageError.
        """
        scheme, separator, rest = text.strip().partition("://")
        if not separator or not SCHEME.fullmatch(scheme):
            raise UnknownScheme(f"{text!r} is not a backend URL", found="no scheme://")
        target, _, query = rest.partition("?")
        pairs = parse_qsl(query, keep_blank_values=True)
        options = dict(pairs)
        if len(options) < len(pairs):
            twice = sorted({k for k, _ in pairs if [n for n, _ in pairs].count(k) > 1})
            raise UsageError(f"{', '.join(twice)} is given twice", found=text,
                             expected="every option once")
        return cls(text, scheme.lower(), target, options)

    def known(self, *names: str, old: tuple[str, ...] = ()) -> None:
        """Refuse options that the backend does not have; ``old`` names still pass.

        Raises UsageError."""
        unknown = sorted(set(self.options) - {*names, *old})
        if unknown:
            near = get_close_matches(unknown[0], names, n=1)
            raise UsageError(f"{self.scheme}:// has no option {', '.join(unknown)}",
                             found=self.text, expected=", ".join(names) or "no options",
                             remedy=f"{near[0]}= for {unknown[0]}=" if near else URLS)


@dataclass
class Backend:
    """An opened backend.

    ``virtual``: time advances only inside ``link.read`` and ``clock.sleep``.
    ``simulated``: what is driven is a world of this program, in whatever time.
    ``car``: name of the car this backend is (``sim-7``), None = the caller's.
    ``car_toml``: text of a car file that comes with the backend.
    ``measured``: texts of its calibration.toml and model.toml as a run recorded them.
    ``bus`` None: commands are accepted and reported as not sent (replay).
    ``notices``: sentences the user must see once (for example: mock in use).
    ``resets``: opening restarted the Nano, so HELLO comes unasked.
    ``candidates``: ports where the board may be after it was unplugged.
    ``workshop``: answers the questions of a calibration; None = ask the user.
    ``poses``: external poses that come with the backend; ``lidar``: scans that do;
    ``camera``: images that do; ``cameras``: those that it has by name, opened by ``camera=NAME``.
    ``contacts``: those that a world of several cars has seen.
    """

    url: Url
    link: Link
    clock: Clock
    bus: Bus | None
    virtual: bool
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
    contacts: Callable[[], tuple[Contact, ...]] = tuple

    def close(self) -> None:
        """Close link and bus, each also when another one raises."""
        with ExitStack() as steps:
            for closer in reversed(self.closers):
                steps.callback(closer)
            steps.callback(self.link.close)


def schemes() -> dict[str, EntryPoint]:
    """URL schemes that an installed package serves."""
    return {e.name: e for e in entry_points(group="dart_hal.backends")}


def open_backend(text: str) -> Backend:
    """Open the backend of a URL. Raises UnknownScheme and what the backend raises."""
    url = Url.parse(text)
    loaders = schemes()
    if url.scheme not in loaders:
        raise UnknownScheme(f"no backend for {url.scheme}://", found=text,
                            expected=", ".join(f"{s}://" for s in sorted(loaders)))
    opener: Callable[[Url], Backend] = loaders[url.scheme].load()
    return opener(url)
