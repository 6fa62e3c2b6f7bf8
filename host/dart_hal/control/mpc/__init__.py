"""Model predictive contouring control by real-time iteration, on numpy alone.

    model        one stage of the car: equations of ``vehicle``, delays and lags as states
    reference    where the path is at a progress: errors across it and along it, and their slopes
    obstacles    what lies on the path, as bounds of the error across
    problem      weights and limits: the quadratic programme of one iteration
    admm         its solution
    generated    stages and solution in C, where the extra ``mpc`` and a compiler are there
    planner      a plan for each sample, within its time: what every planner is
    iteration    shift, linearise, solve, step: contouring control
    disturbance  what the steering does beside the model, learnt: offset-free control
    tracker      a planner as a tracker of ``dart-hal follow``

A. Liniger, A. Domahidi, M. Morari, "Optimization-based autonomous racing of 1:43 scale RC cars",
Optimal Control Applications and Methods 36 (2015), for the contouring errors; M. Diehl et al.,
"Real-time optimization and nonlinear model predictive control of processes governed by
differential-algebraic equations", J. Process Control 12 (2002), for the iteration.
"""
