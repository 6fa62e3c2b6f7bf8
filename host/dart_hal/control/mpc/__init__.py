"""Model predictive contouring control by real-time iteration, on numpy alone.

    model        one stage of the prediction: equations of ``vehicle``, lags as states
    reference    pose of the path at a progress; lateral and longitudinal error and their slopes
    obstacles    obstacles on the path as bounds of the lateral error
    problem      weights and limits: the quadratic programme of one iteration
    admm         its solution
    generated    stages and solution in C, with the extra ``mpc`` and a compiler
    planner      base class of the planners: one plan for each sample, within its time budget
    iteration    contouring control: shift, linearise, solve, step
    disturbance  estimate of the steering's error: offset-free control
    spread       standard deviation of a plan across the path
    driving      common parts of the trackers: model, limits, first state, reason to end a drive
    tracker      a planner as a tracker of ``dart-hal follow``

Pure delays are no states: a plan begins at the time at which its inputs act. Of a plan the first
steering command is sent, and ``v_x`` a little later is the setpoint of the speed loop. The planned
throttle is not sent.

A. Liniger, A. Domahidi, M. Morari, "Optimization-based autonomous racing of 1:43 scale RC cars",
Optimal Control Applications and Methods 36 (2015), for the contouring errors; M. Diehl et al.,
"Real-time optimization and nonlinear model predictive control of processes governed by
differential-algebraic equations", J. Process Control 12 (2002), for the iteration.
"""
