"""`blobscript render` and `info`: pictures, their notes, interruption."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from blobscript import images
from blobscript.backends.picture import LAYERS
from blobscript.cli.options import AOVS

if TYPE_CHECKING:
    from conftest import Blob


@pytest.mark.parametrize("ending", [".png", ".exr", ".tif", ".jpg", ".webp"])
def test_formats(blob: Blob, ending: str) -> None:
    name = f"hello{ending}"
    result = blob("render", "hello.blob", "-o", name, "--size", "32x24")
    assert result.code == 0, result.text
    assert result.out == ""
    assert result.err.startswith(f"{name}: 32x24, rendered in ")
    assert images.read(name).rgba.shape == (24, 32, 4)
    assert sorted(p.name for p in Path().iterdir()) == ["hello.blob", name, "lamp.blob"]


def test_the_script_chooses_the_size(blob: Blob) -> None:
    Path("a.blob").write_text("surface { ball(radius = 1) }\nimage(width = 20, height = 10)\n", encoding="utf-8")
    blob("render", "a.blob", "-o", "a.png")
    assert images.read("a.png").rgba.shape == (10, 20, 4)


def test_the_picture_shows_the_ball(blob: Blob) -> None:
    """A ball of radius 1 in the middle, seen from 5 away: the limb is at asin(1/5)."""
    Path("a.blob").write_text(
        "surface(material = clay(coral)) { ball(radius = 1) }\n"
        "camera(from = (0, 0, 5), fov = 40deg)\nbackground(black)\n",
        encoding="utf-8",
    )
    assert blob("render", "a.blob", "-o", "a.exr", "--size", "101x101", "--aov", "depth,surface").code == 0
    image = images.read("a.exr")
    depth = image.aov["depth"]
    assert depth[50, 50] == pytest.approx(4.0, rel=1e-6)
    y, x = np.mgrid[0:101, 0:101]
    pixel = 2 * np.tan(np.radians(20)) / 101
    inside = np.hypot(x - 50, y - 50) * pixel < np.tan(np.arcsin(1 / 5))
    assert np.array_equal(np.isfinite(depth), inside)
    assert image.rgba[50, 50, 0] > image.rgba[50, 50, 2]


def test_options_reach_the_renderer(blob: Blob) -> None:
    def picture(*options: str) -> bytes:
        assert blob("render", "hello.blob", "-o", "x.exr", "--size", "40x30", *options).code == 0
        return images.read("x.exr").rgba.tobytes()

    plain = picture()
    assert picture() == plain
    assert picture("--threads", "1") == plain
    assert picture("--samples", "4") != plain
    assert picture("--samples", "4", "--seed", "1") != picture("--samples", "4", "--seed", "2")
    assert picture("--native=auto") == plain
    assert len(picture("--region", "10,10,20,15")) != len(plain) or picture("--region", "10,10,20,15") != plain


def test_layers(blob: Blob) -> None:
    result = blob(
        "render", "hello.blob", "-o", "x.exr", "--size", "20x10", "--aov", "depth,normal,position,evaluations"
    )
    assert result.code == 0
    assert {"depth", "normal", "position", "evaluations"} <= set(images.read("x.exr").aov)


def test_every_layer_has_a_name(blob: Blob) -> None:
    """What the API can make, the command can: the tracer's counters, too."""
    assert set(AOVS) == set(LAYERS)
    assert blob("render", "hello.blob", "-o", "x.exr", "--size", "20x10", "--aov", ",".join(AOVS)).code == 0
    layers = images.read("x.exr").aov
    assert set(AOVS) <= set(layers)
    for name in ("evaluations", "nodes", "candidates", "spans"):
        assert layers[name].max() >= 1, name


def test_light_options(blob: Blob) -> None:
    def picture(*options: str, name: str = "x.exr") -> images.Image:
        result = blob("render", "hello.blob", "-o", name, "--size", "24x16", *options)
        assert result.code == 0, result.text
        return images.read(name)

    layers = picture("--noise", "0.05", "--samples", "32", "--aov", "direct,indirect,albedo,samples").aov
    assert {"direct", "indirect", "albedo", "samples"} <= set(layers)
    assert layers["direct"].shape == (16, 24, 3)
    assert 8 <= layers["samples"].min() <= layers["samples"].max() <= 32
    even, bounce = picture("--samples", "4", "--indirect", "even"), picture("--samples", "4")
    assert not np.array_equal(even.rgba, bounce.rgba)
    dark, bright = (picture("--samples", "1", "--exposure", e, name="x.png").rgba for e in ("-1", "1"))
    assert dark[:, :, :3].mean() < 0.6 * bright[:, :, :3].mean()
    film = picture("--samples", "1", "--tone", "film", name="x.png").rgba
    assert not np.array_equal(film, picture("--samples", "1", name="x.png").rgba)


def test_timing(blob: Blob) -> None:
    result = blob("render", "hello.blob", "-o", "x.png", "--size", "16x12", "--timing")
    parts = [line.split()[0] for line in result.out.splitlines()]
    assert parts == ["compile", "index", "hits", "shading", "output"]
    told = json.loads(
        blob("render", "hello.blob", "-o", "x.png", "--size", "16x12", "--timing", "--format", "json").out
    )
    assert list(told["timing"]) == parts
    assert all(seconds >= 0 for seconds in told["timing"].values())


@pytest.mark.parametrize(
    "options",
    [("--noise", "0"), ("--noise", "2"), ("--samples", "0"), ("--samples", "99999"), ("--indirect", "some"),
     ("--tone", "vivid"), ("--exposure", "x"), ("--aov", "direkt")],
)  # fmt: skip
def test_wrong_light_options(blob: Blob, options: tuple[str, str]) -> None:
    result = blob("render", "hello.blob", "-o", "x.png", *options)
    assert result.code == 2
    assert result.err.startswith("error: ")
    assert not Path("x.png").exists()


def test_json(blob: Blob) -> None:
    result = blob("render", "hello.blob", "-o", "x.png", "--size", "16x12", "--format", "json")
    told = json.loads(result.out)
    assert (told["files"], told["width"], told["height"], told["diagnostics"]) == (["x.png"], 16, 12, [])
    Path("bad.blob").write_text("surface { bal(radius = 1) }\n", encoding="utf-8")
    result = blob("render", "bad.blob", "-o", "y.png", "--format", "json")
    assert result.code == 1
    assert [d["code"] for d in json.loads(result.out)["diagnostics"]] == ["E0201"]


def test_a_picture_knows_where_it_comes_from(blob: Blob) -> None:
    blob("render", "lamp.blob", "-o", "x.png", "--size", "16x12", "--set", "drops=5")
    result = blob("info", "x.png")
    assert result.code == 0
    assert "16 x 12" in result.out
    assert "drops" in result.out
    told = json.loads(blob("info", "x.png", "--format", "json").out)
    assert told["provenance"]["script"] == "lamp.blob"
    scene = json.loads(blob("info", "lamp.blob", "--set", "drops=5", "--format", "json").out)
    assert told["provenance"]["hash"] == scene["hash"]


def test_info_of_a_scene(blob: Blob) -> None:
    text = blob("info", "lamp.blob").out
    assert "1 surface" in text
    assert "3 blobs" in text
    assert "drops: int = 3 in 1..20" in text
    facts = json.loads(blob("info", "hello.blob", "--format", "json").out)
    [surface] = facts["surfaces"]
    assert (surface["name"], surface["threshold"], surface["blobs"]) == ("surface 1", 0.5, 2)
    assert surface["bounds"] == [[-3.2, -2.0, -2.0], [3.2, 2.0, 2.0]]
    assert facts["camera"]["default"] is True


@pytest.mark.parametrize("content", [b"", b"not a picture", b"\x89PNG\r\n\x1a\n"])
def test_info_of_a_broken_picture(blob: Blob, content: bytes) -> None:
    Path("x.png").write_bytes(content)
    result = blob("info", "x.png")
    assert result.code == 3
    assert "E0801" in result.err


def test_hash_follows_the_scene_not_the_comments(blob: Blob) -> None:
    def hash_of(*argv: str) -> str:
        return json.loads(blob("info", *argv, "--format", "json").out)["hash"]

    plain = hash_of("lamp.blob")
    assert hash_of("lamp.blob", "--set", "drops=4") != plain
    Path("same.blob").write_text("// a comment\n" + Path("lamp.blob").read_text("utf-8"), encoding="utf-8")
    assert hash_of("same.blob") == plain


def test_interruption_is_quick_and_leaves_no_file(blob: Blob, tmp_path: Path) -> None:
    """Ctrl-C in the middle of a render that would take minutes."""
    rows = "\n".join(f"ball(({i % 9}, {i // 9}, 0), radius = 0.7)" for i in range(81))
    Path("slow.blob").write_text(f"surface {{\n{rows}\n}}\n", encoding="utf-8")
    command = [sys.executable, "-m", "blobscript.cli", "render", "slow.blob", "-o", "slow.png"]
    before = sorted(os.listdir())
    quickest = math.inf
    for _ in range(3):  # other work on the machine may delay one of them
        process = subprocess.Popen(
            [*command, "--size", "4000x4000", "--samples", "400"], stderr=subprocess.PIPE, cwd=tmp_path, text=True
        )
        assert process.stderr is not None
        assert process.stderr.readline().startswith("rendering: ")
        start = time.perf_counter()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        quickest = min(quickest, time.perf_counter() - start)
        assert process.returncode == 130
        assert err.endswith("interrupted\n")
        assert "Traceback" not in err
        assert sorted(os.listdir()) == before
        if quickest < 0.2:
            break
    assert quickest < 0.2
