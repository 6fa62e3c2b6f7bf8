"""Each row of the PCA9685's behaviour that the actuation relies on."""

from __future__ import annotations

import itertools

import pytest

from dart_hal.core.errors import UsageError
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.pca9685 import Pca9685Model, high_counts

COUNT = 122 / 25e6
FRAME = 4096 * COUNT
NEUTRAL = bytes((0x06, 0, 0, 307 & 0xFF, 307 >> 8, 0, 0, 307 & 0xFF, 307 >> 8))


class Bench:
    """A chip on a bus, with a clock that the test moves."""

    def __init__(self, **options):
        self.t = 0.0
        self.pca = Pca9685Model(**options)
        self.bus = VirtualBus(lambda: self.t, [self.pca])

    def write(self, *data, address=0x40):
        self.bus.writeto(address, bytes(data))

    def read(self, register, n=1, address=0x40):
        buffer = bytearray(n)
        self.bus.writeto_then_readfrom(address, bytes((register,)), buffer)
        return buffer[0] if n == 1 else bytes(buffer)

    def wait(self, seconds):
        self.t += seconds
        self.pca.output.advance(self.t)

    def pulses(self, channel=0):
        return self.pca.output.take(channel)

    def widths_us(self, channel=0):
        return [round((b - a) * 1e6, 2) for a, b in self.pulses(channel)]

    def start(self):
        """50 Hz, awake, auto-increment."""
        self.write(0x00, 0x31)
        self.write(0xFE, 121)
        self.write(0x00, 0x21)
        self.wait(0.01)
        return self

    def led(self, channel, on, off):
        self.write(0x06 + 4 * channel, on & 0xFF, on >> 8, off & 0xFF, off >> 8)


def test_power_on_state():
    b = Bench()
    assert [b.read(r) for r in (0x00, 0x01, 0x06, 0x09, 0x45, 0xFE)] == [
        0x11, 0x04, 0x00, 0x10, 0x10, 0x1E]
    b.wait(1.0)
    assert all(not b.pulses(c) and b.pca.output.high_since(c) is None for c in range(16))


def test_pulses_have_the_width_of_their_counts():
    b = Bench().start()
    b.led(0, 0, 307)
    b.wait(1.0)
    pulses = b.pulses()
    assert {round((e - s) / COUNT) for s, e in pulses} == {307}
    assert [y[0] - x[0] for x, y in itertools.pairwise(pulses)] == pytest.approx(
        [FRAME] * (len(pulses) - 1))
    assert len(pulses) == pytest.approx(50.0, abs=1)


def test_prescale_is_written_only_in_sleep_and_not_below_three():
    b = Bench().start()
    b.write(0xFE, 30)
    assert b.read(0xFE) == 121
    b.write(0x00, 0x31)
    b.write(0xFE, 1)
    assert b.read(0xFE) == 3


def test_untouched_prescale_stretches_and_shrinks_pulses():
    b = Bench()
    b.write(0x00, 0x21)
    b.led(0, 0, 307)
    b.wait(0.1)
    assert b.widths_us()[2] == pytest.approx(307 * 31 / 25, abs=0.01)     # 381 us at 0x1E


def test_oscillator_scale_and_drift():
    fast = Bench(oscillator=26e6).start()
    fast.led(0, 0, 307)
    fast.wait(0.1)
    assert fast.widths_us()[1] == pytest.approx(307 * 122 / 26, abs=0.01)
    drifting = Bench(oscillator=lambda t: 25e6 * (1 + 0.01 * t)).start()
    drifting.led(0, 0, 307)
    drifting.wait(1.0)
    widths = drifting.widths_us()
    assert widths == sorted(widths, reverse=True)
    assert widths[0] / widths[-1] == pytest.approx(1.01, abs=5e-4)


@pytest.mark.parametrize(("pointer", "next_pointer"), [(0x45, 0x00), (0xFE, 0x00), (0x06, 0x07)])
def test_auto_increment_wraps(pointer, next_pointer):
    b = Bench().start()
    assert b.read(pointer, 2)[1] == b.read(next_pointer)


def test_without_auto_increment_the_pointer_stays():
    b = Bench()
    b.write(0x06, 1, 2, 3, 4)
    assert (b.read(0x06), b.read(0x07)) == (4, 0)


def test_counts_latch_at_stop_together():
    b = Bench(update="now").start()
    t0 = b.t
    b.bus.writeto(0x40, NEUTRAL)
    stop = b.bus.log[-1].t_stop
    assert stop - t0 == pytest.approx(0.92e-3, abs=0.02e-3)     # 10 bytes at 100 kHz
    b.wait(0.05)
    assert min(b.pulses(0)[0][0], b.pulses(1)[0][0]) >= stop


def test_och_latches_at_the_fourth_acknowledge():
    b = Bench(update="now").start()
    b.write(0x01, 0x0C)
    b.wait(0.001)
    b.led(0, 0, 4095)
    b.wait(0.1)
    b.pulses()
    write = (0x06, 0, 0, 200, 0)
    b.write(*write, 0, 0)                      # three registers of channel 1 too few
    stop = b.bus.log[-1].t_stop
    b.wait(0.001)
    fourth_ack = stop - 1e-5 * (1 + 2 * 9)
    fall = b.pulses()[0][1]
    assert fall == pytest.approx(fourth_ack, abs=1e-9) or fall < fourth_ack


def test_och_waits_for_all_four_registers():
    b = Bench().start()
    b.write(0x01, 0x0C)
    b.write(0x06, 0, 0, 200)
    b.wait(0.1)
    assert not b.pulses()


@pytest.mark.parametrize("update", ["next_frame", "now"])
def test_new_count_in_the_running_frame_or_the_next(update):
    b = Bench(update=update).start()
    b.led(0, 0, 2048)
    b.wait(0.1)
    rise = b.pca.output.high_since(0)
    while rise is None:
        b.wait(0.001)
        rise = b.pca.output.high_since(0)
    b.pulses()
    b.led(0, 0, 100)
    stop = b.bus.log[-1].t_stop
    b.wait(0.03)
    (_, fall), *_ = b.pulses()
    expected = stop if update == "now" else rise + 2048 * COUNT
    assert fall == pytest.approx(expected, abs=1e-9)
    b.wait(0.1)
    assert {round((e - s) / COUNT) for s, e in b.pulses()} == {100}


def test_unknown_update_rule_is_refused():
    with pytest.raises(UsageError):
        Pca9685Model(update="never")


@pytest.mark.parametrize(("led", "counts"), [
    (b"\x00\x00\x33\x01", ((0, 307),)),
    (b"\x64\x00\x0a\x00", ((0, 10), (100, 4096))),
    (b"\x64\x00\x00\x00", ((100, 4096),)),
    (b"\x00\x10\x00\x00", ((0, 4096),)),
    (b"\x00\x10\x00\x10", ()),
    (b"\x05\x00\x05\x00", ()),
    (b"\x00\x00\xff\x0f", ((0, 4095),)),
])
def test_led_registers(led, counts):
    assert high_counts(led) == counts


def test_a_wrapping_pulse_joins_across_the_frame():
    b = Bench().start()
    b.led(0, 4000, 100)
    b.wait(0.2)
    assert {round((e - s) / COUNT) for s, e in b.pulses()[1:]} == {196}


def test_full_on_and_full_off():
    b = Bench().start()
    b.write(0x06, 0, 0x10, 0, 0)
    b.wait(0.1)
    assert not b.pulses()
    assert b.pca.output.high_since(0) is not None
    b.write(0x06, 0, 0x10, 0, 0x10)
    b.wait(0.1)
    assert b.pca.output.high_since(0) is None


def test_all_led_writes_every_channel_and_reads_zero():
    b = Bench().start()
    b.write(0xFA, 0, 0, 307 & 0xFF, 307 >> 8)
    b.wait(0.1)
    assert all(b.widths_us(c) for c in range(16))
    assert b.read(0xFA, 4) == bytes(4)
    b.write(0xFD, 0x10)
    b.wait(0.05)
    for channel in range(16):
        b.pulses(channel)
    b.wait(0.1)
    assert not any(b.pulses(c) for c in range(16))


def test_sleep_cuts_a_pulse_and_sets_restart():
    b = Bench().start()
    b.led(0, 0, 2048)
    b.wait(0.1)
    while b.pca.output.high_since(0) is None:
        b.wait(0.001)
    b.pulses()
    b.write(0x00, 0x31)
    stop_of_sleep = b.bus.log[-1].t_stop
    b.wait(0.05)
    (rise, fall), = b.pulses()
    assert fall - rise < 2048 * COUNT
    assert fall == pytest.approx(stop_of_sleep, abs=2e-5)
    assert b.read(0x00) == 0xB1


def asleep_with_old_pulses(**options):
    b = Bench(**options).start()
    b.led(1, 0, 338)
    b.wait(0.1)
    b.write(0x00, 0x31)
    b.wait(0.1)
    b.pulses(1)
    return b


def test_waking_alone_brings_no_pulse_back():
    b = asleep_with_old_pulses()
    b.write(0x00, 0x21)
    b.wait(0.1)
    assert not b.pulses(1)
    assert b.read(0x00) & 0x80


def test_restart_after_half_a_millisecond_resumes_the_old_pulses():
    b = asleep_with_old_pulses()
    b.write(0x00, 0x21)
    b.wait(0.001)
    b.write(0x00, 0xA1)
    b.wait(0.1)
    assert b.widths_us(1)[0] == pytest.approx(338 * COUNT * 1e6, abs=0.01)
    assert not b.read(0x00) & 0x80


def test_restart_too_early_is_not_obeyed():
    b = asleep_with_old_pulses()
    b.write(0x00, 0x21)
    b.write(0x00, 0xA1)                        # 0.3 ms later on the wire
    b.wait(0.1)
    assert not b.pulses(1)


def test_led_write_clears_restart_and_starts_the_new_pulses():
    b = asleep_with_old_pulses()
    b.bus.writeto(0x40, NEUTRAL)
    assert not b.read(0x00) & 0x80
    b.write(0x00, 0x21)
    b.wait(0.1)
    assert set(b.widths_us(1)) == {round(307 * COUNT * 1e6, 2)}


def test_with_och_only_a_whole_channel_clears_restart():
    b = asleep_with_old_pulses()
    b.write(0x01, 0x0C)
    b.write(0x0A, 0, 0, 50)
    assert b.read(0x00) & 0x80
    b.led(1, 0, 307)
    assert not b.read(0x00) & 0x80


def test_orderly_shutdown_leaves_no_restart():
    b = Bench().start()
    b.led(0, 0, 307)
    b.wait(0.1)
    b.write(0xFD, 0x10)
    b.write(0x00, 0x31)
    assert not b.read(0x00) & 0x80


@pytest.mark.parametrize("how", ["swrst", "brown_out"])
def test_reset_falls_back_to_power_on(how):
    b = asleep_with_old_pulses()
    if how == "swrst":
        b.write(0x06, address=0x00)
    else:
        b.pca.brown_out(b.t)
    assert (b.read(0x00), b.read(0xFE), b.read(0x09)) == (0x11, 0x1E, 0x10)


def test_a_brown_out_stops_the_pulses_without_an_exception():
    b = Bench().start()
    b.led(0, 0, 307)
    b.wait(0.1)
    b.pca.brown_out(b.t)
    b.wait(0.001)
    b.pulses()
    b.led(0, 0, 307)
    b.wait(0.5)
    assert not b.pulses()


@pytest.mark.parametrize(("mode2", "high"), [(0x04, False), (0x05, True), (0x01, False),
                                             (0x06, False)])
def test_output_enable(mode2, high):
    """OUTNE 00: low; 01: high if OUTDRV; 1x and open drain: high-Z, no signal."""
    b = Bench().start()
    b.write(0x01, mode2)
    b.led(0, 0, 307)
    b.wait(0.1)
    b.pca.set_oe(True, b.t)
    b.wait(0.001)
    b.pulses()
    b.wait(0.1)
    assert not b.pulses()
    assert (b.pca.output.high_since(0) is not None) is high
    b.pca.set_oe(False, b.t)
    b.wait(0.1)
    assert round(307 * COUNT * 1e6, 2) in b.widths_us()


def test_inverted_outputs():
    b = Bench().start()
    b.led(0, 0, 1000)
    b.write(0x01, 0x14)
    b.wait(0.2)
    assert {round((e - s) / COUNT) for s, e in b.pulses()[2:]} == {3096}


def test_external_clock_bit_is_sticky():
    b = Bench()
    b.write(0x00, 0x51)
    b.write(0x00, 0x01)
    assert b.read(0x00) & 0x40
    b.write(0x06, address=0x00)
    assert not b.read(0x00) & 0x40
    b.write(0x00, 0x01)
    b.write(0x00, 0x41)                        # awake: not accepted
    assert not b.read(0x00) & 0x40


def test_addresses():
    b = Bench()
    assert b.bus.scan() == [0x40, 0x70]
    b.write(0x00, 0x10)
    assert b.bus.scan() == [0x40]
    b.write(0x00, 0x18)                        # SUB1 at its default 0xE2
    assert b.bus.scan() == [0x40, 0x71]


def test_wake_up_is_withdrawn_by_the_next_sleep():
    """SLEEP again before the oscillator is stable: no pulse, and the last word wins."""
    b = Bench()
    b.write(0x00, 0x31)
    b.bus.writeto(0x40, NEUTRAL)
    b.write(0x00, 0x21)
    b.write(0x00, 0x31)
    b.wait(0.1)
    assert not b.pulses()
    b.write(0x00, 0x21)
    b.write(0x00, 0x31)
    b.write(0x00, 0x21)
    b.bus.writeto(0x40, NEUTRAL)               # gives up the RESTART of the sleep
    b.wait(0.1)
    assert b.pulses()


def test_upcoming_edges_come_true():
    b = Bench().start()
    b.led(15, 100, 400)
    b.wait(0.05)
    b.pulses(15)
    expected = [t for t, _ in b.pca.output.upcoming(15, b.t + 0.1)]
    b.wait(0.1)
    got = [t for pulse in b.pulses(15) for t in pulse]
    assert got == pytest.approx([t for t in expected if t in got or t <= got[-1]], abs=1e-12)
    assert len(got) >= 8
