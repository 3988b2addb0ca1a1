"""`render --native`: a tracer compiled for a scene has the same hits, and where there is none, that is said."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest
from stress_data import cases, judge

import blobscript
from blobscript import cli
from blobscript.backends.native import Native
from blobscript.cli import native as native_cli
from blobscript.conditioning import tolerance
from blobscript.emitting import compiled as native

ROOT = Path(__file__).parent.parent.parent
BALLS = "surface { ball((-1.2, 0, 0), radius = 1)\n ball((1.2, 0, 0), radius = 1) }"


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory):
    """One cache for all, without the optimiser: quick to fill."""
    patch = pytest.MonkeyPatch()
    patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    patch.setattr(native, "_OPTIONS", tuple("-O1" if option == "-O3" else option for option in native._OPTIONS))
    yield native._folder()
    patch.undo()


def test_hits_are_those_of_the_library(cache: Path) -> None:
    scene = blobscript.compile(BALLS)
    lo, hi = np.array([-2.5, -1.5, -1.5]), np.array([2.5, 1.5, 1.5])
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(2000, 3)) * 4
    directions = rng.uniform(lo, hi, (2000, 3)) - origins
    theirs = scene.first_hit(origins, directions)
    seconds = scene.specialize()
    ours = scene.first_hit(origins, directions)
    assert seconds > 0
    np.testing.assert_array_equal(ours.status, theirs.status)
    hit = ours.hit
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    allowed = tolerance(scene.ir.surfaces[0], origins[hit], unit[hit], theirs.t[hit])
    assert (np.abs(ours.t[hit] - theirs.t[hit]) <= allowed).all()
    assert scene._tracer.library is not scene._native.library or scene.trimmed.scene is scene.ir
    assert len(list(cache.glob("*.so"))) == 1
    assert not [path for path in cache.iterdir() if path.suffix != ".so"]


def test_one_tracer_serves_all_scenes_of_its_needs(cache: Path) -> None:
    blobscript.compile(BALLS).specialize()
    before = len(list(cache.glob("*.so")))
    other = "surface { ball(radius = 2)\n ball((2, 0, 0), radius = 0.5) }"
    assert blobscript.compile(other).specialize() == 0.0
    assert blobscript.compile(f'{other}\nfog(30)\ntone("film")\nfloor(y = -2)').specialize() == 0.0  # light is a call's
    assert len(list(cache.glob("*.so"))) == before
    assert native.cached(blobscript.compile(BALLS).ir)


def test_grazing_rays_have_their_certified_answers(cache: Path) -> None:
    """One compilation, for sums of points with one kernel, serves several cases of the catalogue."""
    first = next(case for case in cases() if case.group == "graze" and case.scene is not None)
    library, _ = native.compiled(first.scene)
    place = native._place(first.scene, native.find_compiler())
    same = [c for c in cases() if c.scene is not None and native._place(c.scene, native.find_compiler()) == place]
    assert same
    for case in same:
        tracer = Native(case.scene, library)
        assert judge(case, tracer.first_hit(case.origins, case.directions, case.t_min, case.t_max)) == []


def test_pictures_are_those_of_the_library(cache: Path) -> None:
    scene, other = blobscript.compile(BALLS), blobscript.compile(BALLS)
    scene.specialize()
    a, b = scene.render(width=64, height=48, samples=4), other.render(width=64, height=48, samples=4)
    assert (np.abs(a.rgba - b.rgba).max(axis=2) > 1e-3).mean() < 0.01


def test_the_command_uses_it(cache: Path, tmp_path: Path, capsys) -> None:
    script = tmp_path / "balls.blob"
    script.write_text(BALLS, encoding="utf-8")
    assert (
        cli.main(
            ["render", str(script), "-o", str(tmp_path / "a.png"), "--size", "32x24", "--samples", "1", "--native"]
        )
        == 0
    )
    assert "note" not in capsys.readouterr().err
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize("compiler", ["/no/such/compiler", "false"])
def test_without_a_compiler_the_library_does(
    compiler: str, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)
    native.find_compiler.cache_clear()
    script, picture = tmp_path / "balls.blob", tmp_path / "a.png"
    script.write_text(BALLS, encoding="utf-8")
    assert cli.main(["render", str(script), "-o", str(picture), "--size", "32x24", "--samples", "1", "--native"]) == 0
    native.find_compiler.cache_clear()
    assert "the bundled tracer is used" in capsys.readouterr().err
    assert picture.exists()


def test_what_it_does_not_have_is_said(cache: Path, tmp_path: Path, capsys) -> None:
    script = tmp_path / "balls.blob"
    script.write_text(BALLS, encoding="utf-8")
    argv = ["render", str(script), "-o", str(tmp_path / "a.png"), "--size", "32x24", "--samples", "1", "--native"]
    assert cli.main([*argv, "--search", "march"]) == 0
    assert "default search" in capsys.readouterr().err


def test_a_broken_object_goes(cache: Path) -> None:
    scene = blobscript.compile("surface { point(0, 0, 0).blob(radius = 1, kernel = soft2) }")
    path = native._place(scene.ir, native.find_compiler())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"no object")
    with pytest.raises(native.NativeError, match="cannot be loaded"):
        native.compiled(scene.ir)
    assert not path.exists()


def test_an_unwritable_cache_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "blobscript").write_text("a file", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(native.NativeError, match="cannot be written"):
        native.compiled(blobscript.compile(BALLS).ir)


@pytest.mark.parametrize(("seconds", "pays"), [(0.001, False), (3.0, True)])
def test_auto_compiles_where_it_pays(seconds: float, pays: bool, tmp_path: Path, monkeypatch) -> None:
    """By how long a small picture takes."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    clock = iter([0.0, seconds, seconds, seconds])
    monkeypatch.setattr(native_cli.time, "perf_counter", lambda: next(clock))
    scene = blobscript.compile(BALLS)
    done: list[bool] = []
    monkeypatch.setattr(type(scene), "render", lambda self, *size, **options: None)
    monkeypatch.setattr(type(scene), "specialize", lambda self: done.append(True))
    arguments = argparse.Namespace(native="auto", search="sandwich", index="bvh", normals="analytic", threads=1)
    native_cli.use_native(scene, arguments, 640, 480, {"samples": 1})
    assert bool(done) == pays
