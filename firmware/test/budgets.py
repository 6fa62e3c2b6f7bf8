"""Budgets of the firmware, measured: flash and RAM in the ELF, the rest in simavr.

    make -C firmware size

Prints a table and exits with 1 when a figure is over its budget. Cycles are
those of simavr 1.6 with 8 added per interrupt for entry and return, which it
does not count itself. Nothing here was measured on a real board.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

FIRMWARE = Path(__file__).parents[1]
sys.path[:0] = [str(FIRMWARE.parent / "host"), str(FIRMWARE.parent / "tests/firmware")]

from firmware_rig import Rig, eeprom_image  # noqa: E402

CYCLES_PER_US = 16
ATOMIC, BUILD = 1, 2  # marks, as in src/board/marks.h
INT0, PHASE = 1, 12
VECTORS = {1: "INT0", 2: "INT1", 3: "PCINT0", 10: "TIMER1_CAPT", 11: "TIMER1_COMPA",
           12: "TIMER1_COMPB", 13: "TIMER1_OVF", 18: "USART_RX", 19: "USART_UDRE", 24: "TWI"}


@dataclass(frozen=True)
class Budget:
    """One line of the table: ``over`` when value > limit (or < limit for a floor)."""

    name: str
    value: int
    limit: int
    unit: str
    floor: bool = False

    @property
    def over(self) -> bool:
        return self.value < self.limit if self.floor else self.value > self.limit

    def __str__(self) -> str:
        sign = ">=" if self.floor else "<="
        return (f"{self.name:<44}{self.value:>7} {self.unit:<7}{sign} {self.limit:<7}"
                f"{'OVER' if self.over else 'ok'}")


def memory(elf: Path) -> tuple[int, int]:
    """Bytes of flash and of static RAM."""
    lines = subprocess.run(["avr-size", "-A", str(elf)], capture_output=True, text=True,
                           check=True).stdout.splitlines()
    size = {f[0]: int(f[1]) for f in map(str.split, lines) if len(f) == 3 and f[1].isdigit()}
    return (size[".text"] + size[".data"],
            size[".data"] + size[".bss"] + size.get(".noinit", 0))


def drive(rig: Rig, seconds: float) -> None:
    """Everything at once: beats, pings, parameters, EDGES, CAPTURE, a fast noisy wheel."""
    rig.nano.set_imu((0.1, 0.2, 0.3), (1, 2, 3))
    token = rig.hello()["boot_nonce"]
    level = False
    for n in range(round(seconds / 0.02)):
        rig.nano.set_wheel(250 if n % 3 else 500)  # 5 and 10 k edges/s, the rule refuses some
        rig.nano.set_imu((0.1 * (n % 7), 0.2, 0.3), (1, 0.1 * (n % 11), 3))
        rig.send("HEARTBEAT", arm_token=token, mode=n // 50 % 2, flags=13)
        rig.send("TIME_PING", ping_id=n, host_us=n)
        rig.send("PARAM_GET", id=n % 12)
        if n % 40 == 0:
            rig.send("EDGES_REQ", frames=5)
            rig.send("CAPTURE_REQ", frames=3)
        level = not level
        for pin in ("D8", "D10", "D11"):
            rig.nano.set_pin(pin, level)
        rig.run(0.02)


def marked(rig: Rig) -> dict[int, int]:
    """Longest stay [cycles] in each marked section."""
    longest: dict[int, int] = {}
    begin: tuple[int, int] | None = None
    for cycle, value in rig.nano.marks():
        if begin is not None:
            longest[begin[1]] = max(longest.get(begin[1], 0), cycle - begin[0])
        begin = (cycle, value) if value else None
    return longest


def alone(test_elf: Path) -> int:
    """Cycles of the frame builder for STATE, no interrupt inside: the least of many."""
    rig = Rig(test_elf)
    rig.run(2.0)
    rig.nano.marks()
    best: list[int] = []
    for _ in range(40):
        rig.run(0.01)
        begin = None
        for cycle, value in rig.nano.marks():
            if value == BUILD:
                begin = cycle
            elif begin is not None:
                best.append(cycle - begin)
                begin = None
    rig.nano.close()
    return min(best)


def edge_isr(test_elf: Path, edge_min_us: int) -> int:
    rig = Rig(test_elf, eeprom=eeprom_image(edge_min_us=edge_min_us, ring_b=1))
    rig.nano.set_ring(1, [(i + 0.5) / 10 for i in range(10)])
    rig.run(0.1)
    rig.nano.set_wheel(300)
    rig.run(0.5)
    longest = max(rig.nano.isr(1).max, rig.nano.isr(2).max)
    rig.nano.close()
    return int(longest)


def measure(elf: Path, test_elf: Path) -> tuple[list[Budget], dict[str, int]]:
    flash, ram = memory(elf)
    rig = Rig(test_elf, eeprom=eeprom_image(ring_b=1, safety_out=2))
    rig.nano.set_ring(1, [(i + 0.5) / 10 for i in range(10)])
    drive(rig, 4.0)
    used, free = rig.nano.stack()
    sections = marked(rig)
    isr = {name: int(rig.nano.isr(v).max) for v, name in VECTORS.items()}
    rig.nano.close()
    calm = Rig(elf)
    calm.run(3.0)
    cycle_us = max(v["loop_max_us"] for _, n, v in calm.frames if n == "DIAG")
    calm.nano.close()
    blocked = max(sections.get(ATOMIC, 0), *isr.values())
    budgets = [
        Budget("flash", flash, 24576, "B"),
        Budget("static RAM", ram, 1152, "B"),
        Budget("stack, deepest", used, 400, "B"),
        Budget("RAM never touched", free, 400, "B", floor=True),
        Budget("frame builder, STATE", alone(test_elf), 2700, "cycles"),
        Budget("edge interrupt, edge_min_us = 0", edge_isr(test_elf, 0), 80, "cycles"),
        Budget("edge interrupt with the glitch rule", edge_isr(test_elf, 100), 150, "cycles"),
        Budget("longest block of interrupts", blocked, 200, "cycles"),
        Budget("main cycle at 180 us/byte", cycle_us, 6000, "us"),
    ]
    return budgets, isr


def main() -> int:
    budgets, isr = measure(FIRMWARE / "build/dart_nano.elf",
                           FIRMWARE / "build/dart_nano_test.elf")
    for budget in budgets:
        sys.stdout.write(f"{budget}\n")
    longest = ", ".join(f"{name} {cycles}" for name, cycles in isr.items())
    sys.stdout.write(f"interrupts, longest [cycles]: {longest}\n")
    over = [b.name for b in budgets if b.over]
    sys.stdout.write(f"over budget: {', '.join(over)}\n" if over else "every budget holds\n")
    return bool(over)


if __name__ == "__main__":
    sys.exit(main())
