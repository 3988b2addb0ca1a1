"""`animate`: films from the command line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPT = """\
animate(seconds = 1, fps = 5)
surface {
  ball((sin(phase * 360deg), 0, 0), radius = 1)
}
"""
SMALL = ("--size", "16x12", "--samples", "1")


@pytest.fixture
def film(blob) -> None:
    Path("film.blob").write_text(SCRIPT, encoding="utf-8")


@pytest.mark.usefixtures("film")
@pytest.mark.parametrize("ending", ["gif", "png", "apng", "mp4", "webm"])
def test_a_film(blob, ending: str) -> None:
    done = blob("animate", "film.blob", "-o", f"film.{ending}", *SMALL)
    assert done.code == 0, done.err
    assert f"film.{ending}: 5 frames in" in done.err
    assert Path(f"film.{ending}").stat().st_size > 100
    assert not Path("film.frames").exists()


@pytest.mark.usefixtures("film")
def test_parts_are_joined_by_a_run_without_shard(blob) -> None:
    for part in (1, 2):
        assert blob("animate", "film.blob", "-o", "film.png", *SMALL, "--shard", f"{part}/2").code == 0
        assert not Path("film.png").exists()
    done = blob("animate", "film.blob", "-o", "film.png", *SMALL, "--format", "json")
    assert json.loads(done.out) | {"seconds": 0} == {
        "diagnostics": [],
        "files": ["film.png"],
        "frames": 5,
        "rendered": 0,
        "seconds": 0,
    }


@pytest.mark.usefixtures("film")
def test_only_what_changed_is_rendered_again(blob) -> None:
    command = ("animate", "film.blob", "-o", "film.png", *SMALL, "--keep", "--format", "json")
    assert json.loads(blob(*command).out)["rendered"] == 5
    whole = Path("film.png").read_bytes()
    Path("film.frames/00002.png").write_bytes(b"broken")
    Path("film.frames/00004.png").unlink()
    Path("film.blob").write_text("// the same film\n" + SCRIPT, encoding="utf-8")
    assert json.loads(blob(*command).out)["rendered"] == 2
    assert Path("film.png").read_bytes() == whole
    Path("film.blob").write_text(SCRIPT.replace("radius = 1", "radius = if (phase > 0.5) 1 else 0.9"), encoding="utf-8")
    assert json.loads(blob(*command).out)["rendered"] == 5, "the camera shows all of the film"


@pytest.mark.usefixtures("film")
def test_some_frames(blob) -> None:
    done = blob("animate", "film.blob", "-o", "film.png", *SMALL, "--frames", "1..3", "--keep")
    assert done.code == 0
    assert sorted(path.name for path in Path("film.frames").iterdir()) == ["00001.png", "00002.png", "00003.png"]


@pytest.mark.usefixtures("film")
@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("-o", "film.avi"), 2, "error[E0803]: cannot write `film.avi`: .avi is no film format"),
        (("-o", "film"), 2, "needs an ending"),
        (("-o", "nowhere/film.gif"), 3, "there is no folder `nowhere`"),
        (("-o", "film.mp4", "--size", "15x12"), 2, "= help: --size 16x12"),
        (("-o", "film.gif", "--frames", "2..9"), 2, "the film has the frames 0..4"),
        (("-o", "film.gif", "--frames", "3..2"), 2, "holds no frame"),
        (("-o", "film.gif", "--frames", "3"), 2, "range of frames such as 0..47"),
        (("-o", "film.gif", "--shard", "3/2"), 2, "there is no part 3 of 2"),
        (("-o", "film.gif", "--shutter", "0.3"), 2, "--shutter has no effect without motion blur"),
        (("-o", "film.gif", "--shard", "1/2", "--keep"), 2, "--keep has no effect with --shard"),
    ],
)
def test_refusals(blob, options: tuple[str, ...], code: int, words: str) -> None:
    done = blob("animate", "film.blob", *options)
    assert (done.code, done.out) == (code, "")
    assert words in done.err
    assert not Path("film.frames").exists()


@pytest.mark.usefixtures("film")
def test_a_missing_codec_and_a_missing_library(blob, monkeypatch: pytest.MonkeyPatch) -> None:
    from blobscript.film import video

    monkeypatch.setitem(video._CODECS, ".mp4", ("mp4", "nosuchcodec", {}))
    done = blob("animate", "film.blob", "-o", "film.mp4")
    assert (done.code, "without the codec nosuchcodec" in done.err) == (3, True)
    monkeypatch.setitem(sys.modules, "av", None)
    done = blob("animate", "film.blob", "-o", "film.webm")
    assert (done.code, "pip install 'blobscript[video]'" in done.err) == (3, True)


@pytest.mark.usefixtures("film")
def test_an_interrupted_film_goes_on(blob) -> None:
    Path("film.blob").write_text(SCRIPT.replace("seconds = 1", "seconds = 30"), encoding="utf-8")
    command = ["animate", "film.blob", "-o", "film.png", "--size", "64x48", "--samples", "1"]
    with subprocess.Popen([sys.executable, "-m", "blobscript", *command], stderr=subprocess.PIPE, text=True) as process:
        end = time.monotonic() + 60
        while len(list(Path("film.frames").glob("[0-9]*.png"))) < 3 and time.monotonic() < end:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1]
    assert process.returncode == 130
    assert "frames are in film.frames: the same command goes on there" in said
    assert not Path("film.png").exists()
    kept = len(list(Path("film.frames").iterdir()))
    assert 3 <= kept < 150
    assert not list(Path("film.frames").glob("*.part"))
    done = blob(*command, "--frames", f"0..{kept}", "--format", "json")
    assert json.loads(done.out)["rendered"] <= 2
