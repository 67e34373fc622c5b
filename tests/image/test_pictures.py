"""Pictures of several views as files: numbered, as a contact sheet, as an animation."""

from __future__ import annotations

import errno
import re
import sys

import numpy as np
import pytest

import bfrt
from bfrt.errors import DiskFullError, SettingError, StreamError
from bfrt.image.numbered import has_place, numbered
from bfrt.image.picture import Image
from bfrt.image.png import encode_srgb

HEIGHT, WIDTH = 5, 7


def picture(seed):
    rng = np.random.default_rng(seed)
    channels = {name: rng.random((HEIGHT, WIDTH), np.float32) for name in "RGBA"}
    return Image({**channels, "Z": channels["R"] + 1})


def white(height, width):
    return Image({name: np.ones((height, width), np.float32) for name in "RGBA"})


@pytest.fixture
def images():
    return bfrt.Images(picture(seed) for seed in range(5))


def codes(image):
    return encode_srgb(image.rgb)


def shown(path):
    """The frames of a file, as others read it."""
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed: bfrt[animation]")
    with pillow.open(path) as file:
        frames = []
        for number in range(getattr(file, "n_frames", 1)):
            file.seek(number)
            frames.append(np.asarray(file.convert("RGB")))
        return frames, file.info


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("a{}.png", ["a0.png", "a1.png"]),
        ("a{:d}.png", ["a0.png", "a1.png"]),
        ("a-{:03d}.png", ["a-000.png", "a-001.png"]),
        ("a%d.png", ["a0.png", "a1.png"]),
        ("%04d/a.exr", ["0000/a.exr", "0001/a.exr"]),
        ("100% a{:2d}.png", ["100% a 0.png", "100% a 1.png"]),
    ],
)
def test_a_pattern_names_files(pattern, names):
    assert has_place(pattern)
    assert numbered(pattern, 2) == names


@pytest.mark.parametrize("pattern", ["a.png", "a{x}.png", "a{:03f}.png", "{}{}.png", "{}-%d.png"])
def test_a_pattern_has_one_place(pattern):
    with pytest.raises(SettingError) as caught:
        numbered(pattern, 2)
    found = 2 if has_place(pattern) else 0
    assert str(caught.value) == (
        f"{pattern}: found {found} places for a view's number, expected one, as in "
        "view-{:03d}.png or view-%03d.png"
    )


@pytest.mark.parametrize("suffix", ["png", "exr", "npy"])
def test_each_file_is_that_of_its_picture(images, tmp_path, suffix):
    images.save(tmp_path / f"view-{{:02d}}.{suffix}")
    assert len(list(tmp_path.iterdir())) == 5
    for number, image in enumerate(images):
        image.save(tmp_path / f"alone.{suffix}")
        found = (tmp_path / f"view-{number:02d}.{suffix}").read_bytes()
        assert found == (tmp_path / f"alone.{suffix}").read_bytes()


@pytest.mark.parametrize("columns", [None, 1, 2, 5, 8])
def test_a_contact_sheet(images, tmp_path, columns, monkeypatch):
    monkeypatch.setattr("bfrt.image.sheet.BAND_BYTES", 12 * WIDTH * 4)
    images.save_sheet(tmp_path / "all.png", columns)
    (sheet,), _ = shown(tmp_path / "all.png")
    columns = columns or 3
    lines = -(-5 // columns)
    assert sheet.shape == (lines * HEIGHT, columns * WIDTH, 3)
    tiles = sheet.reshape(lines, HEIGHT, columns, WIDTH, 3).swapaxes(1, 2)
    for number, tile in enumerate(tiles.reshape(-1, HEIGHT, WIDTH, 3)):
        right = codes(images[number]) if number < 5 else np.zeros((HEIGHT, WIDTH, 3))
        np.testing.assert_array_equal(tile, right)


def test_an_animated_png(images, tmp_path, monkeypatch):
    monkeypatch.setattr("bfrt.image.png.CHUNK_BYTES", 50)  # several chunks a frame
    images.save_animation(tmp_path / "turn.png", seconds=0.25)
    frames, info = shown(tmp_path / "turn.png")
    assert (len(frames), info["loop"], info["duration"]) == (5, 0, 250)
    for frame, image in zip(frames, images, strict=True):
        np.testing.assert_array_equal(frame, codes(image))
    assert (tmp_path / "turn.png").read_bytes().count(b"fdAT") > 8


def test_a_gif(images, tmp_path):
    pytest.importorskip("PIL", reason="Pillow is not installed: bfrt[animation]")
    images.save_animation(tmp_path / "turn.gif")
    frames, info = shown(tmp_path / "turn.gif")
    assert (len(frames), info["loop"], info["duration"]) == (5, 0, 100)
    for frame, image in zip(frames, images, strict=True):
        off = np.abs(frame.astype(int) - codes(image).astype(int))
        assert off.max() <= 4  # there are fewer pixels than colors
    images.save_animation(tmp_path / "again.gif")
    assert (tmp_path / "turn.gif").read_bytes() == (tmp_path / "again.gif").read_bytes()


def test_a_gif_of_equal_and_of_plain_pictures(tmp_path):
    """None is left out, and a picture of one color has a map too."""
    pytest.importorskip("PIL", reason="Pillow is not installed: bfrt[animation]")
    plain = Image({name: np.full((3, 4), 0.5, np.float32) for name in "RGBA"})
    bfrt.Images([plain, plain, plain]).save_animation(tmp_path / "a.gif")
    frames, _ = shown(tmp_path / "a.gif")
    assert len(frames) == 3
    assert all((frame == codes(plain)).all() for frame in frames)


def test_without_pillow(images, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)  # as if there were none
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(SettingError) as caught:
        images.save_animation(tmp_path / "turn.gif")
    assert str(caught.value) == (
        f"{tmp_path}/turn.gif: a GIF needs Pillow: pip install bfrt[animation], or write .png"
    )
    images.save_animation(tmp_path / "turn.png")
    images.save_sheet(tmp_path / "all.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.png", "turn.png"]


@pytest.mark.parametrize(
    ("save", "fault"),
    [
        (lambda i, f: i.save(f / "a.png"), "found 0 places for a view's number"),
        (lambda i, f: i.save(f / "a{}.jpg"), "found suffix '.jpg', expected one of .exr"),
        (lambda i, f: i.save(f / "a{}.png", half=True), "found half=True for .png"),
        (lambda i, f: i.save(f / "no" / "a{}.png"), "found no folder"),
        (lambda i, f: i.save_sheet(f / "a.exr"), "found suffix '.exr' of a contact sheet"),
        (lambda i, f: i.save_sheet(f / "a.png", 0), "columns: found 0, expected a whole number"),
        (lambda i, f: i.save_animation(f / "a.mp4"), "found suffix '.mp4' of an animation"),
        (lambda i, f: i.save_sheet(f / "a.png", 10**9), "columns: found more than 65536, expect"),
        (lambda i, f: i.save_sheet(3), "image: found int, expected a path"),
        (lambda i, f: i.save_animation(3), "image: found int, expected a path"),
        (lambda i, f: i.save_animation(f / "a.png", 0.0), "seconds: found 0.0, expected 0.01 to"),
        (lambda i, f: i.save_animation(f / "a.png", "1"), "seconds: found '1', expected 0.01 to"),
        (lambda i, f: i.save_animation(f / "a.png", None), "seconds: found None, expected 0.01"),
        (lambda i, f: bfrt.Images().save_sheet(f / "a.png"), "found none, or several sizes"),
        (
            lambda i, f: bfrt.Images([i[0], white(2, 2)]).save_sheet(f / "a.png"),
            "found none, or several sizes",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_written(images, tmp_path, save, fault):
    with pytest.raises(SettingError, match=re.escape(fault)):
        save(images, tmp_path)
    assert list(tmp_path.iterdir()) == []


def full(path, *_):
    raise DiskFullError(path, 12, errno.ENOSPC, "writing")


def test_all_are_written_or_none(images, tmp_path, monkeypatch):
    """The fourth picture finds no room; the error names what it was to become."""
    (tmp_path / "a0.png").write_bytes(b"before")
    monkeypatch.setattr(images[3], "save", lambda path, half, color_bar: full(path))
    with pytest.raises(DiskFullError, match=rf"^{tmp_path}/a3.png: writing at byte 12: No space"):
        images.save(tmp_path / "a{}.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a0.png"]
    assert (tmp_path / "a0.png").read_bytes() == b"before"


def test_a_name_that_is_refused_at_the_end(images, tmp_path, monkeypatch):
    """Those that have their names already go, and what was there is there again."""
    from bfrt.streams import atomic_write

    swap = atomic_write._swap
    (tmp_path / "a1.png").write_bytes(b"before")

    def refusing(path, target):
        if target.name == "a3.png":
            raise StreamError(target, 0, errno.EPERM, "renaming to it")
        swap(path, target)

    monkeypatch.setattr(atomic_write, "_swap", refusing)
    with pytest.raises(StreamError, match=r"a3.png: renaming to it"):
        images.save(tmp_path / "a{}.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a1.png"]
    assert (tmp_path / "a1.png").read_bytes() == b"before"
