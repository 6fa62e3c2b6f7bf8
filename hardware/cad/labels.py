"""Words next to a picture, each with a thin line to what it names."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

INK, LINE, PAPER = "#22313f", "#b3261e", "white"
MARGIN = 0.34
"""Width of the column of words on either side, in widths of the picture."""
LETTER = 0.033
"""Height of the letters in widths of the picture: 12 pixels where a page is 640 wide."""
SMOOTHING = 2
"""Lines are drawn this much larger, and the picture is then reduced."""
Pixel = tuple[float, float]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


def spread(targets: Sequence[float], sizes: Sequence[float], low: float,
           high: float) -> list[float]:
    """Return middles as near as possible to the targets, in their order, without overlap."""
    shrink = min(1.0, (high - low) / max(sum(sizes), 1e-9))
    sizes = [size * shrink for size in sizes]
    found: list[float] = []
    edge = low
    for middle, size in zip(targets, sizes, strict=True):
        found.append(max(middle, edge + size / 2.0))
        edge = found[-1] + size / 2.0
    edge = high
    for n in range(len(found) - 1, -1, -1):
        found[n] = min(found[n], edge - sizes[n] / 2.0)
        edge = found[n] - sizes[n] / 2.0
    return found


def wrap(text: str, width: float, font: Font) -> list[str]:
    """Return the lines of a text that are not wider than ``width``, in pixels of the font."""
    lines = [""]
    for word in text.replace("`", "").split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def add_labels(image: Image.Image, texts: Sequence[str], points: Sequence[Pixel]) -> Image.Image:
    """Return the picture with a column of words on either side; text n names point n [pixels]."""
    letter = LETTER * image.width * SMOOTHING
    font = ImageFont.load_default(size=letter)
    margin = int(MARGIN * image.width)
    wide = Image.new("RGB", (image.width + 2 * margin, image.height), PAPER)
    wide.paste(image.convert("RGB"), (margin, 0))
    wide = wide.resize((wide.width * SMOOTHING, wide.height * SMOOTHING),
                       Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(wide)
    # The left half of the points has its words on the left.
    order = sorted(range(len(points)), key=lambda n: points[n][0])
    half = (len(points) + 1) // 2
    for left, members in ((True, order[:half]), (False, order[half:])):
        members = sorted(members, key=lambda n: points[n][1])
        texts_here = [wrap(texts[n], (margin - 0.04 * image.width) * SMOOTHING, font)
                      for n in members]
        middles = spread([points[n][1] * SMOOTHING for n in members],
                         [(1.15 * len(lines) + 0.6) * letter for lines in texts_here], 0.0,
                         wide.height)
        x = 0.95 * margin * SMOOTHING if left else wide.width - 0.95 * margin * SMOOTHING
        for n, lines, y in zip(members, texts_here, middles, strict=True):
            end = (points[n][0] + margin) * SMOOTHING, points[n][1] * SMOOTHING
            _draw_line(draw, (x, y), end, letter)
            draw.multiline_text((x, y), "\n".join(lines), fill=INK, font=font,
                                anchor="rm" if left else "lm", align="right" if left else "left",
                                spacing=0.15 * letter)
    return wide.resize((wide.width // SMOOTHING, wide.height // SMOOTHING),
                       Image.Resampling.LANCZOS)


def _draw_line(draw: ImageDraw.ImageDraw, start: Pixel, end: Pixel, letter: float) -> None:
    """Draw a line from a text to what it names, with a dot at its end."""
    away = 0.3 * letter if end[0] > start[0] else -0.3 * letter
    beginning = start[0] + away, start[1]
    draw.line((*beginning, *end), fill=PAPER, width=int(0.2 * letter))
    draw.line((*beginning, *end), fill=LINE, width=int(0.09 * letter))
    dot = 0.18 * letter
    draw.ellipse((end[0] - dot, end[1] - dot, end[0] + dot, end[1] + dot), fill=LINE,
                 outline=PAPER, width=SMOOTHING)
