"""Every kind of failure: what begins it, and what that leaves to be undone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.errors import UsageError
from dart_lab.sim.world import World

End = Callable[[World], None]
Begin = Callable[[World, float], End]

CONTACT = 0.05
"""s that an intermittent contact is open or closed before the die is cast again."""


class Kind(NamedTuple):
    """``begin(world, value)`` returns what ends it; value: ``unit`` ("" = takes none)."""

    begin: Begin
    unit: str = ""
    default: float = math.nan
    low: float = 0.0
    high: float = math.inf


def _over(world: World) -> None:
    """The end of a failure that is over as soon as it has happened."""


def _nano(world: World, name: str, *args: Any) -> None:
    """Do it to the Nano; raises UsageError by name where that Nano has no such thing."""
    method = getattr(world.nano, name, None)
    if method is None:
        raise UsageError(f"{type(world.nano).__name__} cannot do {name}{args}",
                         remedy="use nano=avr")
    method(*args)


def _once(name: str, *args: Any) -> Kind:
    def begin(world: World, value: float) -> End:
        _nano(world, name, *args)
        return _over

    return Kind(begin)


def _while(name: str, on: tuple[Any, ...], off: tuple[Any, ...]) -> Kind:
    def begin(world: World, value: float) -> End:
        _nano(world, name, *on)
        return lambda world: _nano(world, name, *off)

    return Kind(begin)


def _imu(fault: str, *value: Any) -> Kind:
    def begin(world: World, value: float) -> End:
        _nano(world, "set_imu_fault", fault, *(() if math.isnan(value) else (value,)))
        return lambda world: _nano(world, "set_imu_fault", "ok")

    return Kind(begin, *value)


def _ring(ring: int) -> Callable[[World], tuple[float, ...]]:
    return lambda world: tuple((world.car.ring_a, world.car.ring_b)[ring].edges)


def _enc(ring: int) -> dict[str, Kind]:
    """Failures of the sensor at ring 0 (D2) or 1 (D3)."""
    edges = _ring(ring)

    def heal(world: World) -> None:
        world.nano.set_ring(ring, edges(world))

    def off(world: World, value: float) -> End:
        world.nano.set_ring(ring, ())
        return heal

    def wrong(world: World, share: float) -> End:
        """Evenly thinned: the rest of the edges looks like a slower wheel."""
        marks = edges(world)
        n = len(marks)
        keep = 2 * round(share * n / 2)
        world.nano.set_ring(ring, [marks[k * n // keep] for k in range(keep)])
        return heal

    def intermittent(world: World, share: float) -> End:
        return _contact(world, share, lambda world: off(world, share), heal)

    def noise(irregular: bool) -> Begin:
        def begin(world: World, rate: float) -> End:
            _nano(world, "set_chatter", ring, rate, irregular)
            return lambda world: _nano(world, "set_chatter", ring, 0.0)

        return begin

    return {"off": Kind(off), "stuck": Kind(off),
            "wrong": Kind(wrong, "SHARE", 0.5, 0.0, 1.0),
            "intermittent": Kind(intermittent, "SHARE", 0.5, 0.0, 1.0),
            "garbage": Kind(noise(True), "EDGES/S", 1000.0, 0.0, 1e6),
            "chatter": Kind(noise(False), "EDGES/S", 1e6, 0.0, 1e6)}


def _contact(world: World, share: float, open_: Callable[[World], Any], close: End) -> End:
    """A contact that is open for that share of the time, each `CONTACT` s anew."""
    rng = np.random.default_rng([world.car.seed, 500])
    ended = False

    def cast(world: World) -> None:
        if not ended:
            open_(world) if rng.random() < share else close(world)
            world.at(world.t + CONTACT, cast)

    def end(world: World) -> None:
        nonlocal ended
        ended = True
        close(world)

    cast(world)
    return end


def _i2c_intermittent(world: World, share: float) -> End:
    _nano(world, "set_i2c", "nack", share)
    return lambda world: _nano(world, "set_i2c", "ok")


def _i2c_slow(world: World, stretch_us: float) -> End:
    _nano(world, "set_i2c", "ok", 1.0, stretch_us)
    return lambda world: _nano(world, "set_i2c", "ok")


def _pca_nack(world: World, value: float) -> End:
    world.bus.nack = 10**9 if math.isnan(value) else int(value)
    return _pca_fine


def _pca_fine(world: World) -> None:
    world.bus.nack = 0


def _pca_intermittent(world: World, share: float) -> End:
    return _contact(world, share, lambda world: _pca_nack(world, math.nan), _pca_fine)


def _pca_brown_out(world: World, value: float) -> End:
    world.pca.brown_out(world.t)
    return _over


def _bus(line: str) -> Kind:
    def begin(world: World, value: float) -> End:
        world.bus.stuck = line

        def end(world: World) -> None:
            world.bus.stuck = ""

        return end

    return Kind(begin)


def _fill(world: World, field: str, value: Any) -> None:
    """Change that field of ``LineFaults`` in both directions."""
    for line in world.lines:
        line.faults = replace(line.faults, **{field: value})


def _heal_line(world: World, field: str) -> None:
    """As the line was made: what another failure of its kind left is no cure."""
    for line in world.lines:
        line.faults = replace(line.faults, **{field: getattr(line.lasting, field)})


def _line(field: str) -> Begin:
    def begin(world: World, value: float) -> End:
        _fill(world, field, value)
        return lambda world: _heal_line(world, field)

    return begin


def _line_intermittent(world: World, share: float) -> End:
    return _contact(world, share, lambda world: _fill(world, "silence", ((0.0, math.inf),)),
                    lambda world: _heal_line(world, "silence"))


def _power(world: World, value: float) -> End:
    world.power_nano(False)
    return lambda world: world.power_nano(True)


def _droop(world: World, volt: float) -> End:
    _nano(world, "set_vcc", volt)
    return lambda world: _nano(world, "set_vcc", 5.0)


def _esc_off(world: World, value: float) -> End:
    """No battery; with a new one it wants its neutral again."""
    world.esc_powered = False

    def end(world: World) -> None:
        world.esc_powered = True
        world.esc.power_on()

    return end


def _leads(world: World, value: float) -> End:
    """The motor's leads are swapped."""
    drive = world.motion.drive
    drive.leads = -1.0

    def end(world: World) -> None:
        drive.leads = 1.0

    return end


def _block(world: World, value: float) -> End:
    world.blocked = True

    def end(world: World) -> None:
        world.blocked = False

    return end


def _no_stand(world: World, value: float) -> End:
    """The car is not lifted, or slips off its stand."""
    world.stand_holds = False
    world.set_down()

    def end(world: World) -> None:
        world.stand_holds = True

    return end


def _torn(world: World, nth: float) -> End:
    _nano(world, "tear_eeprom", int(nth))
    return lambda world: _nano(world, "tear_eeprom", 0)


_KINDS: dict[str, dict[str, Kind]] = {
    "imu": {
        "off": _imu("off"), "stuck": _imu("stuck"), "garbage": _imu("garbage"),
        "zero": _imu("zero"), "wrong": _imu("wrong", "GAIN", 2.0, 0.0, 100.0),
        "slow": _imu("slow", "HZ", 10.0, 0.1, 100.0),
        "delayed": _imu("delayed", "S", 0.2, 0.0, 1.2),
        "intermittent": _imu("intermittent", "SHARE", 0.3, 0.0, 1.0),
        "config": _once("config_imu"), "reset": _once("reset_imu")},
    "enc": _enc(0),
    "enc2": _enc(1),
    "i2c": {k: _while("set_i2c", (k,), ("ok",)) for k in ("nack", "sda", "scl", "dead")} | {
        "off": _while("set_i2c", ("dead",), ("ok",)),
        "intermittent": Kind(_i2c_intermittent, "SHARE", 0.3, 0.0, 1.0),
        "slow": Kind(_i2c_slow, "US/BYTE", 1000.0, 0.0, 1e5)},
    "pca": {
        "off": Kind(_pca_nack), "nack": Kind(_pca_nack, "TIMES", high=1e9),
        "intermittent": Kind(_pca_intermittent, "SHARE", 0.3, 0.0, 1.0),
        "brownout": Kind(_pca_brown_out), "sda": _bus("sda"), "scl": _bus("scl")},
    "mcu": {
        "reset": _once("reset", "external"), "brownout": _once("reset", "brownout"),
        "watchdog": _once("reset", "watchdog"), "hang": _while("hang", (True,), (False,)),
        "freeze": _while("freeze", (True,), (False,))},
    "line": {
        "off": Kind(lambda world, value: _over),    # the link's part: failures.silences()
        "garbage": Kind(_line("bit_error"), "BER", 1e-3, 0.0, 1.0),
        "wrong": Kind(_line("drop"), "SHARE", 0.01, 0.0, 1.0),
        "delayed": Kind(_line("late"), "S", 0.05, 0.0, 10.0),
        "intermittent": Kind(_line_intermittent, "SHARE", 0.3, 0.0, 1.0)},
    "power": {
        "nano": Kind(_power), "droop": Kind(_droop, "V", 4.0, 0.0, 5.5)},
    "esc": {"off": Kind(_esc_off), "wrong": Kind(_leads)},
    "wheel": {"stuck": Kind(_block)},
    "stand": {"off": Kind(_no_stand)},
    "eeprom": {"torn": Kind(_torn, "NTH", 1.0, 1.0, 1024.0)},
}

KINDS = {(target, kind): how for target, kinds in _KINDS.items() for kind, how in kinds.items()}
"""What begins each failure. i2c is the Nano's bus, pca the board's on the computer's bus,
esc: no battery, or the motor's leads swapped; wheel: something holds it."""
