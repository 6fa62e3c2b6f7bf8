"""Evidence: residuals of recordings, and how much each residual counts.

``drive`` and ``onboard`` prepare windows of a recording with and without motion capture,
``residuals`` predicts them, ``readings`` predicts what sensors read, ``noise`` measures the size
and correlation of residuals, ``space`` has the parameters that a fit may move.
"""
