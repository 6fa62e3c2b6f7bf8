"""Each car of a fleet has its own files and its own recording."""

from __future__ import annotations

import socket

import pytest

from dart_hal.car import Fleet
from dart_hal.car.fleet import _check_distinct
from dart_hal.core.errors import UsageError
from dart_hal.recording.run import RunReader

FLEET_URLS = ["sim://?seed=1&nano=mock", "sim://?seed=2&nano=mock"]


def test_each_car_has_its_recording(tmp_path):
    runs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    with Fleet.open(FLEET_URLS, record=runs) as fleet:
        for _ in fleet.states(duration=0.1):
            pass
    assert [RunReader(run).meta["car"] for run in runs] == ["sim-1", "sim-2"]


@pytest.mark.parametrize("given", [{"car": ["dart-01"]}, {"car": "dart-01"},
                                   {"record": ["a", "b", "c"]}])
def test_there_is_one_entry_for_each_car(given):
    with pytest.raises(UsageError, match="one entry for each URL"):
        Fleet.open(FLEET_URLS, **given)


class Named:
    """The members of a car that ``_distinct`` uses."""

    def __init__(self, name: str, *, simulated: bool) -> None:
        self.url = f"serial:///dev/{name}"
        self.simulated = simulated
        self.files = type("F", (), {"config": type("C", (), {"name": name})})


def test_two_real_cars_do_not_share_their_files():
    with pytest.raises(UsageError, match="dart-01"):
        _check_distinct([Named("dart-01", simulated=False)] * 2)
    _check_distinct([Named("dart-01", simulated=False), Named("dart-02", simulated=False)])
    _check_distinct([Named("sim-0", simulated=True)] * 2)


def test_the_option_reaches_every_car():
    with Fleet.open(FLEET_URLS, raise_on_trip=False) as fleet:
        assert [car.raise_on_trip for car in fleet.cars] == [False, False]


def encode_pose_line(body, x):
    return f"dart-hal-pose 1 {body} room 5 {x} 0 0\n".encode()


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.slow_except("False")
@pytest.mark.parametrize("spelled", [True, False])
def test_one_stream_gives_each_car_its_own_body(spelled):
    url = f"udp://127.0.0.1:{free_port()}?body="
    names = ["dart-01", "dart-02"]
    poses = url + "{car}" if spelled else [url + name for name in names]
    with (Fleet.open(FLEET_URLS, car=names, poses=poses) as fleet,
          socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out):
        port = int(url.rpartition(":")[2].partition("?")[0])
        out.sendto(encode_pose_line("dart-01", 1.0) + encode_pose_line("dart-02", 2.0),
                   ("127.0.0.1", port))
        *_, last = fleet.states(duration=0.1)
    assert [state.external.newest.x for state in last] == [1.0, 2.0]
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).bind(("127.0.0.1", port))  # let go


def test_a_fleet_without_a_body_for_each_car_is_refused():
    with pytest.raises(UsageError, match="a body for each car"):
        Fleet.open(FLEET_URLS, poses="udp://:5005")
    with pytest.raises(UsageError, match="not a source"):
        Fleet.open(FLEET_URLS, poses=["udp://127.0.0.1:0", "ftp://"])
    with pytest.raises(UsageError, match="one entry for each URL"):
        Fleet.open(FLEET_URLS, poses=[None])


def test_each_car_of_a_fleet_may_have_a_map_of_its_own():
    """It is looked for where it is named."""
    with pytest.raises(UsageError, match=r"none\.yaml is no map of map_server"):
        Fleet.open(FLEET_URLS, poses=["lidar:none.yaml?start=0,0,0", None])
