"""Forward search: which effects of the catalogue explain the residuals.

``forward`` repeats rounds until no effect is accepted. One round:

1. ``scan`` tries every effect alone; ``size_search`` chooses the sizes.
2. ``significance`` simulates the null distribution, which gives the threshold of the gain.
3. ``selection`` accepts one effect.
4. ``confounders`` lists the effects that the data cannot distinguish from it.

``fit`` minimises the objective.
"""
