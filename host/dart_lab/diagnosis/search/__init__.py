"""Search: which effect of the catalogue explains the residuals.

``forward`` repeats rounds until nothing is accepted. In a round ``scan`` tries every effect alone
(``size_search`` chooses the sizes), ``significance`` draws the threshold of the null distribution,
``selection`` accepts one, ``pairs`` finds two effects that hide each other, ``confounders`` lists
what the data cannot distinguish. ``fit`` minimises the objective.
"""
