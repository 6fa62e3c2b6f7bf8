"""Room of the experiments: a sub-model's test, driven on any car, recorded and fitted."""
