"""The page builder, the chart kit and the numbers: sound markup, round ticks, honest digits."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from dart_hal.core import figures
from dart_lab.report import charts, page, svg
from dart_lab.report.html import VOID, Html, el, table
from dart_lab.report.numbers import with_error
from tests.pages import foreign, strip_data


class PageReader(HTMLParser):
    """Whether every element that is opened is closed."""

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.open += [tag] * (tag not in VOID)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_ticks_are_round_and_inside():
    for low, high in ((-0.013, 0.09), (0.0, 322.0), (1e-4, 3e-4), (-3.0, 5.0)):
        marks = svg.ticks(low, high)
        assert 2 <= len(marks) <= 7
        assert all(low - 1e-12 <= m <= high + 1e-12 for m in marks)
        strip_data = [svg.label(m, (low, high)) for m in marks]
        assert len(set(strip_data)) == len(strip_data)
        np.testing.assert_allclose([float(s) for s in strip_data], marks, rtol=1e-6, atol=1e-9)


def test_an_interval_without_any_number_can_still_be_drawn():
    low, high = svg.enclosing_interval(np.array([np.nan]), zero=True)
    assert low < 0.0 < high


def test_markup_is_kept_and_text_is_escaped():
    assert el("p", "a < b +- 1", el("b", "x")) == "<p>a &lt; b\u00a0±\u00a01<b>x</b></p>"
    assert el("p", class_="n", data_x='"') == '<p class="n" data-x="&quot;"></p>'
    assert isinstance(table(("a",), [("<i>",)]), Html)
    with pytest.raises(ValueError, match="attribute"):
        el("line", x1=float("nan"))


def test_a_table_without_rows_is_not_there():
    assert table(("a", "b"), []) == ""
    assert "thead" in table(("a", "b"), [("1", "2")])
    assert "thead" not in table(("", ""), [("1", "2")])


@pytest.mark.parametrize(("value", "std", "text"), [
    (13.348, 9.3, "13.3 +- 9.3"), (1.72584, 0.0213, "1.726 +- 0.021"),
    (0.0, 0.013, "0.000 +- 0.013"), (9.96, 0.996, "10.0 +- 1.0"), (1234.5, 172.0, "1230 +- 170"),
    (-0.0001, 0.31, "0.00 +- 0.31"), (1.0, math.inf, "1 +- unknown")])
def test_value_and_error_end_at_the_same_place(value, std, text):
    assert with_error(value, std) == text


def test_a_page_is_sound_and_requests_nothing_from_outside(tmp_path):
    pytest.importorskip("matplotlib")
    x = np.arange(3.0)
    reach = np.array([0.1, math.nan, 0.2])
    figure = figures.new_figure()
    figures.finish(figure.subplots(), "x", "y", "title")
    drawn = [charts.draw_lines("lines", "x", "y", [charts.Series(x, x, reach)], ("a", "b", "c")),
             charts.draw_paths("paths", "x", "y", [(np.array([[0.0, 1.0], [0.0, 0.5]]), "car")], 1),
             charts.tabulate_bars("groups", ["one"], [
                 charts.BarRow("a", "before", [2.0], [1.0]),
                 charts.BarRow("b", "after", [math.inf], [math.nan])]),
             charts.draw_bars("bars", "x", [("one", 120.0, "after"), ("none", 0.3, "other")]),
             page.image(figure, "a <picture>")]
    sections = {"one": ("First", page.figures([page.figure("<b>caption", d) for d in drawn])),
                "two": ("Second", page.card(el("p", "told"), good=True))}
    whole = page.page("of <a test>", "Heading", page.text("lead"), sections)
    written = page.write(tmp_path / "new" / "page.html", whole).read_text(encoding="utf-8")
    assert written == whole
    assert not PageReader(whole).open
    assert not foreign(whole)
    assert not re.search(r"\b(nan|inf|None)\b", strip_data(whole))
    assert all(f'href="#{key}"' in whole and f'id="{key}"' in whole for key in sections)
    assert "<b>caption" not in whole
    assert whole.count("<svg") == 4


def points_of(picture, style):
    """Points of the line of a style, in px (2, n)."""
    text = re.search(rf'points="([^"]*)" class="{style} path line"', picture)[1]
    return np.array([[float(v) for v in pair.split(",")] for pair in text.split()]).T


@pytest.mark.parametrize("size", [(2.0, 0.1), (1.0, 1.0), (0.1, 2.0)])
def test_paths_have_equal_axes(size):
    corner = np.array([[0.0, size[0], size[0]], [0.0, 0.0, size[1]]])
    px = points_of(charts.draw_paths("p", "x", "y", [(corner, "car")], 1), "car")
    along = px[0, 1] - px[0, 0]
    up = px[1, 1] - px[1, 2]
    assert along / size[0] == pytest.approx(up / size[1], rel=0.03)
    assert px.min() >= 0.0
    assert px[0].max() <= 440.0


def test_a_path_that_leaves_the_picture_does_not_shrink_the_others():
    car = np.array([[0.0, 0.5, 1.0], [0.0, 0.0, 0.0]])
    lost = np.array([[0.0, 0.5, 50.0], [0.0, 0.5, 0.0]])
    picture = charts.draw_paths("p", "x", "y", [(car, "car"), (lost, "before")], 1)
    assert points_of(picture, "before").shape == (2, 2)
    assert np.ptp(points_of(picture, "car")[0]) > 200.0


def test_each_column_of_bars_has_its_own_scale_and_infinity_no_bar():
    table = charts.tabulate_bars("t", ["a", "b", "c"], [
        charts.BarRow("one", "before", [1.0, 200.0, math.nan]),
        charts.BarRow("two", "after", [0.5, math.inf, 0.0], [0.25, math.nan, math.nan])])
    widths = [float(w) for w in re.findall(r'<rect [^>]*width="([\d.]+)"', table)]
    assert widths == [100.0, 100.0, 50.0]
    assert "<td>diverged</td>" in table
    assert "<td>-</td>" in table
    assert re.search(r'<line x1="25" [^>]*class="median"', table)


def test_a_line_ends_at_a_point_that_is_not_finite():
    """A part of a variable without data has no line across it."""
    x = np.array([0.0, 1.0, math.nan, 3.0, 4.0])
    picture = charts.draw_lines("l", "x", "y", [charts.Series(x, x, np.zeros(5))])
    assert picture.count("<polyline") == 2
    whole = charts.draw_lines("l", "x", "y", [charts.Series(x[:2], x[:2], np.zeros(2))])
    assert whole.count("<polyline") == 1


@pytest.mark.parametrize("tag", ['<img src="http://a.b/c.png">', "<script>", "<link rel=x>",
                                 "<p style='background: url(x)'>", '<iframe src="x">'])
def test_what_requests_something_from_outside_is_detected(tag):
    assert foreign(page.page("a", "b", Html(tag), {}))


def test_what_is_downloaded_is_the_answer():
    given = {"a": math.nan, "b": np.arange(2), "c": Path("x"), "d": (1, {"e": np.float64(2.5)})}
    button = page.download(given, "x.json")
    data = json.loads(b64decode(button.partition("base64,")[2].partition('"')[0]))
    assert data == {"a": None, "b": [0, 1], "c": "x", "d": [1, {"e": 2.5}]}


def test_a_moment_of_a_run_links_to_its_replay():
    link = page.link_replay("12.3", "runs/one.mcap", 12.345)
    assert 'href="http://localhost:8642/#t=12.35"' in link
    assert "dart-hal view runs/one.mcap" in link
    # Negative control: the page plays runs of this program only.
    assert page.link_replay("12.3", "one.csv", 12.345) == "12.3"


def test_a_long_link_breaks_as_long_text_does():
    """Else a table of links pushes its other columns off the page."""
    link = el("a", "turns its wheels faster than it moves", href="#cause-1")
    assert 'class="l"' in table(("", "size"), [[link, "1 N"]])
    short = el("a", "mass", href="#a-very-long-anchor-that-is-not-shown")
    assert 'class="l"' not in table(("", "size"), [[short, "1 N"]])
