"""A walk as an animated GIF: text on every frame, one palette for all, the same bytes every time.

GIF, because every browser and mail programme plays it and Pillow writes it; what writes MP4 from Python ships an FFmpeg
under the GPL.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from hqpipe.errors import UsageError
from hqpipe.report.style import BLUE, INK

FRAME_RATES = (10, 20, 25)  # GIF counts hundredths of a second, and browsers slow down what is shorter than 2 of them
COLOURS = 255  # one of the 256 is left for "as in the frame before"
_SAMPLED = 12  # frames of which the palette is made, evenly spaced
_BACK = "#FFFFFF"
_MARGIN, _LETTERS = 0.025, (0.047, 0.0293)  # the edge, of the height; the letters, of height and width at most


@dataclass(frozen=True)
class Caption:
    """What stands on a frame.

    Attributes:
        time: s. commanded, actual: forward speed, m/s; commanded is None where no order was recorded.
        feet: name → whether it stands on the ground.
        fallen: whether the robot has fallen by then.
    """

    time: float
    commanded: float | None
    actual: float
    feet: dict[str, bool]
    fallen: bool


def captioned(picture: np.ndarray, caption: Caption) -> Image.Image:
    """The picture (height, width, 3) uint8 with times and speeds at the top, feet and falls at the bottom."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    edge = round(_MARGIN * image.height)
    size = max(8, round(min(_LETTERS[0] * image.height, _LETTERS[1] * image.width)))
    font = ImageFont.load_default(size)
    x = edge
    for text, sample, colour in _texts(caption):
        draw.text((x, edge), text, fill=colour, font=font)
        x += draw.textlength(f"{sample}   ", font=font)
    x, y, side = edge, image.height - edge - size, round(0.7 * size)
    for foot, stands in caption.feet.items():
        corners = (x, y + round(0.2 * size), x + side, y + round(0.2 * size) + side)
        draw.rectangle(corners, fill=INK if stands else _BACK, outline=INK, width=max(1, size // 12))
        draw.text((x + 1.3 * side, y), foot, fill=INK, font=font)
        x += round(1.3 * side + draw.textlength(f"{foot}  ", font=font))
    if caption.fallen:
        draw.text((image.width - edge, y), "FALLEN", fill=INK, font=font, anchor="ra")
    return image


def _texts(caption: Caption) -> list[tuple[str, str, str]]:
    """(text, what it may grow to, colour); the room is that of the second, so that nothing jitters."""
    texts = [(f"{caption.time:.2f} s", "00.00 s", INK)]
    if caption.commanded is not None:
        texts.append((f"commanded {caption.commanded:.2f} m/s", "commanded 0.00 m/s", INK))
    texts.append((f"actual {caption.actual:.2f} m/s", "actual 0.00 m/s", BLUE))
    return texts


def write_gif(frames: Sequence[Image.Image], path: Path, frame_rate: int) -> Path:
    """Write an animation that runs for ever.

    Args:
        frames: of one size. frame_rate: frames a second, one of FRAME_RATES.

    Raises:
        UsageError: there is no frame, or GIF cannot keep that rate.
    """
    if not frames:
        raise UsageError("nothing to show: expected at least one frame")
    if frame_rate not in FRAME_RATES:
        raise UsageError(f"frame rate: expected one of {', '.join(map(str, FRAME_RATES))} a second, got {frame_rate}")
    palette = _palette(frames)
    # Without dithering: noise that moves from frame to frame would be most of the file.
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    path.parent.mkdir(parents=True, exist_ok=True)
    duration = 1000 // frame_rate  # ms
    first.save(path, "GIF", save_all=True, append_images=others, duration=duration, loop=0, optimize=False)
    return path


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Colours of a few frames, and those of the text, which are too few pixels to be found among them."""
    width, height = frames[0].size
    chosen = sorted({round(i) for i in np.linspace(0, len(frames) - 1, _SAMPLED)})
    strip = Image.new("RGB", (width, height * len(chosen)))
    for row, index in enumerate(chosen):
        strip.paste(frames[index], (0, row * height))
    text = [ImageColor.getrgb(colour) for colour in (INK, BLUE, _BACK)]
    found = strip.quantize(COLOURS - len(text), method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*found.getpalette(), *(level for colour in text for level in colour)])
    return palette
