"""Kinds of failures of simulated devices: how each begins and how it ends."""

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

# Time for which an intermittent contact stays open or closed before the next random draw [s].
CONTACT_PERIOD = 0.05


class FailureKind(NamedTuple):
    """One kind: ``begin(world, value)`` returns the function that ends it.

    unit: of the value, "" without a value; default, low, high: of the value.
    """

    begin: Begin
    unit: str = ""
    default: float = math.nan
    low: float = 0.0
    high: float = math.inf


def _do_nothing(world: World) -> None:
    """End a failure of a moment."""


def _call_nano(world: World, name: str, *args: Any) -> None:
    """Call a method of the Nano model; raises UsageError if this model does not have it."""
    method = getattr(world.nano, name, None)
    if method is None:
        raise UsageError(f"{type(world.nano).__name__} cannot do {name}{args}",
                         remedy="use nano=avr")
    method(*args)


def _make_event(name: str, *args: Any) -> FailureKind:
    def begin(world: World, value: float) -> End:
        _call_nano(world, name, *args)
        return _do_nothing

    return FailureKind(begin)


def _make_state(name: str, on: tuple[Any, ...], off: tuple[Any, ...]) -> FailureKind:
    def begin(world: World, value: float) -> End:
        _call_nano(world, name, *on)
        return lambda world: _call_nano(world, name, *off)

    return FailureKind(begin)


def _make_imu_fault(fault: str, *value: Any) -> FailureKind:
    def begin(world: World, value: float) -> End:
        _call_nano(world, "set_imu_fault", fault, *(() if math.isnan(value) else (value,)))
        return lambda world: _call_nano(world, "set_imu_fault", "ok")

    return FailureKind(begin, *value)


def _ring_edges(ring: int) -> Callable[[World], tuple[float, ...]]:
    return lambda world: tuple((world.car.ring_a, world.car.ring_b)[ring].edges)


def _make_encoder_faults(ring: int) -> dict[str, FailureKind]:
    """Return the failures of the sensor at ring 0 (D2) or 1 (D3)."""
    edges = _ring_edges(ring)

    def restore(world: World) -> None:
        world.nano.set_ring(ring, edges(world))

    def off(world: World, value: float) -> End:
        world.nano.set_ring(ring, ())
        return restore

    def wrong(world: World, share: float) -> End:
        """Remove edges evenly: the remaining ones look like a slower wheel."""
        marks = edges(world)
        n = len(marks)
        # An even number, since a tooth has two edges.
        keep = 2 * round(share * n / 2)
        world.nano.set_ring(ring, [marks[k * n // keep] for k in range(keep)])
        return restore

    def intermittent(world: World, share: float) -> End:
        return _open_at_random(world, share, lambda world: off(world, share), restore)

    def noise(irregular: bool) -> Begin:
        def begin(world: World, rate: float) -> End:
            _call_nano(world, "set_chatter", ring, rate, irregular)
            return lambda world: _call_nano(world, "set_chatter", ring, 0.0)

        return begin

    return {"off": FailureKind(off), "stuck": FailureKind(off),
            "wrong": FailureKind(wrong, "SHARE", 0.5, 0.0, 1.0),
            "intermittent": FailureKind(intermittent, "SHARE", 0.5, 0.0, 1.0),
            "garbage": FailureKind(noise(True), "EDGES/S", 1000.0, 0.0, 1e6),
            "chatter": FailureKind(noise(False), "EDGES/S", 1e6, 0.0, 1e6)}


def _open_at_random(world: World, share: float, open_: Callable[[World], Any], close: End) -> End:
    """Open a contact for a share of the time, drawn again every ``CONTACT_PERIOD`` s."""
    rng = np.random.default_rng([world.car.seed, 500])
    ended = False

    def draw(world: World) -> None:
        if not ended:
            open_(world) if rng.random() < share else close(world)
            world.schedule(world.t + CONTACT_PERIOD, draw)

    def end(world: World) -> None:
        nonlocal ended
        ended = True
        close(world)

    draw(world)
    return end


def _i2c_intermittent(world: World, share: float) -> End:
    _call_nano(world, "set_i2c", "nack", share)
    return lambda world: _call_nano(world, "set_i2c", "ok")


def _i2c_slow(world: World, stretch_us: float) -> End:
    _call_nano(world, "set_i2c", "ok", 1.0, stretch_us)
    return lambda world: _call_nano(world, "set_i2c", "ok")


def _pca_nack(world: World, value: float) -> End:
    world.bus.nack = 10**9 if math.isnan(value) else int(value)
    return _restore_pca


def _restore_pca(world: World) -> None:
    world.bus.nack = 0


def _pca_intermittent(world: World, share: float) -> End:
    return _open_at_random(world, share, lambda world: _pca_nack(world, math.nan), _restore_pca)


def _pca_brown_out(world: World, value: float) -> End:
    world.pca.brown_out(world.t)
    return _do_nothing


def _make_bus_fault(line: str) -> FailureKind:
    def begin(world: World, value: float) -> End:
        world.bus.stuck = line

        def end(world: World) -> None:
            world.bus.stuck = ""

        return end

    return FailureKind(begin)


def _set_line_fault(world: World, field: str, value: Any) -> None:
    """Set a field of ``LineFaults`` in both directions."""
    for line in world.lines:
        line.faults = replace(line.faults, **{field: value})


def _restore_line(world: World, field: str) -> None:
    """Restore a field as the line was made, whatever other failures of its kind have set."""
    for line in world.lines:
        line.faults = replace(line.faults, **{field: getattr(line.initial_faults, field)})


def _make_line_fault(field: str) -> Begin:
    def begin(world: World, value: float) -> End:
        _set_line_fault(world, field, value)
        return lambda world: _restore_line(world, field)

    return begin


def _line_intermittent(world: World, share: float) -> End:
    def drop_all(world: World) -> None:
        _set_line_fault(world, "silence", ((0.0, math.inf),))

    return _open_at_random(world, share, drop_all,
                           lambda world: _restore_line(world, "silence"))


def _cut_power(world: World, value: float) -> End:
    world.power_nano(False)
    return lambda world: world.power_nano(True)


def _lower_supply(world: World, volt: float) -> End:
    _call_nano(world, "set_vcc", volt)
    return lambda world: _call_nano(world, "set_vcc", 5.0)


def _cut_esc_power(world: World, value: float) -> End:
    """Remove the battery of the ESC; with a new one it needs neutral again."""
    world.esc_powered = False

    def end(world: World) -> None:
        world.esc_powered = True
        world.esc.power_on()

    return end


def _swap_leads(world: World, value: float) -> End:
    """Swap the motor's leads."""
    drive = world.motion.drive
    drive.leads = -1.0

    def end(world: World) -> None:
        drive.leads = 1.0

    return end


def _block_wheel(world: World, value: float) -> End:
    world.blocked = True

    def end(world: World) -> None:
        world.blocked = False

    return end


def _keep_on_floor(world: World, value: float) -> End:
    """Prevent lifting the car, or put it back on the floor."""
    world.can_be_lifted = False
    world.set_down()

    def end(world: World) -> None:
        world.can_be_lifted = True

    return end


def _end_rc_signal(world: World, value: float) -> End:
    """End the pulses of the RC receiver. Raises UsageError without a receiver."""
    receiver = world.receiver
    if receiver is None:
        raise UsageError("this car has no RC receiver", remedy="add rc=1 to the URL")
    receiver.has_signal = False

    def end(world: World) -> None:
        receiver.has_signal = True

    return end


def _tear_eeprom(world: World, nth: float) -> End:
    _call_nano(world, "tear_eeprom", int(nth))
    return lambda world: _call_nano(world, "tear_eeprom", 0)


_KINDS_BY_TARGET: dict[str, dict[str, FailureKind]] = {
    "imu": {
        "off": _make_imu_fault("off"), "stuck": _make_imu_fault("stuck"),
        "garbage": _make_imu_fault("garbage"), "zero": _make_imu_fault("zero"),
        "wrong": _make_imu_fault("wrong", "GAIN", 2.0, 0.0, 100.0),
        "slow": _make_imu_fault("slow", "HZ", 10.0, 0.1, 100.0),
        "delayed": _make_imu_fault("delayed", "S", 0.2, 0.0, 1.2),
        "intermittent": _make_imu_fault("intermittent", "SHARE", 0.3, 0.0, 1.0),
        "config": _make_event("config_imu"), "reset": _make_event("reset_imu")},
    "enc": _make_encoder_faults(0),
    "enc2": _make_encoder_faults(1),
    "i2c": {k: _make_state("set_i2c", (k,), ("ok",)) for k in ("nack", "sda", "scl", "dead")} | {
        "off": _make_state("set_i2c", ("dead",), ("ok",)),
        "intermittent": FailureKind(_i2c_intermittent, "SHARE", 0.3, 0.0, 1.0),
        "slow": FailureKind(_i2c_slow, "US/BYTE", 1000.0, 0.0, 1e5)},
    "pca": {
        "off": FailureKind(_pca_nack), "nack": FailureKind(_pca_nack, "TIMES", high=1e9),
        "intermittent": FailureKind(_pca_intermittent, "SHARE", 0.3, 0.0, 1.0),
        "brownout": FailureKind(_pca_brown_out),
        "sda": _make_bus_fault("sda"), "scl": _make_bus_fault("scl")},
    "mcu": {
        "reset": _make_event("reset", "external"), "brownout": _make_event("reset", "brownout"),
        "watchdog": _make_event("reset", "watchdog"),
        "hang": _make_state("hang", (True,), (False,)),
        "freeze": _make_state("freeze", (True,), (False,))},
    "line": {
        # The line itself drops the bytes: failures.silent_intervals().
        "off": FailureKind(lambda world, value: _do_nothing),
        "garbage": FailureKind(_make_line_fault("bit_error"), "BER", 1e-3, 0.0, 1.0),
        "wrong": FailureKind(_make_line_fault("drop"), "SHARE", 0.01, 0.0, 1.0),
        "delayed": FailureKind(_make_line_fault("delay"), "S", 0.05, 0.0, 10.0),
        "intermittent": FailureKind(_line_intermittent, "SHARE", 0.3, 0.0, 1.0)},
    "power": {
        "nano": FailureKind(_cut_power), "droop": FailureKind(_lower_supply, "V", 4.0, 0.0, 5.5)},
    "esc": {"off": FailureKind(_cut_esc_power), "wrong": FailureKind(_swap_leads)},
    "wheel": {"stuck": FailureKind(_block_wheel)},
    "stand": {"off": FailureKind(_keep_on_floor)},
    "rc": {"off": FailureKind(_end_rc_signal)},
    "eeprom": {"torn": FailureKind(_tear_eeprom, "NTH", 1.0, 1.0, 1024.0)},
}

# All kinds by (target, kind). i2c: the Nano's bus; pca: the board on the computer's bus; esc: no
# battery, or the motor's leads swapped; wheel: blocked; rc: no pulses of the receiver.
FAILURE_KINDS = {(target, name): kind for target, kinds in _KINDS_BY_TARGET.items()
                 for name, kind in kinds.items()}
