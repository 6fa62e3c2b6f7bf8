"""DART-Lab: simulate, identify, evaluate and diagnose small cars, on a workstation."""
