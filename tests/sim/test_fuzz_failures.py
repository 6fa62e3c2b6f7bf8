"""Any text is a Failure that can begin, or a UsageError; nothing else comes out."""

from __future__ import annotations

import math
from contextlib import suppress
from random import Random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.failure_kinds import FAILURE_KINDS
from dart_lab.sim.failures import Failure, parse_failure

names = st.sampled_from(sorted(FAILURE_KINDS)).map(":".join)
digits = st.text("0123456789.eE+-_ \u0663x", max_size=8)
number = st.one_of(digits, st.floats(allow_nan=True).map(repr), st.just("1e999"),
                   st.integers(0, 10**400).map(str))
well_formed = st.builds("{}={}@{}+{}".format, names, number, number, number)
nearly = st.builds(lambda text, at, new: text[:at] + new + text[at + 1:],
                   st.builds("{}@{}s+{}".format, names, number, number), st.integers(0, 40),
                   st.text(max_size=3))
texts = st.one_of(st.text(), well_formed, nearly,
                  st.builds("{}={}@0.001+0.02".format, names, number))


def law(text):
    """The Failure, or None where the text is refused."""
    try:
        failure = parse_failure(text)
    except UsageError:
        return None
    assert isinstance(failure, Failure)
    kind = FAILURE_KINDS[failure.target, failure.kind]
    assert math.isnan(failure.value) or kind.low <= failure.value <= kind.high
    assert 0.0 <= failure.start < math.inf
    assert failure.duration >= 0.0
    assert text.strip().isascii()
    return failure


@given(texts)
@example(f"imu:off@{10**400}")
@example(f"imu:off@1+{10**400}")
@example("imu:off@\u0663")
def test_parse_gives_a_failure_or_a_usage_error(text):
    law(text)


@pytest.mark.long
def test_a_million_damaged_failures():
    """One to three characters changed, doubled or left out."""
    rng, kinds = Random(9), sorted(FAILURE_KINDS)
    for _ in range(1_000_000):
        text = f"{':'.join(rng.choice(kinds))}={rng.uniform(0, 3):.2f}@{rng.random() * 9:.2f}s+1s"
        for _ in range(rng.randrange(4)):
            at = rng.randrange(len(text))
            text = text[:at] + rng.choice(("", text[at] * 2, chr(rng.randrange(32, 0x700)),
                                           rng.choice("0123456789.eE+-=:@s "))) + text[at + 1:]
        law(text)


@given(names, number)
@example("pca:nack", "1e999")
def test_what_is_accepted_can_begin_and_end(name, value):
    """The world does it, or states by UsageError that MockNano has no such thing."""
    if law(f"{name}={value}@0.001+0.02") is None:
        return
    failure = f"{name}={value}@0.001 0.02"
    backend = open_backend(f"sim://?nano=mock&physics=kinematic&rc=1&fail={failure}")
    with suppress(UsageError):  # what MockNano cannot do
        backend.clock.sleep(0.03)
    backend.link.close()
