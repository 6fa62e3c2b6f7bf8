"""What the words of the page mean, and how the figures were come by, in short."""

from __future__ import annotations

from dart_hal.report.html import Html, el

TERMS = {
    "cause, effect": "One physical hypothesis of a fixed catalogue (docs/reference/effects.md): an "
                     "equation that enters at one place of the car, with parameters that change "
                     "nothing at their null value.",
    "residual, error": "What the model says minus what was measured. Motion: the model starts at "
                       "the measured state and rolls out with the logged commands alone. Sensors: "
                       "what the sensor should read during the measured motion, minus what it "
                       "read.",
    "training and test recordings": "Parameters and causes come from the training recordings. "
                                    "Every gain, every error table and every residual picture of "
                                    "this page is from the test recordings.",
    "refitted": "Before anything is called missing, the model's own parameters are estimated anew "
                "on the training recordings, and they move along while a cause is tested. A cause "
                "is what remains after that.",
    "loss": "Squared residuals in standard deviations, growing only linearly for wild ones, each "
            "counted for as many independent values as it is worth. A drop of 1 is one squared "
            "standard deviation of one independent residual.",
    "p-value": "How often the best effect of the whole catalogue would lower the loss as much if "
               "nothing were there, by the disturbance of these very recordings: each effect is "
               "measured by what it gains itself in such data, and all of them are one family.",
    "parameters that were wrong": "Groups of parameters that have changed rather than not, and "
                                  "whose old values cost unseen recordings 3 %: a posterior "
                                  "over sets of groups, each set fitted anew, averaged over draws "
                                  "of recordings. In derived quantities that can be checked on "
                                  "the car.",
    "probability": "Of a name: recordings (or stretches of one) are drawn at random, the size of "
                   "the effect is fitted to those drawn, and the others judge. The share of draws "
                   "in which they are predicted better with it than without. Below 0.8 a name is "
                   "possible and not shown.",
    "constant": "Whether one size of the cause fits throughout: along time, place, speed, angle, "
                "throttle and accelerations, against the same with the signs of blocks turned.",
    "gain": "1 - RMSE after / RMSE before on the test recordings, cause by cause in the order in "
            "which they were named. Its 95 % interval is a bootstrap over blocks, since samples in "
            "a row are not independent.",
    "+-": "One standard error of a parameter; whiskers of the pictures are two standard errors of "
          "a mean, from stretches of 2 s.",
    "cannot be told from": "Effects that would explain these data about as well. The named "
                           "experiment separates them.",
    "CTRV": "Holding speed and yaw rate as they are at the start (constant turn rate and "
            "velocity): what one gets without any model.",
    "not explained": "A flexible regression still predicts the last residual on stretches that it "
                     "was not fitted to. So there is structure, and no effect of the catalogue has "
                     "its shape.",
    "withdrawn": "Named at first, then taken back: superfluous beside a later cause, or the "
                 "structure was as large after it as before.",
    "revolution angle": "Of the gear that carries the encoder's marks, 0 to 1 turn.",
    "in the sense of the turn": "With its sign turned over in right turns, so that left and right "
                                "add up instead of cancelling.",
}


def glossary() -> Html:
    """The list."""
    return el("dl", *(piece for term, meaning in TERMS.items()
                      for piece in (el("dt", term), el("dd", meaning))))
