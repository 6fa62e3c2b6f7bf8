"""What parameters on the bound of their stated errors leave over is no cause."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.recording.dart import RUN
from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.grade.accept import Acceptance, accept_effects
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.identification.evidence.space import Space
from tests.diagnosis.onboard_files import evidence, record_onboard

WORN = replace(PAPER, tyres=replace(PAPER.tyres, front_D=0.9 * PAPER.tyres.front_D))
KNOWN = {"tyres.front_D": 0.005 * PAPER.tyres.front_D}
"""A stated error that is too small: the tyre is twenty of them off."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A drive of a car with a worn tyre, as a run of our own."""
    of_drive = evidence(record_onboard(tmp_path_factory.mktemp("worn"), WORN, 23, 40.0))
    return type(of_drive)([replace(d, recording=replace(d.recording, schema=RUN))
                           for d in of_drive.drives], PAPER.body.l_r)


def find_causes(of_drive, *only):
    """(effects that the data left out support, front_D over that of the model)."""
    search = ForwardSearch(of_drive, PAPER, Settings(free=tuple(KNOWN), known=KNOWN, names=only))
    found = search.run()
    how = Acceptance(search, of_drive, USUAL, 0, lambda fit, name: "",
                     lambda fit, without: dict.fromkeys(without, (1.1, 1.05, 1.2)))
    accepted = accept_effects(how, found.points, found.point, found.noise,
                              [n.effect for n in found.accepted])
    return list(accepted.names), found.point.vehicle.tyres.front_D / PAPER.tyres.front_D


@pytest.mark.slow
def test_an_impostor_goes_once_the_tyre_may_be_what_it_is(run, monkeypatch):
    """Control: as long as the tyre is held, something else gets the name."""
    names, tyre = find_causes(run, "steering_gain")
    assert names == []
    assert tyre < 0.96  # bound 0.9825; the prior still pulls
    monkeypatch.setattr(Space, "names_at_bound", lambda *_: ())
    assert find_causes(run, "steering_gain")[0] == ["steering_gain"]


@pytest.mark.slow
def test_where_nothing_is_named_the_tyre_is_let_go_as_well(run):
    """Else what the bound leaves over would be unexplained structure."""
    names, tyre = find_causes(run, "gyro_bias")
    assert names == []
    assert tyre < 0.96


@pytest.mark.slow
def test_a_cause_that_takes_the_strain_away_keeps_its_name(run):
    """The tyre is believed to be good to half a per cent, so it is the grip that is less."""
    assert find_causes(run, "front_grip") == (["front_grip"], pytest.approx(1.0, abs=0.017))
