"""Parameter findings: which numbers of the model were wrong, how far, and what each costs.

``groups`` are parameters of one part of the car, ``sets`` the probability of each set of groups,
``unseen`` the errors on test recordings, ``cost`` their ratio, ``claims`` the findings.
"""
