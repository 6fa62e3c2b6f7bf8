"""A search is sent to other processes without its callbacks and its sweeps."""

from __future__ import annotations

import pickle

from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings


def test_callbacks_and_sweeps_are_not_pickled():
    search = ForwardSearch(None, None, Settings(), lambda share, name: None, lambda: None)
    search._sweeps = {"grip": lambda: None}
    copy = pickle.loads(pickle.dumps(search))
    assert vars(copy).keys() == vars(search).keys()
    assert [name for name, value in vars(copy).items() if callable(value)] == []
    assert not copy._sweeps
