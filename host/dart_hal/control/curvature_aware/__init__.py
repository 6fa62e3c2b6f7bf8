"""Curvature-aware model predictive contouring control in two layers, on numpy alone.

    curvature    k(s) of the path ahead, by a kernel over 41 points
    progress     motion of a point with a given speed, by two progress laws: MPCC and CA-MPCC
    programme    least squares and rows through the stages: the quadratic programme of a step
    generator    high level: the path of the next 1.5 s within the lane
    follower     low level: throttle and steering that follow it
    two_layers   both for one sample, within its time: a planner as those of ``control.mpc``

L. Lyons, L. Ferranti, "Curvature-aware model predictive contouring control" (2023); problem and
weights as published, the solver is that of ``control.mpc``.
"""
