"""EEPROM records: torn writes lose at most the write, never the record."""

from __future__ import annotations

import ctypes as c

import pytest
from firmware_rig import crc16, eeprom_image
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import messages

OK, UNKNOWN, RANGE, BUSY = range(4)
BAUD = messages.PARAM_BY_NAME["baud"].id


def draw_allowed(param: messages.Param) -> st.SearchStrategy[int]:
    if param.name == "baud":
        return st.sampled_from([115_200, 500_000])
    return st.integers(param.low, param.high)


@pytest.fixture
def cells(core: c.CDLL) -> c.Array[c.c_uint8]:
    return blank(core)


def blank(core: c.CDLL) -> c.Array[c.c_uint8]:
    cells = core.eeprom_cells().contents
    cells[:] = b"\xff" * 1024
    core.eeprom_set(-1, 3)
    return cells


def settle(step: object, polls: int = 500) -> None:
    for _ in range(polls):
        if not step():  # type: ignore[operator]
            return
    raise AssertionError("the write does not end")


def test_defaults_are_those_of_the_specification(core: c.CDLL, cells: object) -> None:
    assert not core.params_load()
    assert [core.params_get(p.id) for p in messages.PARAMS] == \
        [p.default for p in messages.PARAMS]


@given(st.lists(st.sampled_from(messages.PARAMS).flatmap(
    lambda p: st.tuples(st.just(p.id), draw_allowed(p))), min_size=1, max_size=8))
def test_parameters_survive_a_restart(core: c.CDLL, sets: list[tuple[int, int]]) -> None:
    blank(core)
    core.params_load()
    for id, value in sets:
        assert core.params_set(id, value) == OK
        assert core.params_get(id) == value
        settle(lambda: not core.params_step())
    expected = {p.id: p.default for p in messages.PARAMS} | dict(sets)
    crc = core.params_crc()
    assert core.eeprom_illegal() == 0  # no access while a write was under way
    assert core.params_load()
    assert {p.id: core.params_get(p.id) for p in messages.PARAMS} == expected
    assert core.params_crc() == crc


@pytest.mark.parametrize("param", messages.PARAMS, ids=lambda p: p.name)
def test_limits(core: c.CDLL, cells: object, param: messages.Param) -> None:
    core.params_load()
    for value in (param.low - 1, param.high + 1):
        if value >= 0:
            assert core.params_set(param.id, c.c_uint32(value)) == RANGE
    assert core.params_get(param.id) == param.default


def test_refusals_change_nothing(core: c.CDLL, cells: c.Array[c.c_uint8]) -> None:
    core.params_load()
    before = bytes(cells)
    assert core.params_set(0, 1) == UNKNOWN
    assert core.params_set(len(messages.PARAMS) + 1, 1) == UNKNOWN
    assert core.params_set(BAUD, 250_000) == RANGE
    assert core.params_set(1, 30) == OK
    assert core.params_set(1, 31) == BUSY
    assert core.params_get(1) == 30
    assert bytes(cells) == before  # not a byte before the first step


def test_an_equal_value_is_not_written_again(core: c.CDLL, cells: c.Array[c.c_uint8]) -> None:
    core.params_load()
    core.params_set(1, 30)
    settle(lambda: not core.params_step())
    before = bytes(cells)
    assert core.params_set(1, 30) == OK
    settle(lambda: not core.params_step())
    assert bytes(cells) == before


@given(st.integers(0, 40), st.integers(2, 64), st.integers(2, 64))
def test_a_torn_write_leaves_the_old_or_the_new_record(core: c.CDLL, writes: int, old: int,
                                                       new: int) -> None:
    cells = blank(core)
    core.params_load()
    core.params_set(1, old)
    settle(lambda: not core.params_step())
    core.eeprom_set(writes, 1)  # the supply fails after so many bytes
    core.params_set(1, new)
    settle(lambda: not core.params_step())
    core.eeprom_set(-1, 0)
    assert core.params_load()
    assert core.params_get(1) in (old, new)
    assert [core.params_get(p.id) for p in messages.PARAMS[1:]] == \
        [p.default for p in messages.PARAMS[1:]]
    assert crc16(b"\xff" * 6) != 0xFFFF
    assert cells[0] == 0xFF


@pytest.mark.parametrize("busy", [0, 1, 5])
def test_stored_is_reported_after_the_last_byte_and_not_before(core: c.CDLL, cells: object,
                                                           busy: int) -> None:
    core.params_load()
    core.eeprom_set(-1, busy)
    assert core.params_set(1, 30) == OK
    while not core.params_step():
        assert core.params_set(2, 11) == BUSY
    assert not core.params_step()  # once
    core.eeprom_set(-1, 0)
    assert core.params_load()
    assert core.params_get(1) == 30


def test_without_that_last_byte_the_value_is_lost(core: c.CDLL, cells: object) -> None:
    """The control: what an answer one byte earlier would have promised."""
    core.params_load()
    core.eeprom_set(27, 0)  # of 28 bytes
    core.params_set(1, 30)
    settle(lambda: not core.params_step())
    core.eeprom_set(-1, 0)
    core.params_load()
    assert core.params_get(1) == 20


@given(st.binary(min_size=64, max_size=64))
def test_noise_is_never_taken_for_parameters(core: c.CDLL, noise: bytes) -> None:
    cells = blank(core)
    cells[0xA0:0xE0] = noise
    assert not core.params_load()  # magic and CRC: 2^-32
    assert core.params_get(1) == 20


def test_a_record_with_a_value_out_of_range_is_refused(core: c.CDLL, cells: object) -> None:
    image = eeprom_image(edges_per_rev_a=65)
    core.eeprom_cells().contents[:] = image
    assert not core.params_load()
    core.eeprom_cells().contents[:] = eeprom_image(edges_per_rev_a=64)
    assert core.params_load()
    assert core.params_get(1) == 64


def test_the_counter_of_the_slots_wraps(core: c.CDLL, cells: object) -> None:
    assert not core.identity_load()
    core.identity_make(0xCAFEF00D)
    out = (c.c_uint32 * 3)()
    for boot in range(1, 200):
        core.identity_boot()
        settle(core.identity_step)
        assert core.identity_load()
        core.identity_get(out)
        assert tuple(out)[:2] == (0xCAFEF00D, boot)
        body = (0xCAFEF00D).to_bytes(4, "little") + boot.to_bytes(2, "little")
        assert out[2] == crc16(body)


@pytest.mark.parametrize("count", [0x7FFE, 0x7FFF, 0xFFFE, 0xFFFF])
def test_the_newer_slot_wins_across_every_wrap(core: c.CDLL, cells: object, count: int) -> None:
    core.eeprom_cells().contents[:] = eeprom_image(boots=count)
    out = (c.c_uint32 * 3)()
    for n in range(1, 5):
        assert core.identity_load()
        core.identity_boot()
        settle(core.identity_step)
        core.identity_load()
        core.identity_get(out)
        assert out[1] == (count + n) & 0xFFFF


@pytest.mark.parametrize("id", [0, 0xFFFFFFFF])
def test_an_id_never_looks_blank(core: c.CDLL, cells: object, id: int) -> None:
    core.identity_load()
    core.identity_make(c.c_uint32(id))
    out = (c.c_uint32 * 3)()
    core.identity_get(out)
    assert out[0] not in (0, 0xFFFFFFFF)
