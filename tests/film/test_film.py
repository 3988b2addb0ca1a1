"""Moments, frames that stay, and what the film files hold."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blobscript import images
from blobscript.diagnostics import ProgramError
from blobscript.film import Film, FrameFolder, Look, join
from blobscript.film.codes import codes
from blobscript.scene import Scene
from blobscript.source import Source

SCRIPT = """\
animate(seconds = 1, fps = 6)
surface(material = clay(coral)) {
  ball((2 * sin(phase * 360deg), 0, 0), radius = 1)
}
"""
LOOK = Look(32, 24)


@pytest.fixture
def film() -> Film:
    return Film(Source("film.blob", SCRIPT, None))


def test_moments(film: Film) -> None:
    assert [(m.number, m.time, m.phase) for m in film.moments] == [(k, k / 6, k / 6) for k in range(6)]


def test_moments_are_rounded() -> None:
    film = Film(Source("film.blob", SCRIPT.replace("seconds = 1, fps = 6", "seconds = 0.7, fps = 5"), None))
    assert [(m.time, m.phase) for m in film.moments] == [(k / 5, k / 4) for k in range(4)]


def test_each_frame_is_the_picture_at_its_phase(film: Film) -> None:
    first, later = (film.frame(film.moments[k], LOOK).scenes[0] for k in (0, 1))
    assert later.ir.surfaces[0] != first.ir.surfaces[0]
    assert later.ir.camera == first.ir.camera, "a camera nobody asked for stands still"


def test_the_default_camera_shows_all_moments(film: Film) -> None:
    for moment in film.moments:
        rgba = film.frame(moment, Look(64, 48)).scenes[0].render(width=64, height=48, aov=("surface",)).aov["surface"]
        border = np.concatenate([rgba[0], rgba[-1], rgba[:, 0], rgba[:, -1]])
        assert (rgba >= 0).any()
        assert not (border >= 0).any()


def test_keys_tell_what_changes_pixels(film: Film) -> None:
    def key(moment: int = 0, **changes: object) -> str:
        return film.frame(film.moments[moment], Look(**{"width": 32, "height": 24, **changes})).key()  # type: ignore[arg-type]

    assert key() == key(threads=1)
    assert len({key(), key(1), key(width=33), key(samples=2), key(seed=1), key(blur=2), key(noise=0.1)}) == 7


def test_blur_is_the_mean_of_its_moments(film: Film) -> None:
    look = Look(32, 24, blur=2, shutter=1.0)
    frame = film.frame(film.moments[1], look)
    times = [SCRIPT.replace("phase", str((1 + part) / 6)) for part in (0.25, 0.75)]
    alone = [Film(Source("film.blob", text, None)) for text in times]
    assert [Scene(replace(s.ir, camera=f.first.camera)).hash for s, f in zip(frame.scenes, alone, strict=True)] == [
        Scene(replace(f.first, width=32, height=24)).hash for f in alone
    ]
    parts = [scene.render(width=32, height=24, seed=k).rgba for k, scene in enumerate(frame.scenes)]
    assert np.abs(frame.picture().rgba - np.mean(parts, axis=0)).max() < 1e-6


def test_a_script_without_animate() -> None:
    with pytest.raises(ProgramError) as caught:
        Film(Source("still.blob", "surface { ball(radius = 1) }", None))
    assert [d.code for d in caught.value.diagnostics] == ["E1101"]


@pytest.mark.parametrize("arguments", ["0.01", "1e9", "1, fps = 0", "-1"])
def test_films_that_cannot_be(arguments: str) -> None:
    with pytest.raises(ProgramError) as caught:
        Film(Source("film.blob", SCRIPT.replace("seconds = 1, fps = 6", arguments), None))
    assert [(d.code, d.line) for d in caught.value.diagnostics] == [("E0405", 1)]


def test_a_mistake_at_some_time_says_when() -> None:
    text = SCRIPT.replace("radius = 1)", "radius = 1 - 2 * phase)")
    film = Film(Source("film.blob", text, None))
    with pytest.raises(ProgramError) as caught:
        film.frame(film.moments[4], LOOK)
    assert any("--phase" in note or "--time" in note for note in caught.value.diagnostics[0].notes)


# ---- files ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    film = Film(Source("film.blob", SCRIPT, None))
    folder = FrameFolder(tmp_path_factory.mktemp("film") / "film.gif")
    folder.create()
    for moment in film.moments:
        frame = film.frame(moment, LOOK)
        folder.put(moment.number, frame.key(), frame.picture())
    return [folder.file(moment.number) for moment in film.moments]


def test_a_broken_frame_is_not_taken(frames: list[Path], tmp_path: Path) -> None:
    folder = FrameFolder(tmp_path / "a.gif")
    folder.create()
    key = images.read(frames[0]).metadata["frame"]
    whole = frames[0].read_bytes()
    folder.file(0).write_bytes(whole)
    assert folder.has(0, key)
    assert not folder.has(0, "0" * 32)
    assert not folder.has(1, key)
    for end in (0, 20, len(whole) // 2, len(whole) - 20):
        folder.file(0).write_bytes(whole[:end])
        assert not folder.has(0, key), end


def test_apng_holds_the_frames_bit_by_bit(frames: list[Path], tmp_path: Path) -> None:
    target = tmp_path / "film.png"
    join(target, frames, 6.0)
    data = target.read_bytes()
    kinds, at = [], 8
    pixels: list[bytes] = []
    numbers: list[int] = []
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        kinds.append(kind)
        if kind == b"acTL":
            assert struct.unpack(">II", body) == (6, 0)
        if kind == b"fcTL":
            number, width, height, x, y, up, down = struct.unpack(">IIIIIHH", body[:24])
            assert (width, height, x, y, up / down) == (32, 24, 0, 0, 1 / 6)
            numbers.append(number)
            pixels.append(b"")
        if kind == b"fdAT":
            numbers.append(struct.unpack(">I", body[:4])[0])
        if kind in (b"IDAT", b"fdAT"):
            pixels[-1] += body[4:] if kind == b"fdAT" else body
        at += length + 12
    assert numbers == list(range(len(numbers)))
    assert (kinds[0], kinds[1], kinds[-1]) == (b"IHDR", b"acTL", b"IEND")
    assert (images.read(target).rgba == images.read(frames[0]).rgba).all(), "other viewers show the first frame"
    for frame, there in zip(frames, pixels, strict=True):
        raw = frame.read_bytes()
        assert there[:40] in raw
        assert there[-40:] in raw


def test_gif(frames: list[Path], tmp_path: Path) -> None:
    import OpenImageIO as oiio

    target = tmp_path / "film.gif"
    join(target, frames, 6.0)
    source = oiio.ImageInput.open(str(target))
    shown = np.zeros((24, 32, 3))
    for number, frame in enumerate(frames):
        assert source.seek_subimage(number, 0)
        change = source.read_image("uint8")
        shown = np.where(change[:, :, 3:] > 0, change[:, :, :3], shown)  # transparent: as it was
        assert np.abs(shown - codes(frame)).mean() < 6
    assert not source.seek_subimage(len(frames), 0)
    source.close()


@pytest.mark.parametrize("ending", ["mp4", "webm"])
def test_video(frames: list[Path], tmp_path: Path, ending: str) -> None:
    import av

    target = tmp_path / f"film.{ending}"
    join(target, frames, 6.0)
    with av.open(str(target)) as film:
        stream = film.streams.video[0]
        assert stream.average_rate == 6
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
    assert len(shown) == len(frames)
    for frame, there in zip(frames, shown, strict=True):
        assert np.abs(there.astype(float) - codes(frame)).mean() < 6


@pytest.mark.parametrize("ending", ["gif", "png", "mp4"])
def test_a_full_disk_leaves_nothing_behind(frames: list[Path], tmp_path: Path, ending: str) -> None:
    import resource

    target = tmp_path / f"film.{ending}"
    target.write_bytes(b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, hard))
    try:
        with pytest.raises(images.WriteError):
            join(target, frames, 6.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]
