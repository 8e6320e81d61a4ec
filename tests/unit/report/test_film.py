"""The animation: every frame, at its pace, with its caption, the same bytes every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hqpipe.errors import UsageError
from hqpipe.report.film import Caption, captioned, write_gif

CAPTION = Caption(time=2.0, commanded=1.0, actual=0.97, feet={"LF": True, "RF": False}, fallen=False)
SKY = np.full((60, 160, 3), 235, np.uint8)


def moving(many: int) -> list[Image.Image]:
    """A block of a colour of its own that moves to the right."""
    frames = []
    for i in range(many):
        picture = SKY.copy()
        picture[25:35, 10 * i : 10 * i + 10] = (200, 120, 20)
        frames.append(captioned(picture, replace(CAPTION, time=2.0 + 0.05 * i)))
    return frames


def test_frames_size_and_pace(tmp_path):
    with Image.open(write_gif(moving(9), tmp_path / "a.gif", 20)) as film:
        assert film.format == "GIF" and film.n_frames == 9 and film.size == (160, 60)
        assert film.info["loop"] == 0, "for ever"
        places = []
        for i in range(film.n_frames):
            film.seek(i)
            assert film.info["duration"] == 50
            pixels = np.asarray(film.convert("RGB")).astype(int)
            places.append(np.nonzero((np.abs(pixels - (200, 120, 20)).sum(axis=-1) < 12).any(axis=0))[0].min())
    assert places == [10 * i for i in range(9)]


def test_the_same_frames_give_the_same_bytes(tmp_path):
    first, second = (write_gif(moving(4), tmp_path / name, 25).read_bytes() for name in ("a.gif", "b.gif"))
    assert first == second


def ink(picture: Image.Image) -> np.ndarray:
    return (np.asarray(picture).astype(int) < 100).all(axis=-1)


def test_the_caption_says_who_stands_and_who_fell():
    standing, lifted = (ink(captioned(SKY, replace(CAPTION, feet={"LF": on}))) for on in (True, False))
    assert standing[-15:].sum() > lifted[-15:].sum() + 10, "the mark of a foot on the ground is filled"
    upright, fallen = (ink(captioned(SKY, replace(CAPTION, fallen=fell))) for fell in (False, True))
    assert fallen[-15:].sum() > upright[-15:].sum() + 30
    silent = replace(CAPTION, commanded=None)
    assert ink(captioned(SKY, silent))[:20].sum() < upright[:20].sum(), "without an order none is written"


def test_what_cannot_be_shown_is_refused(tmp_path: Path):
    with pytest.raises(UsageError, match="at least one frame"):
        write_gif([], tmp_path / "a.gif", 20)
    with pytest.raises(UsageError, match="expected one of 10, 20, 25 a second, got 30"):
        write_gif(moving(1), tmp_path / "a.gif", 30)
