"""The Python API: loading, compiling, asking, and what it refuses."""

from __future__ import annotations

import json
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import blobscript

BALL = "surface(threshold = 0.5) { ball((0, 0, 0), radius = 1) }"
TWO = """
let left = surface(threshold = 0.25) { ball((-3, 0, 0), radius = 1) }
left
surface { ball((3, 0, 0), radius = 1) }
"""


@pytest.fixture(scope="module")
def ball() -> blobscript.Scene:
    return blobscript.compile(BALL)


# ---- making a scene ------------------------------------------------------------------------


def test_surfaces_have_names_and_thresholds() -> None:
    scene = blobscript.compile(TWO)
    assert [(s.name, s.threshold) for s in scene.surfaces] == [("left", 0.25), ("surface 2", 0.5)]
    assert "left" in repr(scene)


def test_load_with_parameters(tmp_path: Path) -> None:
    path = tmp_path / "a.blob"
    path.write_text("param r = 1.0 in 0.5..2\nsurface { ball(radius = r) }\n", encoding="utf-8")
    origins, directions = [[0.0, 0.0, 9.0]], [[0.0, 0.0, -1.0]]
    assert blobscript.load(path).first_hit(origins, directions).t[0] == pytest.approx(8.0, abs=1e-14)
    assert blobscript.load(str(path), params={"r": 2}).first_hit(origins, directions).t[0] == pytest.approx(7.0)
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.load(path, params={"r": 3.0})
    assert [d.code for d in caught.value.diagnostics] == ["E0601"]


def test_the_moment_of_a_film(tmp_path: Path) -> None:
    text = "surface { ball((time, phase, 0), radius = 1) }\n"
    path = tmp_path / "a.blob"
    path.write_text(text, encoding="utf-8")
    for scene in (blobscript.compile(text, time=2.0, phase=0.5), blobscript.load(path, time=2.0, phase=0.5)):
        assert scene.field([[2.0, 0.5, 0.0]])[0] == pytest.approx(1.0, abs=1e-12)
    assert blobscript.load(path).field([[0.0, 0.0, 0.0]])[0] == pytest.approx(1.0, abs=1e-12)


def test_compile_reads_files_below_its_base_only(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("x,y,z\n0,0,0\n1,0,0\n", encoding="utf-8")
    text = 'surface { balls(read_points("p.csv"), radius = 1) }'
    assert blobscript.compile(text, base=tmp_path).ir.surfaces[0].field.count == 2  # type: ignore[union-attr]
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile(text)
    assert caught.value.diagnostics[0].code in ("E0207", "E0801")


def test_errors_are_in_order_of_place() -> None:
    """Whichever pass finds them."""
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile("let a = 1 + true\nlet b = corral\nsurface { ball(radius = 1)\n")
    assert [(d.line, d.code) for d in caught.value.diagnostics] == [(1, "E0310"), (2, "E0201"), (3, "E0101")]


def test_errors_carry_everything(tmp_path: Path) -> None:
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile("surface { bal(radius = 1) }\nlet a = 1 + true\n", name="melt.blob")
    error = caught.value
    assert isinstance(error, blobscript.BlobscriptError)
    assert [(d.code, d.severity, d.line, d.column) for d in error.diagnostics] == [
        ("E0201", "error", 1, 11),
        ("E0310", "error", 2, 11),
    ]
    assert [(d.path, d.end_line, d.end_column) for d in error.diagnostics] == [
        ("melt.blob", 1, 14),
        ("melt.blob", 2, 12),
    ]
    assert str(error).startswith("melt.blob:1:11: error[E0201]:")


def test_missing_file() -> None:
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.load("nowhere.blob")
    missing = caught.value.diagnostics[0]
    assert (missing.code, missing.path, missing.line, missing.end_line) == ("E0801", "nowhere.blob", 0, 0)
    assert str(caught.value).startswith("nowhere.blob: error[E0801]:")


def test_warnings_stay_with_the_scene() -> None:
    scene = blobscript.compile("surface(threshold = 2) { ball(reach = 1, weight = 1) }")
    assert [d.code for d in scene.diagnostics] == ["W0401"]


# ---- the field -----------------------------------------------------------------------------


def test_field_and_gradient(ball: blobscript.Scene) -> None:
    points = np.random.default_rng(3).uniform(-2, 2, (500, 3))
    r = np.linalg.norm(points, axis=1) / 2
    expected = np.where(r < 1, 1 - 4 / 9 * r**6 + 17 / 9 * r**4 - 22 / 9 * r**2, 0)
    assert np.allclose(ball.field(points), expected, rtol=0, atol=1e-14)
    h = 1e-6
    for axis in range(3):
        step = h * np.eye(3)[axis]
        slope = (ball.field(points + step) - ball.field(points - step)) / (2 * h)
        assert np.allclose(ball.gradient(points)[:, axis], slope, rtol=0, atol=1e-8)


def test_field_of_each_surface() -> None:
    scene = blobscript.compile(TWO)
    points = [[-3.0, 0, 0], [3.0, 0, 0]]
    assert (scene.field(points, surface=0) > 0).tolist() == [True, False]
    assert (scene.field(points, surface=1) > 0).tolist() == [False, True]
    assert np.array_equal(scene.field(points, surface=-1), scene.field(points, surface=1))
    with pytest.raises(IndexError, match="no surface 2"):
        scene.field(points, surface=2)


@pytest.mark.parametrize("points", [[1.0, 2.0, 3.0], [[1.0, 2.0]], 5.0, [[[0.0, 0.0, 0.0]]]])
def test_points_of_the_wrong_shape(ball: blobscript.Scene, points: object) -> None:
    with pytest.raises(ValueError, match=r"\(n, 3\)"):
        ball.field(points)  # type: ignore[arg-type]


def test_no_points_no_values(ball: blobscript.Scene) -> None:
    assert ball.field([]).shape == (0,)
    assert ball.gradient(np.empty((0, 3))).shape == (0, 3)
    assert ball.first_hit([], []).t.shape == (0,)
    assert ball.any_hit([], []).shape == (0,)


# ---- rays ----------------------------------------------------------------------------------


def test_first_hit_has_everything(ball: blobscript.Scene) -> None:
    hits = ball.first_hit(
        [[0, 0, 5], [0, 0, 0], [0, 5, 5], [np.nan, 0, 0], [0, 0, 5]],
        [[0, 0, -2], [0, 3, 0], [0, 0, -1], [0, 0, 1], [0, 0, 0]],
    )
    assert hits.status.dtype == np.int8
    assert hits.status.tolist() == [1, 2, 0, 4, 4]
    assert hits.t[:2].tolist() == pytest.approx([4.0, 1.0], abs=1e-14)
    assert np.isposinf(hits.t[2:]).all()
    assert np.allclose(hits.position[:2], [[0, 0, 1], [0, 1, 0]], atol=1e-14)
    assert np.allclose(hits.normal[:2], [[0, 0, 1], [0, 1, 0]], atol=1e-14)
    assert np.isnan(hits.normal[2:]).all()
    assert np.isnan(hits.position[2:]).all()
    assert hits.surface.tolist() == [0, 0, -1, -1, -1]
    assert hits.evaluations.shape == (5,)
    assert hits.evaluations[0] > 0


def test_windows(ball: blobscript.Scene) -> None:
    """The window is (t_min, t_max]: a number, or one for each ray."""
    origins, directions = [[0.0, 0, 5]] * 4, [[0.0, 0, -1]] * 4
    hits = ball.first_hit(origins, directions, t_min=[0, 4.5, 6.5, 3], t_max=[3.9, math.inf, math.inf, 3])
    assert hits.status.tolist() == [0, 2, 0, 0]
    assert hits.t[1] == pytest.approx(6.0, abs=1e-14)
    assert ball.any_hit(origins, directions, t_min=[0, 4.5, 6.5, 3], t_max=[3.9, 9, 9, 3]).tolist() == [
        False,
        True,
        False,
        False,
    ]
    assert ball.first_hit(origins, directions, t_max=2.0).status.tolist() == [0] * 4


def test_one_origin_for_many_directions(ball: blobscript.Scene) -> None:
    assert ball.first_hit([[0, 0, 5]], [[0, 0, -1], [0, 0, 1]]).status.tolist() == [1, 0]
    with pytest.raises(ValueError, match="2 origins and 3 directions"):
        ball.first_hit(np.zeros((2, 3)), np.ones((3, 3)))


def test_any_kind_of_array_is_taken(ball: blobscript.Scene) -> None:
    origins = np.asfortranarray(np.tile([0, 0, 5], (6, 1)))[::2].astype(np.float32)
    directions = [(0, 0, -1)] * 3
    assert ball.first_hit(origins, directions).t.tolist() == pytest.approx([4.0] * 3)


@pytest.mark.parametrize("wrong", [{"search": "guess"}, {"index": "tree"}, {"normals": "up"}])
def test_unknown_choices(ball: blobscript.Scene, wrong: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong.values()))):
        ball.first_hit([[0, 0, 5]], [[0, 0, -1]], **wrong)  # type: ignore[arg-type]


def test_threads_do_not_change_a_bit() -> None:
    text = "surface {\n" + "\n".join(f"ball(({i % 5}, {i // 5}, 0), radius = 0.7)" for i in range(25)) + "\n}"
    scene = blobscript.compile(text)
    random = np.random.default_rng(5)
    origins, directions = random.uniform(-3, 8, (5000, 3)), random.normal(size=(5000, 3))
    one = scene.first_hit(origins, directions, threads=1)
    two = scene.first_hit(origins, directions, threads=3)
    assert one.t.tobytes() == two.t.tobytes()
    assert one.normal.tobytes() == two.normal.tobytes()
    with ThreadPoolExecutor(3) as pool:
        for other in pool.map(lambda _: scene.first_hit(origins, directions, threads=1), range(3)):
            assert other.t.tobytes() == one.t.tobytes()


# ---- results -------------------------------------------------------------------------------


def test_render(ball: blobscript.Scene, tmp_path: Path) -> None:
    image = ball.render(width=32, height=24, samples=2, threads=1, aov=("depth", "normal"))
    assert image.rgba.shape == (24, 32, 4)
    assert image.rgba.dtype == np.float32
    assert image.aov["depth"].shape == (24, 32)
    assert image.metadata["hash"] == ball.hash
    assert image.metadata["version"] == blobscript.__version__
    image.save(tmp_path / "x.exr")
    assert (tmp_path / "x.exr").exists()


def test_json_is_the_whole_scene_and_always_the_same(ball: blobscript.Scene) -> None:
    data = json.loads(ball.to_json())
    assert data["surfaces"][0]["threshold"] == 0.5
    assert blobscript.compile(BALL).to_json() == ball.to_json()


@pytest.mark.parametrize("search", ["sandwich", "bernstein", "interval", "segment", "sphere", "march"])
def test_every_search_finds_the_ball(ball: blobscript.Scene, search: str) -> None:
    hits = ball.first_hit([[0, 0, 5]], [[0, 0, -1]], search=search, tolerance=1e-7)  # type: ignore[arg-type]
    assert hits.status.tolist() == [1]
    assert hits.t[0] == pytest.approx(4.0, abs=1e-6)


@pytest.mark.parametrize("index", ["bvh", "grid", "octree", "bsp", "none"])
def test_every_index_finds_the_ball(ball: blobscript.Scene, index: str) -> None:
    hits = ball.first_hit([[0, 0, 5]], [[0, 0, -1]], index=index)  # type: ignore[arg-type]
    assert hits.t[0] == pytest.approx(4.0, abs=1e-14)


def test_step_belongs_to_march(ball: blobscript.Scene) -> None:
    assert ball.first_hit([[0, 0, 5]], [[0, 0, -1]], search="march", step=0.1).status.tolist() == [1]
    with pytest.raises(ValueError, match="'march'"):
        ball.first_hit([[0, 0, 5]], [[0, 0, -1]], step=0.1)
