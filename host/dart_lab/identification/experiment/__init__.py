"""Experiments: manoeuvres for each sub-model, planned for a floor, driven, recorded and fitted."""
