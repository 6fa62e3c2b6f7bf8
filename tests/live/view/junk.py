"""What no page would send."""

from __future__ import annotations

import random

RIGHT = ('{"type":"drive","steering":0,"throttle":1,"heard":0,"unchanged":0}', '{"type":"arm"}',
         '{"type":"unlock"}', '{"type":"release"}', '{"type":"leave"}',
         '{"type":"record","on":true}', '{"type":"take","token":"x"}')
"""Of a page that does not drive."""


class Junk:
    """``draw()``: bytes, a right message with one letter changed or cut off, depth, 70 kB, and
    right ones that it may not send."""

    def __init__(self, seed):
        self._random = random.Random(seed)

    def draw(self):
        draw = self._random
        kind = draw.randrange(6)
        text = draw.choice(RIGHT)
        at = draw.randrange(len(text))
        return (draw.randbytes(draw.randrange(400)), "[" * draw.randrange(900), "x" * 70_000,
                text[:at] + chr(draw.randrange(32, 500)) + text[at + 1:], text[:at], text)[kind]
