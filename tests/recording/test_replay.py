"""A recorded run as a backend: the same bytes at the same times."""

from __future__ import annotations

import pytest

from dart_hal.car.replay import open_replay
from dart_hal.core.errors import EndOfRecording, LinkLost, RecordingError, UsageError
from dart_hal.core.types import NEUTRAL_APPLIED, Applied
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader, RunWriter
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO


def open_run(path):
    return open_replay(Url.parse(f"replay://{path}"))


def drain(backend, timeout):
    chunks = []
    while True:
        try:
            chunk = backend.link.read(timeout)
        except EndOfRecording:
            return chunks
        if chunk is not None:
            chunks.append((chunk, backend.clock.now()))


@pytest.mark.parametrize("timeout", [0.0001, 0.001, 0.01, 5.0])
def test_the_recorded_chunks_at_their_own_time(run_file, timeout):
    got = drain(open_run(run_file), timeout)
    assert [c for c, _ in got] == list(RunReader(run_file).chunks())
    assert all(now == chunk.t for chunk, now in got)


def test_time_passes_only_by_reading_and_sleeping(run_file):
    backend = open_run(run_file)
    assert backend.clock.now() == 0.25
    assert backend.link.read(0.01) is None
    assert backend.clock.now() == 0.26
    backend.clock.sleep(0.1)
    assert backend.clock.now() == 0.36
    chunk = backend.link.read(0.0)
    assert chunk is not None
    assert chunk.t == 0.3
    assert backend.clock.now() == 0.36


def test_the_end_is_an_end_not_a_silence(run_file):
    backend = open_run(run_file)
    drain(backend, 1.0)
    with pytest.raises(EndOfRecording) as error:
        backend.link.read(1.0)
    assert isinstance(error.value, LinkLost)
    assert str(run_file) in error.value.what


def test_the_backend_is_the_car_of_the_run_without_a_bus(run_file):
    backend = open_backend(f"replay://{run_file}")
    assert backend.bus is None
    assert backend.virtual
    assert backend.car == "sim-1"
    assert backend.car_toml == "name = 'sim-1'\n"
    backend.link.write(b"nobody listens")
    backend.close()


def test_pulses_applied_at_each_frame(run_file):
    link = open_run(run_file).link
    assert link.applied == NEUTRAL_APPLIED
    hello = link.read(1.0)
    assert hello is not None
    for k in range(20):
        link.read(1.0)
        before = NEUTRAL_APPLIED if k == 0 else Applied(
            0.01 * ((k - 1) // 5 * 5), 0.25, 1500.0 + (k - 1) // 5 * 5, 1612.5, ("RANGE",))
        after = Applied(0.01 * (k // 5 * 5), 0.25, 1500.0 + k // 5 * 5, 1612.5, ("RANGE",))
        assert link.applied == before
        assert link.applied_next == after


def test_when_the_pings_had_left(run_file):
    backend = open_run(run_file)
    for _ in range(8):
        backend.link.read(1.0)
    sent = list(RunReader(run_file).sent())
    assert backend.link.ping_sent(5) == sent[1].t
    assert backend.link.ping_sent(10) is None  # has not left yet
    assert backend.link.ping_sent(999) is None


def hellos(backend):
    decoder = FrameDecoder(UP)
    frames = [f for c, _ in drain(backend, 1.0) for f in decoder.feed(c.data)]
    assert decoder.counters.gaps == 0
    return [f.message.id == HELLO.id for f in frames]


def test_a_run_begun_after_the_opening_still_names_who_answered(tmp_path, writing):
    path = tmp_path / "late.mcap"
    writing(path, hello=False, note_hello=True)
    assert hellos(open_run(path)) == [True, *[False] * 20]


def test_a_hello_in_the_stream_is_not_doubled(tmp_path, writing):
    path = tmp_path / "early.mcap"
    writing(path, hello=True, note_hello=True)
    assert hellos(open_run(path)) == [True, *[False] * 20]


def test_a_cut_off_run_replays_and_reports_it(run_file):
    data = run_file.read_bytes()
    run_file.write_bytes(data[:len(data) // 2])
    backend = open_run(run_file)
    assert str(run_file) in backend.notices[0]
    assert 0 < len(drain(backend, 1.0)) < 21


def test_a_run_without_bytes_is_refused_by_name(tmp_path):
    path = tmp_path / "empty.mcap"
    RunWriter(path).close()
    with pytest.raises(RecordingError, match="no bytes") as error:
        open_run(path)
    assert str(path) in error.value.what


def test_bad_urls(tmp_path):
    with pytest.raises(RecordingError):
        open_replay(Url.parse("replay://"))
    with pytest.raises(RecordingError):
        open_run(tmp_path / "missing.mcap")
    with pytest.raises(UsageError):
        open_replay(Url.parse("replay://run.mcap?speed=2"))
