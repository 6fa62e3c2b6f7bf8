"""Hooks for uncaught exceptions: the cars are stopped first, and each hook is called once."""

from __future__ import annotations

import sys

import pytest

from dart_hal.car import exit_signals


@pytest.fixture
def hooks(monkeypatch):
    """The names of what was called, with the hook of a program that was there before."""
    called = []
    monkeypatch.setattr(exit_signals, "_stops", set())
    monkeypatch.setattr(exit_signals, "_next_hook", None)
    monkeypatch.setattr(sys, "excepthook", lambda *error: called.append("program"))
    return called


def test_the_cars_are_stopped_and_the_program_reports_also_if_a_stop_fails(hooks):
    def fail(reason):
        hooks.append(reason)
        raise OSError("no bus")

    exit_signals.stop_at_end(fail)
    with pytest.raises(OSError, match="no bus"):
        sys.excepthook(ValueError, ValueError(), None)
    assert hooks == ["the program ended by ValueError", "program"]


def test_a_hook_around_this_one_is_no_endless_loop(hooks, monkeypatch):
    """A program wraps the hook, then opens another car."""
    exit_signals.stop_at_end(lambda reason: hooks.append("car"))
    ours = sys.excepthook
    monkeypatch.setattr(sys, "excepthook", lambda *error: (hooks.append("wrapper"), ours(*error)))
    exit_signals.stop_at_end(hooks.append)
    exit_signals.forget_stop(hooks.append)
    sys.excepthook(ValueError, ValueError(), None)
    assert hooks == ["wrapper", "car", "program"]
