"""What the ESC gets through the multiplexer while the Nano switches it, pulse by pulse.

Guarantee (firmware/src/board/outputs.h): no two pulses are joined and none is longer than the
source meant it. With a pulse on channel 15 that is as long as the ESC's none is cut either. A
look at D8 on the way to the PCA9685 lasts below 3 us. Switched within 23 ms.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import Rig, build_patched, eeprom_image

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
MUX_CUTOFF = 2
CMD_DISARMED = 0
CMD_ARMED = 1
CMD_STOP = 3
PWM_PERIOD_S = 0.02
OWN = 1.5e-3
LOOK = 3e-6
PHASES = 20
BLIND = ("src/board/outputs.cpp", "return (PINB & kCapture) != 0;", "return false;")
ANY_TIME = ("src/board/outputs.cpp", "    pass_requested = output.pass;\n",
            "    pass_requested = passing = output.pass;\n    drive<kMuxSelect>(pass_requested);\n")


class MultiplexerBoard:
    """Pulses of the PCA9685 and the multiplexer: the signal at the ESC and at D8."""

    def __init__(self, rig: Rig, phase: float, width: float, wired: bool = True) -> None:
        self.rig = rig
        self.phase = phase
        self.width = width
        self.wired = wired
        self.select: list[tuple[float, int]] = [(0.0, 0)]
        self.own: list[tuple[float, int]] = [(0.0, 0)]

    def high(self, t: float) -> bool:
        return (t - self.phase) % PWM_PERIOD_S < self.width

    def run(self, seconds: float) -> None:
        """D8 follows D5 and the board's pulse within 0.5 us."""
        end = self.rig.now + seconds
        while self.rig.now < end - 1e-9:
            self.rig.run(min(self.step(), end - self.rig.now))
            for e in self.rig.nano.pin_log():
                if e.pin in ("D5", "D9"):
                    (self.select if e.pin == "D5" else self.own).append((e.t, e.level or 0))
            if self.wired:
                self.rig.nano.set_pin("D8", bool(self.select[-1][1]) and self.high(self.rig.now))

    def step(self) -> float:
        """Small around the end of our own pulse, where the firmware looks."""
        last = self.own[-1]
        if last[1] and self.rig.now > last[0] + 1.49e-3:
            return 0.5e-6
        fell = self.rig.now - last[0]
        if not last[1] and (fell < 20e-6 or 80e-6 < fell < 120e-6 or 3.08e-3 < fell < 3.12e-3):
            return 0.5e-6
        return 10e-6

    def beat(self, seconds: float, mode: int) -> None:
        token = self.rig.hello()["boot_nonce"]
        for _ in range(round(seconds / 0.02)):
            self.rig.send("HEARTBEAT", arm_token=token, mode=mode)
            self.run(0.02)

    def at_the_esc(self, begin: float) -> list[tuple[float, float]]:
        """Pulses (rise, width) since ``begin``."""
        rises = [self.phase + n * PWM_PERIOD_S for n in range(int(self.rig.now / PWM_PERIOD_S))]
        edges = sorted({t for t, _ in self.select + self.own if t > begin}
                       | {t + d for t in rises if t > begin for d in (0.0, self.width)})
        pulses: list[tuple[float, float]] = []
        rise = None
        for t in edges:
            level = self.level(t + 1e-9)
            if level and rise is None:
                rise = t
            elif not level and rise is not None:
                pulses.append((rise, t - rise))
                rise = None
        return pulses

    def level(self, t: float) -> bool:
        def last(log: list[tuple[float, int]]) -> int:
            return log[bisect.bisect_right(log, (t, 2)) - 1][1]
        return self.high(t) if last(self.select) else bool(last(self.own))


def drive(rig: Rig, phase: float, width: float, wired: bool = True) -> tuple[MultiplexerBoard,
                                                                             float, float]:
    """To LIVE and, by STOP, back: the board, and when each was commanded."""
    board = MultiplexerBoard(rig, phase, width, wired)
    board.rig.run(0.5)
    rig.beat(0.56, CMD_DISARMED)
    for e in rig.nano.pin_log():
        if e.pin in ("D5", "D9"):
            (board.select if e.pin == "D5" else board.own).append((e.t, e.level or 0))
    armed = rig.now
    board.beat(0.12, CMD_ARMED)
    stopped = rig.now
    board.beat(0.08, CMD_STOP)
    return board, armed, stopped


def longer_or_joined(board: MultiplexerBoard, begin: float) -> list[float]:
    limit = max(board.width, OWN) + 2e-6
    return [w for _, w in board.at_the_esc(begin) if w > limit]


def cut(board: MultiplexerBoard, begin: float) -> list[float]:
    """Widths that no source meant, without the looks."""
    return [w for _, w in board.at_the_esc(begin)[1:]
            if w > LOOK and min(abs(w - OWN), abs(w - board.width)) > 2e-6]


@pytest.mark.parametrize("n", range(PHASES))
@pytest.mark.slow
def test_no_pulse_is_cut_or_joined(nano: Make, n: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=MUX_CUTOFF))
    board, armed, stopped = drive(rig, n * PWM_PERIOD_S / PHASES, (1.0e-3, 1.72e-3, 2.1e-3)[n % 3])
    assert not longer_or_joined(board, armed)
    assert not cut(board, armed)
    looks = [w for _, w in board.at_the_esc(armed) if w <= LOOK]
    assert len(looks) <= 1
    passes = [t for t, level in board.select if level and t > armed]
    own = [t for t, level in board.select if not level and t > stopped]
    assert passes[-1] - armed <= 0.026  # 23 ms, and 3 until the beat has arrived and is read
    assert own[-1] - stopped <= 0.026


@pytest.mark.parametrize("n", range(0, PHASES, 4))
@pytest.mark.slow
def test_without_the_wire_none_is_joined_and_at_most_one_is_cut_at_a_switch(nano: Make,
                                                                          n: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=MUX_CUTOFF))
    board, armed, stopped = drive(rig, n * PWM_PERIOD_S / PHASES, 1.72e-3, wired=False)
    assert not longer_or_joined(board, armed)
    assert len(cut(board, armed)) <= 2
    assert [t for t, level in board.select if not level and t > stopped][-1] - stopped <= 0.026


FILTER = 90e-6
"""s of low that an ESC's input filter must see between two pulses."""
SHORT_DEAD_TIME = ("src/board/outputs.cpp", "kApart = 100 *", "kApart = 40 *")


def smallest_gap(nano: Make, image: Path | None = None) -> float:
    """Between pulses of the two sources, the board's beginning as the switch passes it [s]."""
    def make() -> Rig:
        eeprom = eeprom_image(safety_out=MUX_CUTOFF)
        return nano(image, eeprom=eeprom) if image else nano(eeprom=eeprom)

    width = 1.72e-3
    board, armed, _ = drive(make(), 0.01, width)
    switch = next(t for t, level in board.select if level and t > armed)
    gaps = []
    for behind in (-6e-6, -2e-6, 2e-6, 6e-6, 20e-6):
        board, armed, _ = drive(make(), (switch + behind) % PWM_PERIOD_S, width)
        pulses = [p for p in board.at_the_esc(armed) if p[1] > LOOK]
        gaps += [b[0] - a[0] - a[1] for a, b in itertools.pairwise(pulses)]
    return min(gaps)


@pytest.mark.slow
def test_pulses_of_the_two_sources_are_distinguished(nano: Make) -> None:
    assert smallest_gap(nano) > FILTER


@pytest.mark.slow
def test_a_switch_right_behind_the_own_pulse_is_too_early(nano: Make, elf: Path,
                                                          tmp_path: Path) -> None:
    """The control: the same phases, 40 us behind the pulse."""
    assert smallest_gap(nano, build_patched(tmp_path, SHORT_DEAD_TIME)) < FILTER


@pytest.mark.long
@pytest.mark.parametrize(("change", "joins"), [(BLIND, False), (ANY_TIME, True)])
def test_a_switch_that_does_not_look_cuts(nano: Make, elf: Path, tmp_path: Path,
                                          change: tuple[str, str, str], joins: bool) -> None:
    """The control: the same phases, the same measure."""
    image = build_patched(tmp_path, change)
    cuts = []
    joined = []
    for n in range(PHASES):
        rig = nano(image, eeprom=eeprom_image(safety_out=MUX_CUTOFF))
        board, armed, _ = drive(rig, n * PWM_PERIOD_S / PHASES, 1.72e-3)
        cuts += cut(board, armed)
        joined += longer_or_joined(board, armed)
    assert cuts
    assert bool(joined) is joins


@pytest.mark.parametrize(("clock_error", "neutral"), [(0.0, True), (0.005, True), (-0.005, True),
                                                     (0.01, False)])
@pytest.mark.slow_except("0.0-*", "0.005-*")
def test_own_pulse_is_neutral_within_the_tolerance_of_the_resonator(nano: Make, clock_error: float,
                                                                    neutral: bool) -> None:
    """Its resonator is good to 0.5 %, and so is the pulse, to a tick of 0.5 us.

    Control: one that is off by 1 %."""
    rig = nano(eeprom=eeprom_image(safety_out=MUX_CUTOFF))
    rig.nano.set_clock_error(clock_error)
    rig.run(0.1)
    rig.nano.pin_log()
    rig.run(0.4)
    edges = [(e.t, e.level) for e in rig.nano.pin_log() if e.pin == "D9"]
    widths = [fall - rise for (rise, high), (fall, low) in itertools.pairwise(edges)
              if high and not low]
    assert len(widths) >= 18
    worst = max(abs(width / 1500e-6 - 1.0) for width in widths)
    assert (worst <= 0.0054) == neutral, worst
