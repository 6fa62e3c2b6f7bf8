"""Grades: how probable an effect is, by data left out of the fit, and whether its size is constant.

``secants`` linearises around the last fit, ``bag`` draws units and judges by the others, ``accept``
applies the gates, ``constancy`` tests the size against time, place and state, ``alike`` tells
recordings of two cars apart, ``family`` has other ways to write a force.
"""
