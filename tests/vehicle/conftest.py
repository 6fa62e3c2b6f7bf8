"""Settings of this room's property tests."""

from hypothesis import settings

settings.register_profile("no-clock", deadline=None)
settings.load_profile("no-clock")           # a busy machine is no fault of the code
