"""Image files: what goes in comes out again, and a failure leaves nothing behind."""

import errno
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from blobscript import images
from blobscript.images import FormatError, Image, ReadError, WriteError

METADATA = {
    "scene": "3f2a",
    "version": "0.1.0",
    "parameters": '{"bite": 0.3, "name": "Ö & <b>"}',
    "command": "render -o x",
}
INTEGER = [("png", 8), ("png", 16), ("tif", 8), ("tif", 16), ("webp", 8)]


def picture(width: int = 13, height: int = 7, opaque: bool = False) -> Image:
    rng = np.random.default_rng(3)
    rgba = rng.random((height, width, 4), np.float32)
    if opaque:
        rgba[:, :, 3] = 1
    rgba[:, :, :3] *= rgba[:, :, 3:]
    return Image(rgba, metadata=dict(METADATA))


def with_layers(image: Image) -> Image:
    shape = image.rgba.shape[:2]
    rng = np.random.default_rng(4)
    depth = rng.random(shape, np.float32)
    depth[0, 0] = np.inf
    normal = rng.standard_normal((*shape, 3)).astype(np.float32)
    normal[0, 0] = np.nan
    surface = rng.integers(-1, 5, shape).astype(np.int32)
    image.aov = {"depth": depth, "normal": normal, "surface": surface, "evaluations": surface + 7}
    return image


def same(a: Image, b: Image) -> None:
    assert np.array_equal(a.rgba, b.rgba)
    assert a.aov.keys() == b.aov.keys()
    for name, values in a.aov.items():
        assert values.dtype == b.aov[name].dtype
        np.testing.assert_array_equal(values, b.aov[name])
    assert a.metadata == b.metadata


@pytest.mark.parametrize(("ending", "bits"), INTEGER)
def test_integers_are_near(tmp_path: Path, ending: str, bits: int) -> None:
    """16 bits: colours come back within half a step of the sRGB code; 8: within one, being dithered."""
    image = picture()
    image.save(tmp_path / f"a.{ending}", bits)
    again = images.read(tmp_path / f"a.{ending}")
    top = (1 << bits) - 1
    alpha = image.rgba[:, :, 3:]
    colour = images.srgb_encode(image.rgba[:, :, :3] / alpha)
    colour_again = images.srgb_encode(again.rgba[:, :, :3] / again.rgba[:, :, 3:])
    assert np.abs(again.rgba[:, :, 3:] - alpha).max() <= 0.501 / top
    assert np.abs(colour_again - colour).max() <= (1.0 if bits == 8 else 0.502) / top
    assert again.metadata == METADATA


@pytest.mark.parametrize(("ending", "bits"), INTEGER)
def test_integers_are_stable(tmp_path: Path, ending: str, bits: int) -> None:
    """What has been read is written as the same codes again."""
    picture(opaque=True).save(tmp_path / f"a.{ending}", bits)
    again = images.read(tmp_path / f"a.{ending}")
    again.save(tmp_path / f"b.{ending}", bits)
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


def test_dithering_keeps_the_mean_and_the_codes(tmp_path: Path) -> None:
    """A level between two codes becomes both of them, in the right proportion; a code stays itself."""
    for level in (100, 100.25, 100.5, 100.9):
        rgba = np.ones((64, 64, 4), np.float32)
        rgba[:, :, :3] = images.srgb_decode(np.array(level / 255))
        Image(rgba).save(tmp_path / "a.png")
        codes = images.srgb_encode(images.read(tmp_path / "a.png").rgba[:, :, :3]) * 255
        assert abs(codes.mean() - level) < 0.03
        windows = codes[:, :, 0].reshape(8, 8, 8, 8).mean(axis=(1, 3))
        assert np.abs(windows - level).max() < 0.06


@pytest.mark.parametrize(("ending", "bits"), [("exr", 32), ("tif", 32)])
def test_floats_are_exact(tmp_path: Path, ending: str, bits: int) -> None:
    image = picture()
    image.rgba[1, 1] = (7.5, -0.25, 1e-20, 1)
    image.save(tmp_path / f"a.{ending}", bits)
    same(images.read(tmp_path / f"a.{ending}"), image)


def test_exr_layers_are_exact(tmp_path: Path) -> None:
    image = with_layers(picture())
    assert image.save(tmp_path / "a.exr") == (tmp_path / "a.exr",)
    same(images.read(tmp_path / "a.exr"), image)


def test_half_floats_keep_the_layers_exact(tmp_path: Path) -> None:
    image = with_layers(picture())
    image.save(tmp_path / "a.exr", bits=16)
    again = images.read(tmp_path / "a.exr")
    assert np.array_equal(again.rgba, image.rgba.astype(np.float16).astype(np.float32))
    np.testing.assert_array_equal(again.aov["depth"], image.aov["depth"])
    np.testing.assert_array_equal(again.aov["normal"], image.aov["normal"])


def test_layer_channels_have_the_usual_names(tmp_path: Path) -> None:
    import OpenImageIO as oiio

    with_layers(picture()).save(tmp_path / "a.exr")
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    names = set(source.spec().channelnames)
    source.close()
    assert names == {"R", "G", "B", "A", "depth.Z", "normal.X", "normal.Y", "normal.Z", "surface", "evaluations"}


def test_other_formats_put_layers_beside(tmp_path: Path) -> None:
    image = with_layers(picture())
    written = image.save(tmp_path / "a.png")
    assert written == (tmp_path / "a.png", tmp_path / "a.layers.exr")
    beside = images.read(written[1])
    np.testing.assert_array_equal(beside.aov["depth"], image.aov["depth"])
    assert beside.metadata == METADATA
    assert images.read(written[0]).aov == {}


def test_jpeg_is_close(tmp_path: Path) -> None:
    """A smooth picture survives the compression within a few codes; without alpha, over white."""
    ramp = np.linspace(0.1, 0.9, 32, dtype=np.float32)
    rgba = np.ones((32, 32, 4), np.float32)
    rgba[:, :, :3] = ramp[:, None]
    rgba[:, 16:] = 0
    Image(rgba, metadata=dict(METADATA)).save(tmp_path / "a.jpg")
    again = images.read(tmp_path / "a.jpg")
    assert np.abs(images.srgb_encode(again.rgba[:, :12, :3]) - images.srgb_encode(rgba[:, :12, :3])).max() < 6 / 255
    assert again.rgba[:, 20:, :3].min() > 0.97
    assert again.metadata == METADATA


@pytest.mark.parametrize("ending", ["png", "exr", "tiff", "jpg", "webp"])
def test_long_metadata_is_kept_or_replaced_by_its_hash(tmp_path: Path, ending: str) -> None:
    image = picture()
    image.metadata = {"parameters": "x" * 100_000, "command": "render"}
    image.save(tmp_path / f"a.{ending}")
    again = images.read(tmp_path / f"a.{ending}").metadata
    assert again["command"] == "render"
    assert again["parameters"] == "x" * 100_000 or again["parameters"].startswith("sha256:")
    assert (ending in ("png", "exr", "webp")) == (again["parameters"] == "x" * 100_000)


@pytest.mark.parametrize("ending", ["png", "exr", "tiff", "jpg", "webp"])
def test_same_picture_same_bytes_without_dates(tmp_path: Path, ending: str) -> None:
    first, second = tmp_path / f"a.{ending}", tmp_path / f"b.{ending}"
    picture().save(first)
    code = f"""
        import sys; sys.path[:0] = {sys.path!r}
        import time, datetime
        from picture.test_images import picture
        picture().save({str(second)!r})
    """
    environment = {**os.environ, "TZ": "Pacific/Kiritimati"}
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, env=environment, timeout=60)
    assert first.read_bytes() == second.read_bytes()
    for year in range(2024, 2060):
        assert f"{year}:".encode() not in first.read_bytes()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (300, 2)])
@pytest.mark.parametrize("ending", ["png", "exr", "tif", "webp"])
def test_odd_sizes(tmp_path: Path, size: tuple[int, int], ending: str) -> None:
    image = picture(*size, opaque=True)
    image.save(tmp_path / f"a.{ending}")
    again = images.read(tmp_path / f"a.{ending}")
    assert (again.width, again.height) == size
    assert np.abs(again.rgba - image.rgba).max() < 0.01
    assert again.metadata == METADATA


def test_integers_clip_and_survive_nan(tmp_path: Path) -> None:
    rgba = np.ones((1, 4, 4), np.float32)
    rgba[0, :, 0] = (np.nan, np.inf, -1, 7)
    Image(rgba).save(tmp_path / "a.png")
    assert images.read(tmp_path / "a.png").rgba[0, :, 0].tolist() == [0, 1, 0, 1]


def test_other_programs_pictures_can_be_read(tmp_path: Path) -> None:
    """No metadata of ours, one grey channel: a picture all the same."""
    import OpenImageIO as oiio

    output = oiio.ImageOutput.create("png")
    spec = oiio.ImageSpec(3, 2, 1, "uint8")
    spec.attribute("ImageDescription", '{"blobscript": ["not", "ours"]}')
    assert output.open(str(tmp_path / "grey.png"), spec)
    output.write_image(np.full((2, 3, 1), 255, np.uint8))
    output.close()
    image = images.read(tmp_path / "grey.png")
    assert image.rgba.shape == (2, 3, 4)
    assert image.rgba.min() == 1
    assert image.metadata == {}


# ---- failures ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["out.gif", "out", "out.", ".png"])
def test_unknown_ending(tmp_path: Path, name: str) -> None:
    with pytest.raises(FormatError) as raised:
        picture().save(tmp_path / name)
    assert raised.value.code == "E0803"
    assert ".png, .exr, .tif, .tiff, .jpg, .jpeg or .webp" in raised.value.diagnostics[0].helps[0].text
    assert list(tmp_path.iterdir()) == []


def test_unknown_depth(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="PNG holds 8 or 16 bits per channel, not 32"):
        picture().save(tmp_path / "out.png", bits=32)
    assert list(tmp_path.iterdir()) == []


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="there is no folder") as raised:
        picture().save(tmp_path / "no" / "out.png")
    assert raised.value.code == "E0802"


def test_places_that_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(WriteError, match="it is a folder"):
        picture().save(tmp_path / "folder.png")
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(WriteError, match="it is not a plain file"):
        picture().save(tmp_path / "pipe.png")
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError):
        picture().save(tmp_path / "file" / "out.png")


def test_check_output_refuses_what_save_would(tmp_path: Path) -> None:
    assert images.check_output(tmp_path / "out.PNG").name == "PNG"
    with pytest.raises(FormatError):
        images.check_output(tmp_path / "out.bmp")
    with pytest.raises(WriteError):
        images.check_output(tmp_path / "no" / "out.png")
    (tmp_path / "out.layers.exr").mkdir()
    images.check_output(tmp_path / "out.exr", layers=True)
    with pytest.raises(WriteError, match="it is a folder"):
        images.check_output(tmp_path / "out.png", layers=True)
    (tmp_path / "out.layers.exr").rmdir()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ["png", "exr", "tif", "jpg", "webp"])
def test_full_disk_keeps_the_old_file(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """E0802, the old file, nothing else: for a full disk while writing and for a failed rename."""
    path = tmp_path / f"out.{ending}"
    path.write_text("old")

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for place, name in ((Path, "write_bytes"), (os, "replace")):
        with monkeypatch.context() as patch:
            patch.setattr(place, name, full)
            with pytest.raises(WriteError, match="no space left on device"):
                with_layers(picture()).save(path)
        assert path.read_text() == "old"
        assert list(tmp_path.iterdir()) == [path]


def test_a_limit_on_file_sizes(tmp_path: Path) -> None:
    """PNG's writer does not notice that its bytes go nowhere; we do."""
    code = f"""
        import sys; sys.path[:0] = {sys.path!r}
        import resource, signal
        from picture.test_images import picture
        from blobscript.images import WriteError
        image = picture(400, 300)
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        try:
            image.save({str(tmp_path / "out.png")!r})
        except WriteError as error:
            sys.exit(0 if error.code == "E0802" else 1)
        sys.exit(2)
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    assert subprocess.run(command, check=False, timeout=60).returncode == 0
    assert list(tmp_path.iterdir()) == []


def test_too_many_pixels_for_the_format(tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="WebP holds at most 16383 pixels a side, not 16384x1"):
        picture(16384, 1).save(tmp_path / "out.webp")
    assert list(tmp_path.iterdir()) == []


def test_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "out.png"
    picture().save(path)
    path.chmod(0o640)
    picture().save(path)
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to(tmp_path / "real.png")
    picture().save(tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink()
    assert images.read(tmp_path / "real.png").width == 13


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="there is no such file") as raised:
        images.read(tmp_path / "no.png")
    assert raised.value.code == "E0801"
    (tmp_path / "text.png").write_text("not a picture")
    with pytest.raises(ReadError):
        images.read(tmp_path / "text.png")
    picture(200, 200).save(tmp_path / "whole.png")
    (tmp_path / "part.png").write_bytes((tmp_path / "whole.png").read_bytes()[:2000])
    with pytest.raises(ReadError):
        images.read(tmp_path / "part.png")
    with pytest.raises(ReadError, match="not a plain file"):
        images.read(tmp_path)
