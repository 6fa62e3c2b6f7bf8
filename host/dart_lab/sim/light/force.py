"""A random force at the centre of mass, with an effect that is independent of the step."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dart_hal.vehicle.namespace import Value
from dart_lab.sim.light.config import Disturbance


class RandomForce:
    """Changes v_x and v_y by the impulse of the force over a step.

    White: density sqrt(step) times a normal number. Correlated: the exact solution of
    F' = -F / time + noise at both ends of the step, and their mean as force over the step.
    ``force``: the present correlated force (along, across) [N].
    """

    def __init__(self, p: Disturbance, mass: Value, step: float) -> None:
        self.force: tuple[Value, Value] = (0.0, 0.0)
        self._p = p
        self._step = step
        self.set_mass(mass)
        # F_next = exp(-step / time) F + sqrt(1 - exp(-2 step / time)) sigma z
        self._keep = math.exp(-step / p.time) if p.time > 0.0 else 0.0
        self._new = math.sqrt(1.0 - self._keep**2)

    def set_mass(self, mass: Value) -> None:
        """Set the mass [kg] from now on."""
        self._per_mass = 1.0 / mass

    def start(self, row: Sequence[Value]) -> tuple[Value, Value]:
        """Return a force of the stationary distribution, for a car that is reset."""
        if self._p.time > 0.0:
            return self._p.along * row[0], self._p.across * row[1]
        return 0.0 * row[0], 0.0 * row[1]

    def __call__(self, state: tuple[Value, ...], row: Sequence[Value]) -> tuple[Value, ...]:
        """Return the state after the impulse; row: two standard normal numbers."""
        p = self._p
        if p.time > 0.0:
            old = self.force
            self.force = (self._keep * old[0] + self._new * p.along * row[0],
                          self._keep * old[1] + self._new * p.across * row[1])
            half = 0.5 * self._step * self._per_mass
            kx = half * (old[0] + self.force[0])
            ky = half * (old[1] + self.force[1])
        else:
            root = math.sqrt(self._step) * self._per_mass
            kx = root * p.along * row[0]
            ky = root * p.across * row[1]
        return (*state[:3], state[3] + kx, state[4] + ky, *state[5:])
