"""Parse the URL of a car, ``scheme://target?key=value``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from urllib.parse import parse_qsl

from dart_hal.core.errors import UnknownScheme, UsageError

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
        """Split ``text``. The target is not decoded: a path may contain ``#``, ``%`` and ``[``.

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
        """Raise UsageError for options that are neither in ``names`` nor in ``old``.

        old: names of obsolete options, which are ignored.
        """
        unknown = sorted(set(self.options) - {*names, *old})
        if unknown:
            from difflib import get_close_matches

            near = get_close_matches(unknown[0], names, n=1)
            raise UsageError(f"{self.scheme}:// has no option {', '.join(unknown)}",
                             found=self.text, expected=", ".join(names) or "no options",
                             remedy=f"{near[0]}= for {unknown[0]}=" if near else URLS)
