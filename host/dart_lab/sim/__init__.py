"""The virtual world: a car at the pins, for ``sim://``.

Nothing outside this room may learn what the simulated car really is; see
``dart_lab.sim.truth``.
"""
