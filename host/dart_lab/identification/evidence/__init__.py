"""Evidence: residuals of recordings, and their scale, correlation and weights.

``drive`` and ``onboard`` prepare windows of a recording with and without motion capture,
``residuals`` predicts them, ``readings`` predicts sensor readings, ``noise`` estimates scale and
correlation of residuals, ``space`` defines the coordinates of a fit.
"""
