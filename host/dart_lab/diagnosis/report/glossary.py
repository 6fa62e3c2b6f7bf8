"""Glossary of the page: terms, and how the figures are computed."""

from __future__ import annotations

from dart_lab.report.html import Html, el

TERMS = {
    "cause, effect": "A physical hypothesis of a fixed catalogue (docs/reference/effects.md): an "
                     "equation that enters at one place of the car, with parameters that change "
                     "nothing at their null value.",
    "error, residual": "Prediction minus measurement. Motion: the model starts at the measured "
                       "state and rolls out with the logged commands alone. Sensors: what the "
                       "sensor should read during the measured motion, minus what it read.",
    "training and test recordings": "Parameters and causes come from the training recordings. "
                                    "Every error, gain and residual picture of this page is from "
                                    "the test recordings.",
    "parameters refitted": "Before anything is missing, the model's own parameters are estimated "
                           "again on the training recordings. They also move while a cause is "
                           "tested.",
    "constant velocity": "Speed and yaw rate stay as they are at the start (CTRV): a prediction "
                         "without any model.",
    "probability": "Of a cause: recordings (or stretches of one) are drawn at random, the size of "
                   "the effect is fitted to them, and the others are predicted. The share of draws "
                   "in which the prediction is better with it. From 0.97 on it is accepted "
                   "unless the test recordings contradict, from 0.8 on if they confirm it.",
    "parameters that were wrong": "Groups of parameters that changed rather than not, and whose "
                                  "old values raise the errors of test recordings by 3 %: a "
                                  "posterior over sets of groups, each fitted again, averaged over "
                                  "draws of recordings.",
    "small correction": "A parameter that changed by less than 2 % or by less than two standard "
                        "errors, and by which the motion error falls by less than a tenth.",
    "substitute": "A cause whose size is not constant: something else lies behind it.",
    "size": "Of a cause in a recording, relative to the one that fits all. It is constant if it "
            "does not change along time, place, speed, angle, throttle and accelerations more than "
            "with the signs of blocks turned.",
    "gain": "1 - RMSE after / RMSE before on the test recordings, in the order in which causes "
            "were found. Its 95 % interval is a bootstrap over blocks.",
    "loss": "Squared residuals in standard deviations, linear for large ones, each counted for as "
            "many independent values as it represents. A reduction of 1 is one squared standard "
            "deviation of one independent residual. Alone: before any cause is in the model. "
            "Added: with the causes in it that were found before.",
    "p-value": "How often the best effect of the whole catalogue would reduce the loss as much if "
               "nothing were missing, with the disturbances of these recordings.",
    "+-": "One standard error of a parameter; whiskers are two standard errors of a mean, from "
          "stretches of 2 s.",
    "not explained": "A flexible regression still predicts the last residual on stretches that it "
                     "was not fitted to, and no effect of the catalogue has its shape.",
    "withdrawn": "Found at first, then dropped: superfluous with a later cause, or the structure "
                 "was as large after it as before.",
    "in the sense of the turn": "With the sign reversed in right turns, so that left and right add "
                                "up instead of cancelling.",
    "angle of the encoder's gear": "The gear that carries the encoder's marks, 0 to 1 turn.",
}


def glossary() -> Html:
    """List the terms with their meaning."""
    return el("dl", *(piece for term, meaning in TERMS.items()
                      for piece in (el("dt", term), el("dd", meaning))))
