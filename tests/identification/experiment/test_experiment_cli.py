"""``dart-hal experiment`` as it is typed."""

from __future__ import annotations

import json

import pytest

from dart_hal.cli.main import main

SIM = ["--url", "sim://?seed=3&nano=mock"]


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """``run(*args)`` -> (exit status, standard output, standard error), in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*args: str):
        with pytest.raises(SystemExit) as ended:
            main(["experiment", *args])
        out = capsys.readouterr()
        return ended.value.code, out.out, out.err
    return call


@pytest.mark.slow
def test_json_is_one_object_with_fit_recording_and_values_before(run, tmp_path):
    code, out, err = run("tyres", *SIM, "--space", "5", "--out", "one.mcap", "--json",
                         "--plot", "one.png")
    result = json.loads(out)
    assert code == 0
    assert result["experiment"] == "tyres"
    assert result["stopped"] is None
    assert result["understeer"]["gradient"]["unit"] == "rad s2/m"
    assert result["base"]["tyres"]["front_D"] == pytest.approx(2.9752, abs=1e-3)
    assert "motion capture" in " ".join(result["notes"])
    assert (tmp_path / "one.mcap").stat().st_size > 10_000
    assert (tmp_path / "one.png").stat().st_size > 10_000
    assert "5 m x 5 m" in err
    assert "behind the rear axle" in err
    assert "picture: one.png" in err
    # one understeer gradient in one unit: that of the ramps
    assert "understeer gradient" not in " ".join(result["fits"]["tyres"]["notes"])


@pytest.mark.slow
def test_too_small_a_floor_records_nothing(run, tmp_path):
    code, out, _ = run("motor", *SIM, "--space", "4x3", "--out", "one.mcap", "--json")
    assert code == 2
    assert json.loads(out)["error"]["code"] == "D-EXP-01"
    assert not (tmp_path / "one.mcap").exists()


@pytest.mark.parametrize("args", [
    ("battery", *SIM), ("friction", *SIM, "--space", "wide"), ("friction", *SIM, "--speed", "nan"),
    ("friction", *SIM, "--mass", "1670"), ("friction", "--url", "sim://?seed=x")])
def test_senseless_arguments_are_refused(run, args, tmp_path):
    code, out, _ = run(*args, "--json")
    assert code == 2
    assert "error" in json.loads(out)
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.slow
def test_no_fit_drives_and_records_only_and_a_recording_cannot_be_driven(run):
    code, out, _ = run("tyres", *SIM, "--space", "5", "--out", "one.mcap", "--no-fit", "--json")
    assert code == 0
    assert "fits" not in json.loads(out)
    code, out, _ = run("tyres", "--url", "replay://one.mcap", "--space", "5", "--json")
    assert code == 2
    assert "identify" in json.loads(out)["error"]["try"]


@pytest.mark.slow
def test_out_model_holds_the_fit_and_the_mass_it_hangs_on(run, tmp_path):
    from dart_hal.core.config import load_model
    from dart_hal.core.config.model import plain
    url = "sim://?seed=4&nano=mock&physics=kinematic&tick=10"
    code, out, _ = run("friction", "--url", url, "--space", "9x3", "--out", "one.mcap", "--json",
                       "--out-model", "model.toml")
    result = json.loads(out)
    assert code == 0
    assert result["model"] == "model.toml"
    model = load_model(tmp_path / "model.toml")
    assert plain(model.friction["a"]) == result["fits"]["friction"]["parameters"]["a"]["value"]
    assert plain(model.body["mass"]) == result["mass_kg"]["value"]
    assert plain(model.motor["d"]) == pytest.approx(28.8878, abs=1e-3)  # not this experiment's


@pytest.mark.slow
def test_nothing_is_reported_so_no_model_is_written(run, tmp_path):
    code, out, err = run("tyres", *SIM, "--space", "5", "--out", "one.mcap", "--json",
                         "--out-model", "model.toml")
    assert code == 0
    assert json.loads(out)["model"] is None
    assert not (tmp_path / "model.toml").exists()
    assert "not written: tyres" in err


@pytest.mark.long
def test_a_floor_too_short_to_coast_is_status_1(run):
    code, out, err = run("friction", "--url", "sim://?seed=7&nano=mock", "--space", "4x2.5",
                         "--out", "one.mcap")
    assert code == 1
    assert "at least 3 s needed" in out + err
    assert "next:" not in out + err


@pytest.mark.long
def test_what_to_type_next_and_a_table_whose_columns_have_names(run):
    code, out, err = run("friction", "--url", "sim://?seed=4&nano=mock&physics=kinematic&tick=10",
                         "--space", "9x3", "--out", "one.mcap")
    assert code == 0
    assert "next: dart-hal identify friction one.mcap --out model.toml" in err
    head = next(line for line in out.splitlines() if "before" in line)
    assert head.split() == ["value", "before", "identifiable"]


class NotSim:
    """The backend of sim:// under another scheme: the questions for a real car."""

    def __init__(self, monkeypatch):
        import dart_lab.cli.experiment as verb
        from dart_hal.core.url import Url
        from dart_hal.devices.links.base import open_backend

        def opened(text: str):
            backend = open_backend("sim://?seed=3&nano=mock")
            backend.url = Url("serial:///dev/none", "serial", "/dev/none")
            backend.workshop = None
            return backend
        monkeypatch.setattr(verb, "open_backend", opened)


@pytest.mark.slow
def test_a_real_car_requires_floor_and_agreement(run, monkeypatch, tmp_path):
    NotSim(monkeypatch)
    code, out, _ = run("tyres", "--url", "serial:///dev/none", "--json")
    assert code == 2
    assert "--space" in json.loads(out)["error"]["try"]
    code, out, err = run("tyres", "--url", "serial:///dev/none", "--space", "5", "--json",
                         "--out", "one.mcap")
    assert code == 2
    assert "not confirmed" in json.loads(out)["error"]["what"]
    assert "free floor" in err  # what was going to happen has been printed
    code, out, _ = run("tyres", "--url", "serial:///dev/none", "--space", "5", "--json", "--yes",
                       "--mass", "1.65", "--out", "two.mcap")
    assert code == 0  # that car is a simulation after all
    assert json.loads(out)["mass_kg"] == {"value": 1.65, "std": 0.002}


@pytest.mark.slow
def test_ctrl_c_keeps_the_recording_and_names_the_place(run, monkeypatch, tmp_path):
    import dart_lab.identification.experiment.runner as runner
    from dart_lab.identification.experiment.rehearsal import PaperCar

    def broken(self, *args):
        if len(self._frames) > 300 and not isinstance(self._car, PaperCar):  # not the rehearsal
            raise KeyboardInterrupt
        return original(self, *args)
    original = runner.ExperimentRunner._steering
    monkeypatch.setattr(runner.ExperimentRunner, "_steering", broken)
    code, _, err = run("tyres", *SIM, "--space", "5", "--out", "one.mcap")
    assert code == 130
    assert "one.mcap" in err
    assert (tmp_path / "one.mcap").stat().st_size > 5_000


@pytest.mark.slow
def test_a_probe_is_driven_and_recorded_but_not_fitted(run, tmp_path):
    code, out, _ = run("rollouts", *SIM, "--space", "6", "--out", "one.mcap", "--json")
    result = json.loads(out)
    assert code == 0
    assert result["stopped"] is None
    assert "fits" not in result
    assert (tmp_path / "one.mcap").stat().st_size > 10_000
    code, out, _ = run("rollouts", *SIM, "--out", "two.mcap", "--out-model", "m.toml", "--json")
    assert code == 2
    assert "fits no sub-model" in json.loads(out)["error"]["what"]
    assert not (tmp_path / "two.mcap").exists()
