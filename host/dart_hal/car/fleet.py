"""Several cars in lockstep: one State of each per tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from math import inf
from types import TracebackType

from dart_hal.car.car import Car
from dart_hal.types import SAMPLE, State


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
        """One State per car at each tick of the first car; ends with the first car that ends.

        The Nanos' clocks differ by up to half a percent: the States of a tick
        are within half a frame of each other, counted from the first tick. A
        car that is ahead shows its State again, one that is behind skips one.
        """
        streams = [car.states(duration=inf, timeout=timeout) for car in self.cars]
        try:
            now = [next(stream) for stream in streams]
            start = [state.t for state in now]
            while now:
                yield tuple(now)
                passed = now[0].t - start[0]
                if passed >= duration - 1.5 * SAMPLE:
                    return
                now[0] = next(streams[0])
                tick = now[0].t - start[0] - SAMPLE / 2
                for n in range(1, len(now)):
                    while now[n].t - start[n] < tick:
                        now[n] = next(streams[n])
        except StopIteration:
            return

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
