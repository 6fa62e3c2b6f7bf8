"""Several cars in lockstep: one State of each per tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from math import inf
from types import TracebackType

from dart_hal.car.car import Car
from dart_hal.types import State


class Fleet:
    """Cars that are driven together; a context manager. ``cars`` in the order of the URLs."""

    def __init__(self, cars: Sequence[Car]) -> None:
        self.cars = tuple(cars)

    @classmethod
    def open(cls, urls: Sequence[str]) -> Fleet:
        """Open every URL, or none: what was opened is closed if one fails."""
        with ExitStack() as stack:
            cars = [stack.enter_context(Car.open(url)) for url in urls]
            stack.pop_all()
        return cls(cars)

    def arm(self, *, waive: Sequence[str] = ()) -> None:
        """Arm one after the other; if one refuses, all are stopped. Raises NotArmed."""
        try:
            for car in self.cars:
                car.arm(waive=waive)
        except BaseException:
            self.stop()
            raise

    def states(self, *, duration: float = inf, timeout: float = 0.5) -> Iterator[tuple[State, ...]]:
        """One State per car at each tick; ends with the first car that ends."""
        streams = [car.states(duration=duration, timeout=timeout) for car in self.cars]
        yield from zip(*streams, strict=False)

    def stop(self) -> None:
        """Stop every car, also when one of them raises."""
        with ExitStack() as stack:
            for car in self.cars:
                stack.callback(car.stop)

    def close(self) -> None:
        """Close every car, also when one of them raises."""
        with ExitStack() as stack:
            for car in self.cars:
                stack.callback(car.close)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
