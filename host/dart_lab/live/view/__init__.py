"""A live page of a car: any visitor can watch and stop it, one can drive it."""
