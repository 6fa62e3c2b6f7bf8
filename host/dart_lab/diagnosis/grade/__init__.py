"""Grades: how probable an effect is by held-out data, and whether its size is constant.

``secants`` linearises around the last fit, ``bag`` draws units and judges by the others, ``accept``
applies the gates, ``constancy`` tests the size against time, place and state, ``alike`` finds
recordings of two cars, ``family`` has other ways to write a force.
"""
