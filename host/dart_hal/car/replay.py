"""``replay://run.mcap``: a recorded run as a backend.

The recorded bytes go through the same decoder, in their order and with their time stamps; the
clock is that of the recording. There is no bus: commands are accepted and reported as not sent.
For exactly the States of the run, the link also gives the pulses that were applied, and when the
recorded pings were sent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Generic, Protocol, TypeVar

from dart_hal.core.errors import DartHalError, EndOfRecording, RecordingError
from dart_hal.core.ports import Chunk, Link
from dart_hal.core.types import NEUTRAL_APPLIED, Applied, ExternalPose
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.source import FRAME
from dart_hal.recording.run import AppliedAt, RunReader
from dart_hal.wire.codec import DOWN, UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO, STATE, TIME_PING

# s: a run whose recording began with ``Car.open`` contains a HELLO by then.
MAX_HELLO_TIME = 4.0


class ReplayClock:
    """Clock of the recording; it advances only by reads and sleeps."""

    def __init__(self, start: float) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time [s]."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance by ``seconds``."""
        self._now += max(seconds, 0.0)

    def reach(self, t: float) -> None:
        """Advance to ``t``, never back."""
        self._now = max(self._now, t)


class ReplayLink(Link):
    """Recorded bytes in recorded order; writes are dropped.

    ``applied``: what the pins carried when the newest chunk arrived; ``applied_next``: the same for
    the chunk after it.
    """

    def __init__(self, recording: RunReader, clock: ReplayClock) -> None:
        self.recording = recording
        self._clock = clock
        self._items: deque[Chunk | AppliedAt] = deque(recording.replay())
        self._pings = sent_pings(recording)
        hello = missing_hello(recording)
        if hello is not None:
            self._items.appendleft(hello)
        self.applied: Applied = NEUTRAL_APPLIED
        self.applied_next: Applied = NEUTRAL_APPLIED
        self._take_applied()

    def read(self, timeout: float) -> Chunk | None:
        """Return the next chunk if it is due within ``timeout`` s of the recording.

        Raises EndOfRecording after the last one.
        """
        if not self._items:
            raise EndOfRecording(f"{self.recording.path}: the recording is over",
                                 found=f"t = {self._clock.now():.3f} s",
                                 read=str(self.recording.path))
        chunk = self._items[0]
        assert isinstance(chunk, Chunk)
        deadline = self._clock.now() + timeout
        if chunk.t > deadline:
            self._clock.reach(deadline)
            return None
        self._items.popleft()
        self.applied = self.applied_next
        self._take_applied()
        self._clock.reach(chunk.t)
        return chunk

    def _take_applied(self) -> None:
        """Take over the pulses that were recorded before the next bytes."""
        while self._items and isinstance(self._items[0], AppliedAt):
            self.applied_next = self._items.popleft().applied  # type: ignore[union-attr]

    @property
    def baud(self) -> int:
        """Return the line rate of the run, which determines the transmission time of a frame."""
        noted = self.recording.metadata.get("line", {}).get("baud", "")
        return int(noted) if noted.isdecimal() and int(noted) else 500_000

    def ping_sent(self, ping_id: int) -> float | None:
        """Return the host time [s] at which the newest recorded ping of that id was sent."""
        sent = self._pings.get(ping_id)
        now = self._clock.now()
        return max((t for t in sent or () if t <= now), default=None)

    def write(self, data: bytes) -> None:
        """Drop the bytes: a recording has no receiver."""

    def close(self) -> None:
        self._items.clear()


class ReplayPoses:
    """Recorded external poses, each at its arrival; ``on_board``: from the car's own lidar."""

    def __init__(self, recording: RunReader, poses: Iterable[ExternalPose]) -> None:
        self.name = f"the poses in {recording.path}"
        self._poses = deque(poses)
        self.on_board = bool(self._poses) and self._poses[0].frame == FRAME
        self.map_std = float(recording.meta.get("map_std", "0.0"))

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the poses that have arrived by ``now`` [s]."""
        due = []
        while self._poses and self._poses[0].arrival <= now:
            due.append(self._poses.popleft())
        return due

    def close(self) -> None:
        self._poses.clear()


class HasArrival(Protocol):
    """An item that was recorded with its arrival."""

    @property
    def arrival(self) -> float:
        """Return the arrival [s] on the car's clock."""


ArrivesT = TypeVar("ArrivesT", bound=HasArrival)


class ReplaySource(Generic[ArrivesT]):
    """Recorded scans or images, each at its arrival; read from the file when they are due."""

    trouble: DartHalError | None = None

    def __init__(self, what: str, recording: RunReader, first: ArrivesT,
                 rest: Iterator[ArrivesT]) -> None:
        self.name = f"the {what} in {recording.path}"
        self._next: ArrivesT | None = first
        self._rest = rest

    def poll(self, now: float) -> list[ArrivesT]:
        """Return the items that have arrived by ``now`` [s]."""
        due = []
        while self._next is not None and self._next.arrival <= now:
            due.append(self._next)
            self._next = next(self._rest, None)
        return due

    def close(self) -> None:
        self._next = None


def sent_pings(recording: RunReader) -> dict[int, list[float]]:
    """Return the host times [s] of the recorded TIME_PING frames by their id (ids wrap)."""
    decoder = FrameDecoder(DOWN)
    found: dict[int, list[float]] = {}
    for chunk in recording.sent():
        for frame in decoder.feed(chunk.data):
            if frame.message.id == TIME_PING.id:
                found.setdefault(frame.values()[0], []).append(chunk.t)
    return found


def missing_hello(recording: RunReader) -> Chunk | None:
    """Return a HELLO to start with, for a run whose recording began after the opening."""
    if recording.hello is None:
        return None
    # Search the first seconds for a HELLO; note the sequence number of the first STATE.
    decoder = FrameDecoder(UP)
    first: tuple[int, float] | None = None
    for chunk in recording.chunks():
        for frame in decoder.feed(chunk.data):
            if frame.message.id == HELLO.id:
                return None
            if frame.message.id == STATE.id and first is None:
                first = frame.seq, chunk.t
        if first is not None and chunk.t > first[1] + MAX_HELLO_TIME:
            break
    if first is None:
        return None
    # The HELLO precedes the first STATE, so that no frame counts as lost.
    return Chunk(encode(HELLO, (first[0] - 1) & 0xFF, recording.hello), first[1])


def open_replay(url: Url) -> Backend:
    """Open ``replay://FILE``; with ``?car=NAME`` one car of a file of several.

    Raises RecordingError that names the file.
    """
    url.known("car")
    if not url.target:
        raise RecordingError("replay:// names no file", found=url.text,
                             remedy="replay://run.mcap")
    car = url.options.get("car")
    recording = RunReader(url.target if car is None else f"{url.target}?car={car}")
    first = next(recording.chunks(), None)
    if first is None:
        raise RecordingError(f"{url.target}: holds no bytes of the Nano", read=url.target,
                             likely="the run was cut off before its first frame")
    poses = list(recording.poses())
    scans = recording.scans()
    scan = next(scans, None)
    images = recording.images()
    image = next(images, None)
    clock = ReplayClock(min(recording.start, first.t) if recording.meta else first.t)
    return Backend(
        url=url, link=ReplayLink(recording, clock), clock=clock, bus=None, virtual=True,
        car=recording.meta.get("car") or None, car_toml=recording.files.get("car.toml"),
        measured={n: t for n, t in recording.files.items() if n != "car.toml"},
        notices=recording.notices, poses=ReplayPoses(recording, poses) if poses else None,
        lidar=ReplaySource("scans", recording, scan, scans) if scan else None,
        camera=ReplaySource("images", recording, image, images) if image else None,
        battery=tuple(recording.battery()))
