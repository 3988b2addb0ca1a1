"""An environment read from every kind of file that people have, and the one of the examples."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.cli import main
from blobscript.images import Image, read

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
BALL = "surface(material = chrome) { ball((0, 0, 0), radius = 1) }\n"


def room() -> np.ndarray:
    """One bright side: up; (16, 32, 4)."""
    pixels = np.full((16, 32, 4), 0.25, np.float32)
    pixels[:4] = 1.0
    pixels[..., 3] = 1.0
    return pixels


def write(path: Path) -> None:
    if path.suffix == ".hdr":  # which blobscript reads, but does not write
        import OpenImageIO as oiio

        out = oiio.ImageOutput.create(str(path))
        assert out and out.open(str(path), oiio.ImageSpec(32, 16, 3, "float"))
        assert out.write_image(np.ascontiguousarray(room()[..., :3])) and out.close()
    else:
        Image(room(), {}, {}, "linear", 0.0, {}).save(path)


@pytest.mark.parametrize("ending", [".hdr", ".exr", ".png", ".tif"])
def test_every_kind_of_file_gives_the_same_light(ending: str, tmp_path: Path) -> None:
    write(tmp_path / f"room{ending}")
    scene = blobscript.compile(f'{BALL}environment("room{ending}")', base=tmp_path)
    picture = scene.render(32, 24, 4, seed=1).rgba[..., :3]
    assert np.all(np.isfinite(picture))
    assert picture[0, 0].tolist() == pytest.approx([0.25] * 3, abs=0.01)
    assert picture[8:16, 12:20].max() > 0.5  # the ball mirrors what is above


def test_a_missing_environment_has_a_place_and_a_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.blob").write_text(f'blobscript 1\n{BALL}environment("none.hdr")\n', encoding="utf-8")
    assert main(["render", str(tmp_path / "a.blob"), "-o", str(tmp_path / "a.png")]) == 1
    told = capsys.readouterr().err
    assert "E0801" in told and "a.blob:3:" in told and "help" in told
    assert not (tmp_path / "a.png").exists()


def test_the_studio_is_what_its_script_makes() -> None:
    made = runpy.run_path(str(EXAMPLES / "data/studio.py"))["studio"]()
    np.testing.assert_allclose(read(EXAMPLES / "data/studio.exr").rgba[..., :3], made, rtol=2e-3)
