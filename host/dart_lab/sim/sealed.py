"""Sealed cars: a token in the URL holds seed and effects, and only its lecturer reveals them.

A process that simulates a car knows the car. The token therefore hides its content from reading,
not from a program written to unseal it: its cipher has no secret key. Its signature has one, in the
file of the lecturer, without which no verb reveals the car.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import json
from dataclasses import dataclass

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url

NONCE_BYTES = 12
TOKEN_SIGNATURE_BYTES = 16
# Every content is padded to this length, so that a token does not show which fault it holds.
CONTENT_BYTES = 192
# Options of a URL that would replace a part of a sealed car, or whose errors would name it.
REPLACING_OPTIONS = ("seed", "vehicle", "effect", "physics", "model", "ring")


@dataclass(frozen=True, slots=True)
class SealedCar:
    """Name of a car, its seed and the text of its effects as in ``effect=``."""

    name: str
    seed: int
    effect: str


def seal(car: SealedCar, secret: bytes, nonce: bytes) -> str:
    """Return the token of a car, signed with the secret of a lecturer.

    nonce: NONCE_BYTES bytes that no other token has.
    """
    # 1. Mask the content, so that the URL does not show it.
    plain = json.dumps([car.name, car.seed, car.effect]).encode().ljust(CONTENT_BYTES)
    body = nonce + _mask(plain, nonce)
    # 2. Sign it, so that only the secret of the class reveals it.
    return base64.urlsafe_b64encode(_sign(body, secret) + body).decode().rstrip("=")


def unseal(token: str) -> SealedCar:
    """Return the car of a token. Raises UsageError for a text that is no token."""
    body = _decode(token)[TOKEN_SIGNATURE_BYTES:]
    nonce = body[:NONCE_BYTES]
    try:
        name, seed, effect = json.loads(_mask(body[NONCE_BYTES:], nonce))
        return SealedCar(str(name), int(seed), str(effect))
    except (ValueError, TypeError):
        raise _token_error(token) from None


def sealed_in(url: Url) -> SealedCar | None:
    """Return the sealed car of a URL, None without one. Raises UsageError."""
    token = url.options.get("sealed")
    if token is None:
        return None
    others = [name for name in REPLACING_OPTIONS if name in url.options]
    if others:
        raise UsageError("a sealed car is complete", found=", ".join(f"{n}=" for n in others),
                         expected="sealed= without " + ", ".join(REPLACING_OPTIONS))
    return unseal(token)


def check_may_reveal(url: Url, secret: bytes | None) -> None:
    """Raise UsageError for a sealed car, unless the secret is the one that signed its token."""
    token = url.options.get("sealed")
    if token is None:
        return
    data = _decode(token)
    if secret is None or not hmac.compare_digest(data[:TOKEN_SIGNATURE_BYTES],
                                                 _sign(data[TOKEN_SIGNATURE_BYTES:], secret)):
        raise UsageError("this car is sealed: only its lecturer can reveal it",
                         found="no file of a lecturer" if secret is None
                         else "the file of another class",
                         expected="--lecturer FILE, the file that dart-hal class wrote")


def _decode(token: str) -> bytes:
    try:
        data = base64.b64decode(token + "=" * (-len(token) % 4), altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        raise _token_error(token) from None
    if len(data) <= TOKEN_SIGNATURE_BYTES + NONCE_BYTES:
        raise _token_error(token)
    return data


def _token_error(token: str) -> UsageError:
    return UsageError("sealed= is no token of a class", found=token,
                      expected="the URL of the task, unchanged")


def _mask(text: bytes, nonce: bytes) -> bytes:
    """Combine a text with a key stream of its nonce; the same call restores it."""
    stream = hashlib.shake_256(b"dart-hal sealed car " + nonce).digest(len(text))
    return bytes(a ^ b for a, b in zip(text, stream, strict=True))


def _sign(body: bytes, secret: bytes) -> bytes:
    return hmac.new(secret, body, hashlib.sha256).digest()[:TOKEN_SIGNATURE_BYTES]
