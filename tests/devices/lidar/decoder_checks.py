"""What every decoder of a lidar's bytes has to satisfy."""

from __future__ import annotations


def list_contents(packets):
    """What can be compared of packets, without ``behind`` and ``lost``."""
    return [(p.starts, p.hertz, p.first, p.last, p.angle.tobytes(), p.distance.tobytes(), p.size)
            for p in packets]


def check_portions(make_decoder, raw, cuts, contents=list_contents):
    """The same bytes in portions of sizes ``cuts`` give the same packets, counts and answers."""
    whole = make_decoder()
    expected = whole.feed(bytes(raw))
    parts = make_decoder()
    got = []
    position = 0
    for cut in [*cuts, len(raw)]:
        got += parts.feed(bytes(raw[position:position + cut]))
        position += cut
    assert contents(got) == contents(expected)
    assert (parts.broken, parts.skipped) == (whole.broken, whole.skipped)
    assert parts.answers == whole.answers
