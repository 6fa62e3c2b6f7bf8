"""The key of a room: where it comes from, what it refuses, and that no text shows it."""

from __future__ import annotations

import hashlib
import hmac

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.car import Car, Fleet, join
from dart_hal.core.errors import UsageError
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, encode
from dart_hal.fleet.key import KEY_VARIABLE, RoomKey, find_key, read_key
from dart_hal.fleet.station import Station
from tests.fleet.rooms import pose_frame

SECRET = "4f7c" * 16
SECRET_KEY = RoomKey(SECRET.encode())


def encode_signed(seq=1, key=SECRET_KEY):
    return encode(m.BEAT, 7, seq, 1.0, ("red",), key)


def test_a_signature_is_hmac_sha_256_over_the_whole_frame():
    data = encode_signed()
    expected = hmac.new(SECRET.encode(), data[:-16], hashlib.sha256).digest()[:16]
    assert data[-16:] == expected
    assert data[2] == m.SIGNED_VERSION


def test_a_decoder_with_the_key_takes_signed_frames_alone():
    decoder = Decoder(SECRET_KEY)
    assert decoder.decode(encode_signed()).name == "red"
    assert decoder.decode(pose_frame(1)) is None
    assert decoder.decode(encode_signed(key=RoomKey(b"another key of 25 bytes.."))) is None
    c = decoder.counters
    assert (c.ok, c.unsigned, c.forged, c.refused) == (1, 1, 1, 2)


def test_a_frame_whose_version_is_changed_on_the_way_is_refused():
    """A signed frame without its signature, or an unsigned one that claims to have one."""
    data = bytearray(encode_signed()[:-16])
    data[2] = m.VERSION
    assert Decoder(SECRET_KEY).decode(bytes(data)) is None
    plain = bytearray(pose_frame(1))
    plain[2] = m.SIGNED_VERSION
    assert Decoder(SECRET_KEY).decode(bytes(plain)) is None
    assert Decoder(SECRET_KEY).decode(bytes(plain) + bytes(16)) is None
    assert Decoder().decode(encode_signed()) is None


@given(st.integers(0, 10**6), st.integers(0, 7))
def test_no_bit_of_a_signed_frame_can_be_changed(place, bit):
    data = bytearray(encode_signed())
    data[place % len(data)] ^= 1 << bit
    assert Decoder(SECRET_KEY).decode(bytes(data)) is None


@pytest.mark.slow
@given(st.binary(max_size=200))
def test_junk_is_counted_and_never_raised(junk):
    decoder = Decoder(SECRET_KEY)
    for data in (junk, b"DF\x02" + junk, encode_signed()[:len(junk)]):
        decoder.decode(data)
    assert decoder.counters.ok + decoder.counters.refused == 3


def test_no_text_shows_the_key(tmp_path):
    file = tmp_path / "room.key"
    file.write_text(SECRET)
    with Station("local://secret", room_key=file) as station:
        for text in (repr(SECRET_KEY), str(SECRET_KEY), f"{SECRET_KEY}",
                     repr(station.peers.decoder.__dict__)):
            assert SECRET not in text
    with pytest.raises(UsageError) as refused:
        RoomKey(b"short secret")
    assert "short secret" not in str(refused.value)


@pytest.mark.parametrize("content", [SECRET, SECRET + "\n", "\ufeff" + SECRET + "\r\n"])
def test_a_file_of_a_key_may_have_what_editors_add(tmp_path, content):
    file = tmp_path / "room.key"
    file.write_bytes(content.encode())
    assert read_key(file) == SECRET_KEY
    assert read_key(str(file)) == SECRET_KEY


@pytest.mark.parametrize("content", [b"", b"\n \n", b"short", b"x" * 5000])
def test_a_file_that_is_no_key_is_refused(tmp_path, content):
    file = tmp_path / "room.key"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=r"room\.key"):
        read_key(file)


@pytest.mark.parametrize("path", ["missing", ".", "a\0b"])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, path):
    with pytest.raises(UsageError, match="cannot be read"):
        read_key(tmp_path / path)


def test_the_variable_holds_the_key_or_the_path_of_its_file(tmp_path, monkeypatch):
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    assert find_key() is None
    file = tmp_path / "room.key"
    file.write_text(SECRET)
    for value in (SECRET, str(file)):
        monkeypatch.setenv(KEY_VARIABLE, value)
        assert find_key() == SECRET_KEY
    for value in ("", "short", str(tmp_path / "missing")):
        monkeypatch.setenv(KEY_VARIABLE, value)
        with pytest.raises(UsageError):
            find_key()
        assert find_key(SECRET_KEY) == SECRET_KEY, "what is given counts before the variable"


def test_cars_and_stations_take_the_key_of_the_variable(monkeypatch):
    monkeypatch.setenv(KEY_VARIABLE, SECRET)
    with (Car.open("sim://?nano=mock&seed=1") as car,
          join(car, "local://variable", name="red") as member,
          Station("local://variable", "base", now=lambda: car.now) as station):
        assert station.has_key
        for _ in car.states(duration=0.4):
            station.watch()
        assert [heard.name for heard in station.cars()] == ["red"]
        assert member.ignored == {}


def test_a_key_that_cannot_be_read_opens_no_room(tmp_path):
    with Car.open("sim://?nano=mock&seed=1") as car:
        with pytest.raises(UsageError, match="cannot be read"):
            join(car, "local://x", room_key=tmp_path / "missing")
        with pytest.raises(UsageError, match="cannot be read"):
            Station("local://x", room_key=tmp_path / "missing")
        with pytest.raises(UsageError, match="cannot be read"):
            Fleet.open(["sim://?nano=mock"], room="local://x", room_key=tmp_path / "missing")
