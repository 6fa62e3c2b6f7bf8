"""Many simulated cars at once, each with the same result as alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.errors import BadCommand, UsageError
from dart_hal.vehicle import Vehicle, stack
from dart_lab.sim.light.car import DEFAULT, vehicle_named
from dart_lab.sim.light.config import LightConfig
from dart_lab.sim.light.history import ArrayHistory
from dart_lab.sim.light.noise import Seed
from dart_lab.sim.light.ops import ARRAY_OPS
from dart_lab.sim.light.plant import LightPlant, MakeStepper
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.stepper import State8, Stepper, Substeps, make_array_stepper

Array = NDArray[Any]
Named = Vehicle | str | Path


class LightBatch(LightPlant):
    """n cars in arrays (n,).

    ``vehicle``: one for all, or a sequence of n with the same equations (pure
    delays must be equal). ``seed``: a number (car i has the noise of
    ``LightCar(seed=[seed, i])``), or a sequence of one seed per car. ``state``:
    eight arrays (n,) as those of LightCar.
    Raises UsageError and ConfigError as LightCar does.
    """

    def __init__(self, vehicle: Named | Sequence[Named] = DEFAULT, n: int = 1,
                 config: LightConfig | None = None, seed: int | Sequence[Seed] = 0) -> None:
        if n < 1:
            raise UsageError("a batch needs a car", found=f"n = {n}", expected="1 or more")
        self.n = n
        c = config or LightConfig()
        seeds = self._seeds(seed)
        if isinstance(vehicle, Vehicle | str | Path):
            p = first = vehicle_named(vehicle)
        else:
            each = [vehicle_named(v) for v in vehicle]
            _check(each, n)
            p = stack(each, c.dtype)
            first = each[0]
        super().__init__(p, c, ARRAY_OPS, self._stepper_maker(c), seeds, False, first)
        if c.sensors is not None:
            self._history = ArrayHistory(self._depth, self._signals, n, c.dtype)
        self._just_reset = np.zeros(n, dtype=bool)
        self.state = tuple(np.zeros((8, n), dtype=c.dtype))
        self.reset()

    @staticmethod
    def _stepper_maker(c: LightConfig) -> MakeStepper:
        def make(p: Vehicle, step: float, method: str, fine: Substeps,
                 kind: str = "car") -> Stepper:
            return make_array_stepper(p, step, method, fine, c.dtype, c.engine, kind)

        return make

    def _seeds(self, seed: int | Sequence[Seed]) -> Sequence[Seed]:
        if isinstance(seed, int):
            return [[seed, i] for i in range(self.n)]
        if len(seed) != self.n:
            raise UsageError("as many seeds as cars are needed", found=f"{len(seed)} seeds",
                             expected=f"{self.n}")
        return seed

    def reset(self, start: Array | None = None, lanes: Array | None = None,
              seed: int | Sequence[Seed] | None = None) -> State8:
        """Reset all cars, or those of the indices ``lanes``.

        start: (6, m) or (8, m) for the m cars that are reset, rows as in ``state``; None = at rest
        at the origin. With ``seed`` all noise starts again. Raises UsageError for other shapes.
        """
        if seed is not None:
            self.seed(self._seeds(seed))
        where = np.arange(self.n) if lanes is None else np.asarray(lanes)
        full = np.zeros((8, self.n), dtype=self.config.dtype)
        if start is not None:
            if start.ndim != 2 or start.shape[0] not in (6, 8) or start.shape[1] != len(where):
                raise UsageError("the start of a batch does not fit", found=str(start.shape),
                                 expected=f"(6, {len(where)}) or (8, {len(where)})")
            full[:len(start), where] = start
        self._restart(full, where)
        return self.state

    def _restart(self, full: Array, where: Array) -> None:
        # At the first reset all state becomes arrays.
        if np.ndim(self.k) == 0:
            self.k = np.zeros(self.n, dtype=np.intp)
            self._servo, self._travel, self._path = np.zeros((3, self.n), dtype=full.dtype)
            self._bias = np.zeros((3, self.n), dtype=full.dtype)
            self._queue.extend([(np.zeros(self.n, full.dtype), np.zeros(self.n, full.dtype))
                                for _ in range(self._queue.maxlen or 1)])
            if self._force is not None:
                along, across = np.zeros((2, self.n), dtype=full.dtype)
                self._force.force = (along, across)
        self.k = self.k.copy()
        self.k[where] = 0
        self.state = _put(self.state, tuple(full), where)
        # Five normal numbers per car: three biases, two components of the force.
        rows = np.array([self._starts[i].standard_normal(5) for i in where],
                        dtype=full.dtype).reshape(-1, 5).T
        self._servo, self._travel, self._path = _put(
            (self._servo, self._travel, self._path), (full[7], 0.0, 0.0), where)
        for i, bias in enumerate(self._offsets(rows)):
            self._bias[i, where] = bias
        if self._force is not None:
            along, across = (v.copy() for v in self._force.force)
            along[where], across[where] = self._force.start(rows[3:])
            self._force.force = (along, across)
        # The delayed commands before the start are those of the start.
        for i, pair in enumerate(self._queue):
            throttle, steering = _put(pair, (full[6], full[7]), where)
            self._queue[i] = throttle, steering
        chosen = np.zeros(self.n, dtype=bool)
        chosen[where] = True
        self._start_effects(chosen)
        if self._history is not None:
            self._history.fill(self._extrapolate_past(tuple(full)), where)
        self._just_reset[where] = True

    def advance(self, throttle: Array, steering: Array, steps: int = 1) -> State8:
        """Return the state after ``steps`` steps with constant commands -1..1, (n,) each.

        Raises BadCommand for other shapes, NaN or infinity.
        """
        kind = self.config.dtype
        commands = [np.asarray(v, dtype=kind) for v in (throttle, steering)]
        if any(v.shape != (self.n,) or not np.isfinite(v).all() for v in commands):
            raise BadCommand("a finite command is needed for each car",
                             found=f"shapes {[v.shape for v in commands]}, or NaN",
                             expected=f"two arrays ({self.n},) of -1 to 1")
        return super().advance(commands[0], commands[1], steps)

    def read(self, going: Any = True) -> Reading:
        """Return the sensor readings now, arrays (n,). Raises UsageError without sensors."""
        reading = super().read(~self._just_reset)
        self._just_reset[:] = False
        return reading

    def drive(self, throttle: Array, steering: Array, steps: int = 1) -> Reading:
        """``advance`` and ``read`` in one."""
        self.advance(throttle, steering, steps)
        return self.read()


def _put(old: Sequence[Any], new: Sequence[Any], where: Array) -> tuple[Any, ...]:
    """Return copies of the old arrays with the elements ``where`` of the new ones."""
    out = []
    for a, b in zip(old, new, strict=True):
        fresh = np.array(a)
        fresh[where] = b[where] if np.ndim(b) else b
        out.append(fresh)
    return tuple(out)


def _check(vehicles: Sequence[Vehicle], n: int) -> None:
    if len(vehicles) != n:
        raise UsageError("as many vehicles as cars are needed", found=f"{len(vehicles)} vehicles",
                         expected=f"{n}, or one for all")
    if len({(v.delay.throttle_s, v.delay.steering_s) for v in vehicles}) > 1:
        raise UsageError("all cars of a batch need the same pure delays",
                         found="different delays", expected="one throttle_s and one steering_s",
                         remedy="run one batch for each delay")
