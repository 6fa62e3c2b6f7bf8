"""Curvature-aware model predictive contouring control in two layers, on numpy alone.

    curvature    k(s) of the way ahead, by a kernel over 41 points
    progress     the point that goes on by a speed, by two progress laws: MPCC and CA-MPCC
    programme    least squares and rows through the stages: the quadratic programme of a step
    generator    high level: the path of the next 1.5 s within the lane
    follower     low level: throttle and steering that keep the car on it
    two_layers   both for one sample, within its time: a planner as ``control.mpc`` has them

L. Lyons, L. Ferranti, "Curvature-aware model predictive contouring control" (2023); problem and
weights as they published them, the solver is that of ``control.mpc``.
"""
