"""Verbs of the laboratory: one file per verb, loaded when it is called."""

VERBS = {
    "demo": "calibrate, drive and diagnose an emulated car, and compare with ground truth",
    "identify": "fit the sub-models of the car to recordings; writes model.toml",
    "evaluate": "open-loop prediction errors of a model on recordings, against constant velocity",
    "diagnose": "find what a model gets wrong on recordings, name the cause, extend the model",
    "experiment": "drive the test manoeuvres for a sub-model, record them, fit it",
    "report": "one page for a car: calibrations, last runs, what changed",
    "compare": "put two runs side by side, and say when they part",
    "bridge": "let ROS drive a car by the topics of DART's own software",
    "view": "live page in a browser: watch a car, drive it, stop it; or look at a recording",
    "sim": "serve the simulated car as a serial port, or reveal its true parameters",
    "data": "check, repair or download recordings",
    "wire": "print the frame table; regenerate the files made from the specification",
}
