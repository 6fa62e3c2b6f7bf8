"""Identification: parameters of the vehicle model from recordings, and how well it predicts.

``prediction`` is the forward model of a recorded drive, ``submodels`` fits part by part,
``shooting`` all parts together, ``evaluation`` measures open-loop errors, ``experiment`` plans and
drives test manoeuvres, ``paper`` repeats the fits of the paper. ``outcome.identify`` is the
entrance.
"""
