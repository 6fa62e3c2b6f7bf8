"""Room of the claims: which parameters of the model were wrong, how far, what each costs."""
