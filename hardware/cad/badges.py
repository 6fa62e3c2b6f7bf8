"""Numbers beside a picture, each with a thin line to what it means."""

from __future__ import annotations

from PIL import Image, ImageDraw, ImageFont

INK, PAPER = "#b3261e", "white"
Pixel = tuple[float, float]


def spread(wanted: list[float], apart: float, low: float, high: float) -> list[float]:
    """Heights as near as possible to the wanted ones (sorted), none nearer than `apart`."""
    if len(wanted) * apart > high - low:
        apart = (high - low) / max(len(wanted), 1)
    found: list[float] = []
    for y in wanted:
        found.append(max(y, low, found[-1] + apart if found else low))
    for k in range(len(found) - 1, -1, -1):
        found[k] = min(found[k], high if k == len(found) - 1 else found[k + 1] - apart)
    return found


def numbered(image: Image.Image, points: list[Pixel]) -> Image.Image:
    """The picture with a margin left and right; number n stands for the n-th point [pixels]."""
    radius = max(26, image.width // 34)
    margin, scale = int(2.6 * radius), 2  # drawn twice as large, so that lines are smooth
    wide = Image.new("RGB", (image.width + 2 * margin, image.height), PAPER)
    wide.paste(image.convert("RGB"), (margin, 0))
    wide = wide.resize((wide.width * scale, wide.height * scale), Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(wide)
    font = ImageFont.load_default(size=1.35 * radius * scale)
    order = sorted(range(len(points)), key=lambda n: points[n][0])
    half = (len(points) + 1) // 2
    for side, members in enumerate((order[:half], order[half:])):
        members = sorted(members, key=lambda n: points[n][1])
        heights = spread([points[n][1] for n in members], 2.3 * radius, 1.2 * radius,
                         image.height - 1.2 * radius)
        for n, y in zip(members, heights, strict=True):
            x = 1.2 * radius if side == 0 else wide.width / scale - 1.2 * radius
            _badge(draw, n + 1, (x, y), (points[n][0] + margin, points[n][1]), radius, scale, font)
    return wide.resize((wide.width // scale, wide.height // scale), Image.Resampling.LANCZOS)


def _badge(draw: ImageDraw.ImageDraw, number: int, at: Pixel, to: Pixel, radius: float,
           scale: int, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> None:
    (x, y), (u, v) = (at[0] * scale, at[1] * scale), (to[0] * scale, to[1] * scale)
    r, dot = radius * scale, 0.2 * radius * scale
    draw.line((x, y, u, v), fill=PAPER, width=int(0.22 * r))
    draw.line((x, y, u, v), fill=INK, width=int(0.1 * r))
    draw.ellipse((u - dot, v - dot, u + dot, v + dot), fill=INK, outline=PAPER, width=scale)
    draw.ellipse((x - r, y - r, x + r, y + r), fill=INK)
    draw.text((x, y), str(number), fill=PAPER, font=font, anchor="mm")
