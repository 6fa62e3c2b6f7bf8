"""Persistent monitoring: robots on one Lissajous curve, spread by the time-inverted Kuramoto law.

    kuramoto     phases of a ring that repel each other; which spread is stable
    lissajous    the curve: places, bends, the tightest of them
    formation    N robots spread over it: sensing radius, distances, the bound of detection
    detection    who sees a target, and what share of the area is seen
    drivable     whether a car can drive it, how fast, and what to type where it cannot
    course       arc length and parameter of the curve, from a place and back
    peer         what another car told of its phase, held and extrapolated
    guard        stands rather than come too near, by where the others may be
    monitor      one car of the team: from poses and messages to steering and speed

M. Boldrer, L. Lyons, L. Palopoli, D. Fontanelli, L. Ferranti, "Time-inverted Kuramoto model meets
Lissajous curves: multi-robot persistent monitoring and target detection", IEEE RA-L 8(1), 2022.
"""
