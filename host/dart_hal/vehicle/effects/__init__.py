"""Catalogue of physical effects that the base models lack, one file per cause."""
