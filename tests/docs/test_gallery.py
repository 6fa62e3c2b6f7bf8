"""The gallery shows every example, as it is now."""

from __future__ import annotations

import sys

import pytest
from handbook import DOCS, ROOT
from test_guide import unknown_command

sys.path.insert(0, str(DOCS))
import gallery


def test_the_page_matches_the_examples():
    assert (DOCS / "gallery.md").read_text(encoding="utf-8") == gallery.page()


@pytest.mark.parametrize("program", gallery.programs(), ids=lambda p: p.stem)
def test_a_program_has_a_sentence_a_command_and_a_picture(program):
    sentence, command = gallery.words(program)
    assert sentence.endswith(".")
    assert str(program.relative_to(ROOT)) in command
    assert not unknown_command(command)
    assert gallery.picture(program).read_bytes().startswith(b"\x89PNG")


def test_a_program_without_a_command_is_refused(tmp_path):
    (tmp_path / "silent.py").write_text('"""Does something."""\n')
    with pytest.raises(ValueError, match="how it is run"):
        gallery.words(tmp_path / "silent.py")


@pytest.mark.slow
def test_the_way_of_a_car_is_drawn(tmp_path, monkeypatch):
    monkeypatch.setenv("DART_HAL_URL", "sim://?nano=mock")
    (ways,) = gallery.ways_of(ROOT / "examples" / "drive_circle.py", script=False)
    assert len(ways) > 900
    gallery.draw_ways([ways], tmp_path / "way.png")
    gallery.draw_text("a\nb", tmp_path / "text.png")
    assert (tmp_path / "way.png").stat().st_size > 5000
    assert (tmp_path / "text.png").exists()
