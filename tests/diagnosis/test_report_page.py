"""The page of a diagnosis: it states all that the JSON states, needs nothing from outside,
draws."""

from __future__ import annotations

import base64
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from dart_hal.core.plain_json import plain
from dart_lab.diagnosis.error_summaries import ErrorMoment, Outliers
from dart_lab.diagnosis.report import page, write_page
from dart_lab.diagnosis.report.along import ResidualRows
from dart_lab.diagnosis.report.explain import describe_cause
from dart_lab.diagnosis.report.patterns import Pattern
from dart_lab.diagnosis.report.summary import remainder
from dart_lab.diagnosis.report.words import quantity, removes
from dart_lab.diagnosis.result import VERDICTS, ErrorReduction, ParameterEstimate, Possible
from dart_lab.diagnosis.suggest.result import Pair, Suggestion
from dart_lab.report.numbers import percent, significant
from tests.diagnosis import made_by_hand as made
from tests.pages import foreign, strip_data

COMMAND = "dart-hal diagnose --model '<paper>' --train a.csv"


class Reader(HTMLParser):
    """Text, links and whether every element that is opened is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.names: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        if tag not in ("meta", "br", "hr"):
            self.open.append(tag)
        for name, value in attrs:
            if name in ("href", "src"):
                self.links.append(value)
            if name == "id":
                self.ids.add(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())


def read(d, **options):
    return Reader(page(d, command=COMMAND, **options))


@pytest.fixture(scope="module")
def whole():
    d = made.diagnosis()
    return d, page(d, command=COMMAND), read(d)


def typeset(words):
    return words.replace(" +- ", " ± ").replace(" -> ", " → ")


def load_embedded(reader):
    link = next(x for x in reader.links if x.startswith("data:application/json"))
    return json.loads(base64.b64decode(link.partition("base64,")[2]))


@pytest.mark.slow
def test_every_sentence_and_number_of_a_cause_is_there(whole):
    d, _, reader = whole
    for i, cause in enumerate(d.causes):
        for words in describe_cause(d, i).values():
            assert typeset(words) in reader.text
        for number in cause.parameters.values():
            assert quantity(number).replace(" +- ", " ± ") in reader.text
        for fact in (*cause.evidence, cause.experiment[1:], *cause.cannot_be_told_from,
                     cause.gain.measure, percent(cause.gain.test), percent(cause.gain.train),
                     significant(cause.loss, 4)):
            assert fact in reader.text


@pytest.mark.slow
def test_what_was_rejected_moved_left_and_used_is_there(whole):
    d, _, reader = whole
    for c in d.considered:
        assert c.effect in reader.text
        assert c.why_not in reader.text
        assert significant(c.loss) in reader.text
    for name, m in d.refitted.items():
        assert name in reader.text
        after = quantity(ParameterEstimate(m.after, m.std, m.unit))
        assert after.replace(" +- ", " ± ") in reader.text
        assert m.doubt in reader.text
    for name, use in d.files.items():
        assert name in reader.text
        assert use["sha256"] in reader.text
        for why in use["why"]:
            assert why in reader.text
    for u in d.unexplained:
        for words in Pattern(d, u, ResidualRows(d.evidence, d.extended)).sentences().values():
            assert words in reader.text
    for note in (*d.notes, COMMAND):
        assert note in reader.text


@pytest.mark.slow
def test_every_error_of_every_step_and_of_ctrv_is_there(whole):
    d, _, reader = whole
    for of in (*(s.horizons for s in d.stages), d.ctrv):
        for horizon in ("0.5", "1.0", "2.0"):
            for channel in ("vx", "vy", "yaw_rate", "position", "yaw_deg"):
                rmse, median = (of[horizon][kind][channel] for kind in ("pooled", "median"))
                assert f"{significant(rmse)} ({significant(median)})" in reader.text


@pytest.mark.slow
def test_the_embedded_json_is_the_answer(whole):
    d, _, reader = whole
    assert load_embedded(reader) == json.loads(json.dumps(plain(d.to_json())))
    assert load_embedded(read(d, answer={"verdict": math.nan})) == {"verdict": None}


@pytest.mark.parametrize("causes", [0, 1, 2])
@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.slow_except("unexplained-0")
def test_every_verdict_gives_a_sound_page(verdict, causes):
    d = made.diagnosis(verdict, causes, verdict in ("partly_explained", "unexplained"))
    text = page(d, command=COMMAND)
    reader = Reader(text)
    assert not reader.open
    assert "section" in reader.names
    assert not foreign(text)
    assert not re.search(r"\b(nan|NaN|inf|Infinity|None)\b", strip_data(text))
    inside = [x for x in reader.links if not x.startswith("data:")]
    assert all(x.startswith("#") and x[1:] in reader.ids for x in inside)
    assert load_embedded(reader)["verdict"] == verdict


@pytest.mark.slow
def test_names_are_escaped(whole):
    _, text, reader = whole
    assert "<paper>" not in text
    assert "<b>" not in text
    assert "<evidence>" in reader.text


@pytest.mark.slow
def test_a_cause_is_drawn_before_and_after(whole):
    _, text, _ = whole
    assert text.count("<svg") > 10
    for mark in ("before mark", "after mark", "before line", "after line", "after bar",
                 "other bar", "refit bar"):
        assert mark in text


@pytest.mark.slow
def test_each_cause_is_shown_along_a_variable_in_which_it_acts(whole):
    _, _, reader = whole
    assert re.search(r"Yaw rate error after [\d.]+ s, along steering rate", reader.text)
    assert re.search(r"Gyro error, along yaw rate", reader.text)


@pytest.mark.slow
def test_the_same_diagnosis_gives_the_same_page(whole):
    d, text, _ = whole
    assert page(d, command=COMMAND) == text


def test_without_numbers_it_states_so_instead_of_drawing(tmp_path):
    d = made.diagnosis("nothing_wrong", 0, False)
    nothing = replace(d, stages=tuple(replace(s, horizons={}) for s in d.stages), ctrv={},
                      considered=(), refitted={}, files={}, paths=())
    path = write_page(nothing, tmp_path / "new" / "report.html")
    reader = Reader(path.read_text(encoding="utf-8"))
    assert "No prediction could be judged" in reader.text
    assert "No effect was tried" in reader.text
    assert "svg" not in reader.names


@pytest.mark.slow
def test_suggestions_are_there_when_they_were_requested():
    d = made.diagnosis()
    drive = Suggestion("steering_lag", ("yaw_inertia",), "steps", "steps at two speeds",
                       ("dart-hal experiment steps --out <a>.mcap",), 40.0, "8", "sensors", True,
                       (Pair("steering_lag", "yaw_inertia", 1.25, 7.5, 0.98),), {}, "look at it",
                       ())
    reader = read(d, suggestions=[drive])
    for words in (drive.sentence(), "--out <a>.mcap", "1.25", "7.5", "98 %", "look at it"):
        assert words in reader.text
    assert "Nothing to suggest" in read(d, suggestions=[]).text
    assert "drive next" not in read(d).text


def test_a_gain_that_is_none_is_called_so():
    worse = ErrorReduction("gyro", 0.18, -0.02, -0.06, -0.01, "residual")
    assert removes(worse).startswith("raises the gyro error by 2 % [1 %, 6 %]")
    perhaps = ErrorReduction("vx", 0.18, 0.01, -0.02, 0.05, "rollout")
    assert removes(perhaps).endswith("which may be chance")
    reduction = ErrorReduction("vx", 0.18, 0.24, 0.13, 0.33, "rollout")
    assert removes(reduction) == "removes 24 % [13 %, 33 %] of the speed error on the test " \
                            "recordings"


@pytest.mark.slow
def test_a_cause_whose_gain_may_be_nothing_is_not_marked_as_good():
    d = made.diagnosis(causes=1)
    assert 'class="cause found"' in page(d)
    cause = replace(d.causes[0], gain=replace(d.causes[0].gain, low=-0.01))
    assert 'class="cause found"' not in page(replace(d, causes=(cause,), unexplained=()))


@pytest.mark.slow
def test_errors_that_are_not_known_are_a_dash():
    d = made.diagnosis()
    first = d.stages[0]
    horizons = json.loads(json.dumps(first.horizons))
    horizons["1.0"]["pooled"]["vx"] = None
    changed = replace(d, stages=(replace(first, horizons=horizons), *d.stages[1:]))
    assert "nan" not in page(changed).lower().replace("nance", "").split("base64,")[0]


MOMENTS = (Outliers("v_x", 2.6, (ErrorMoment("a.csv", 53.2, 0.32, 11.8, 1.4, 0.3, 0.0),)),)
POSSIBLE = (Possible("mass", "is heavier or lighter than the model", 0.7, 30.0, "too rare"),)
CHANGING = tuple(replace(c, constancy=made.CHANGES) for c in made.diagnosis(causes=1).causes)
WORSE = tuple(replace(c, gain=replace(c.gain, low=-0.3, high=-0.1))
              for c in made.diagnosis(causes=1).causes)
REMAINDERS = [
    ("unexplained", 0, True, {}, "variance of its error follows speed"),
    ("unexplained", 0, False, {"outliers": MOMENTS}, "53.2"),
    ("unexplained", 0, False, {"possible": POSSIBLE}, "the car is heavier or lighter"),
    ("partly_explained", 1, False, {"causes": CHANGING},
     "The size of steering_lag is not constant"),
    ("partly_explained", 1, False, {"causes": WORSE},
     "With steering_lag test recordings are predicted worse")]


@pytest.mark.parametrize(("verdict", "causes", "structure", "changes", "words"), REMAINDERS)
@pytest.mark.slow_except("unexplained-0-False-changes1*")
def test_page_shows_what_remains_and_never_that_nothing_does(verdict, causes, structure, changes,
                                                             words):
    d = replace(made.diagnosis(verdict, causes, structure), **changes)
    reader = read(d)
    assert ("unexplained" if remainder(d) else "rejected") in reader.ids
    assert words in reader.text
    assert not re.search(r"[Nn]othing (else )?is left", reader.text)


def test_without_a_remainder_the_page_has_no_such_section():
    reader = read(replace(made.diagnosis("explained", 1, False), possible=()))
    assert "unexplained" not in reader.ids


def test_a_verdict_is_marked_as_good_only_where_the_page_lists_nothing_against_it():
    good = replace(made.diagnosis("nothing_wrong", 0, False), considered=())
    assert 'class="verdict good"' in page(good)
    assert 'class="verdict bad"' in page(replace(good, outliers=MOMENTS))
    run = Outliers("v_x", 2.6, (ErrorMoment("a.mcap", 53.2, 0.32, 11.8, 1.4, 0.3, 0.0),))
    assert "/#t=53.20" in page(replace(good, outliers=(run,)))


def test_no_ratio_of_all_errors_is_next_to_the_gain_of_a_cause():
    """A cause that removes most of one error and little of all errors states only the first."""
    d = made.diagnosis("explained", 1, False)
    d = replace(d, causes=(replace(d.causes[0], cost=(1.07, 1.05, 1.09)),))
    for words in describe_cause(d, 0).values():
        assert "times as large" not in words
        assert "1.07" not in words
    folded = page(d).partition("<summary>Physics")[2]
    assert "7\u00a0% larger [+5\u00a0%, +9\u00a0%] without this cause" in folded


@pytest.mark.slow
def test_paths_and_errors_come_directly_after_the_verdict(whole):
    _, text, _ = whole
    order = ['class="verdict', "Error left 1 s ahead", 'href="#cause-1"',
             "<summary>In sentences", "Worst window: ", 'aria-label="Path in the worst window"',
             'aria-label="Path in the median window"', "Worst and median of 195 windows",
             "by the causes",
             'id="details"', "<summary>Errors, step by step"]
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    for style in ("before path line", "refit path line", "after path line", "car path line"):
        assert text.count(f'class="{style}"') == 2


@pytest.mark.slow
def test_bars_state_the_errors_of_every_model_in_every_channel(whole):
    d, text, _ = whole
    bars = text.partition('class="bars"')[2].partition("</table>")[0]
    for errors in (d.ctrv, *(stage.horizons for stage in d.stages)):
        for channel in ("vx", "vy", "yaw_rate", "position", "yaw_deg"):
            assert f">{significant(errors['1.0']['pooled'][channel])}<" in bars


@pytest.mark.slow
def test_refit_and_causes_have_their_shares_stated_separately(whole):
    d, _, reader = whole
    before, middle, after = (d.stages[k].horizons["1.0"]["pooled"]["position"]
                             for k in (0, 1, -1))
    assert before == middle
    assert f"position 0 % -{percent(1.0 - after / middle)}" in " ".join(
        " ".join(reader.words).split())


@pytest.mark.slow
def test_without_motion_capture_one_line_states_that_there_is_no_path():
    d = replace(made.diagnosis(causes=1), paths=())
    assert "Without motion capture there is no measured path to draw." in read(d).text
    assert "measured path to draw" not in read(made.diagnosis(causes=1)).text


@pytest.mark.slow
def test_details_are_folded(whole):
    _, text, _ = whole
    for words in ("Words and method", "Loss reduction of every effect alone", "Recordings",
                  "How this was made"):
        assert f"<summary>{words}</summary>" in text
