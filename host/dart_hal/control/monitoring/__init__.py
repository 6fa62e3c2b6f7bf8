"""Persistent monitoring: robots on one Lissajous curve, spread by the time-inverted Kuramoto law.

    kuramoto     phases of a ring that repel each other; which spreads are stable
    lissajous    the curve: positions, curvature, smallest radius
    formation    N robots spread over it: sensing radius, distances, the bound of detection
    detection    when a target is detected, and which share of the area is observed
    drivable     whether a car can drive it, how fast, and which curve it could drive
    course       arc length and parameter of the curve, from a position and back
    peer         phase of another car by its messages, extrapolated
    guard        stop rather than come too near to another car
    monitor      one car of the team: from poses and messages to steering and speed

M. Boldrer, L. Lyons, L. Palopoli, D. Fontanelli, L. Ferranti, "Time-inverted Kuramoto model meets
Lissajous curves: multi-robot persistent monitoring and target detection", IEEE RA-L 8(1), 2022.
"""
