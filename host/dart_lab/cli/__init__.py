"""Verbs of the workstation: one file per verb, loaded when it is called."""

# One line of help for each verb. The entry point dart_hal.verbs names this mapping.
VERBS = {
    "accept": "first check of a new car: guided measurements, each with the emulator's prediction",
    "demo": "calibrate, drive and diagnose an emulated car, and compare with ground truth",
    "identify": "fit the sub-models of the car to recordings; writes model.toml",
    "evaluate": "open-loop prediction errors of a model on recordings, against constant velocity",
    "study": "check, fit, validate and diagnose recordings of a car, stage by stage",
    "diagnose": "find what a model gets wrong on recordings, name the cause, extend the model",
    "experiment": "drive the test manoeuvres for a sub-model, record them, fit it",
    "report": "write one page about a car: calibrations, last runs, changes",
    "compare": "compare two runs, and find the time at which they begin to differ",
    "bridge": "let ROS drive a car by the topics of DART's own software",
    "view": "live page in a browser: watch a car, drive it, stop it; or play a recording",
    "sim": "serve the simulated car as a serial port, or print its true parameters",
    "class": "set up hidden cars with tasks for a class of students, and mark them",
    "data": "import, check, repair or download recordings",
    "wire": "print the frame table; regenerate the files made from the specification",
}
# Group of each verb in dart-hal --help.
VERB_GROUPS = {
    "start": ("demo", "accept"),
    "measure": ("experiment",),
    "model": ("study", "identify", "evaluate", "diagnose"),
    "look": ("view", "report", "compare"),
    "data": ("data",),
    "service": ("bridge", "sim", "class", "wire"),
}
