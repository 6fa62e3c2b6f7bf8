"""Each car of a fleet has its own files and its own recording."""

from __future__ import annotations

import pytest

from dart_hal.car import Fleet
from dart_hal.car.fleet import _distinct
from dart_hal.errors import UsageError
from dart_hal.recording.run import RunReader

URLS = ["sim://?seed=1&nano=mock", "sim://?seed=2&nano=mock"]


def test_each_car_has_its_recording(tmp_path):
    runs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    with Fleet.open(URLS, record=runs) as fleet:
        for _ in fleet.states(duration=0.1):
            pass
    assert [RunReader(run).meta["car"] for run in runs] == ["sim-1", "sim-2"]


@pytest.mark.parametrize("given", [{"car": ["dart-01"]}, {"car": "dart-01"},
                                   {"record": ["a", "b", "c"]}])
def test_there_is_one_entry_for_each_car(given):
    with pytest.raises(UsageError, match="one entry for each URL"):
        Fleet.open(URLS, **given)


class Named:
    """What ``_distinct`` asks of a car."""

    def __init__(self, name: str, *, simulated: bool) -> None:
        self.url, self.simulated = f"serial:///dev/{name}", simulated
        self.files = type("F", (), {"config": type("C", (), {"name": name})})


def test_two_real_cars_do_not_share_their_files():
    with pytest.raises(UsageError, match="dart-01"):
        _distinct([Named("dart-01", simulated=False)] * 2)
    _distinct([Named("dart-01", simulated=False), Named("dart-02", simulated=False)])
    _distinct([Named("sim-0", simulated=True)] * 2)


def test_the_option_reaches_every_car():
    with Fleet.open(URLS, raise_on_trip=False) as fleet:
        assert [car.raise_on_trip for car in fleet.cars] == [False, False]
