"""What a scene does not need goes, what it needs is named, and no first hit changes."""

from __future__ import annotations

import json
from pathlib import Path

import conditioning
import numpy as np
import pytest
import random_scenes

import blobscript
from blobscript import cli, images, ir
from blobscript.backends.native import Native
from blobscript.ir import leaves
from blobscript.needs import needs_of, trimmed
from blobscript.needs.names import MEANINGS
from blobscript.verify import InvalidSceneError, verify


def counts(scene: blobscript.Scene) -> dict[str, int]:
    """What is left out, by kind."""
    found: dict[str, int] = {}
    for part in scene.trimmed.left_out:
        found[part.what] = found.get(part.what, 0) + part.count
    return found


def compiled(text: str) -> blobscript.Scene:
    scene = blobscript.compile(text)
    verify(scene.trimmed.scene)
    return scene


def blobs(scene: ir.Scene) -> int:
    return sum(leaf.count for surface in scene.surfaces for leaf in leaves(surface.field))


# ---- what goes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("extra", "why"),
    [
        ("ball((9, 0, 0), reach = 1, weight = 0.2)", "too weak to be seen"),
        ("ball((0.02, 0, 0), reach = 0.05, weight = 1)", "deep inside"),
        ("ball((9, 0, 0), reach = 1, weight = -2)", "takes away where nothing is"),
        ("ball((0, 0, 0), reach = 0.05, weight = -0.05)", "takes away too little, deep inside"),
        ("line((8, 0, 0), (9, 0, 0)).blob(reach = 0.5, weight = 0.3)", "a weak line"),
        ("polygon([(8, 0, 0), (9, 0, 0), (8, 1, 0)]).blob(reach = 0.5, weight = 0.3)", "a weak polygon"),
        ("ball((9, 0, 0), reach = 1, weight = 0.2).scale(y = 2)", "a weak ellipsoid"),
        ("point(9, 0, 0).blob(reach = 1, weight = 0.2, kernel = gauss(a = 4))", "a weak Gaussian"),
    ],
)
def test_what_touches_no_surface_goes(extra: str, why: str) -> None:
    scene = compiled(f"surface {{\n ball(radius = 1)\n {extra}\n}}")
    assert counts(scene)["blobs"] == 1, why
    assert blobs(scene.trimmed.scene) == 1
    assert scene.trimmed.left_out[0].span is not None
    assert scene.trimmed.left_out[0].span.line == 3


@pytest.mark.parametrize(
    "extra",
    [
        "ball((1.2, 0, 0), reach = 0.5, weight = 0.2)",
        "ball((0.9, 0, 0), reach = 0.5, weight = -0.2)",
        "ball((0, 0, 0), reach = 0.5, weight = -3)",
        "ball((9, 0, 0), radius = 0.01)",
    ],
)
def test_what_touches_a_surface_stays(extra: str) -> None:
    scene = compiled(f"surface {{\n ball(radius = 1)\n {extra}\n}}")
    assert scene.trimmed.scene is scene.ir
    assert scene.trimmed.left_out == ()


def test_a_weak_crowd_that_adds_up_stays() -> None:
    """Each alone is far below the threshold."""
    scene = compiled("surface { for (i in 0..<9) { ball((i / 100, 0, 0), reach = 1, weight = 0.1) } }")
    assert blobs(scene.trimmed.scene) == 9


def test_two_that_only_go_one_by_one_do_not_go_together() -> None:
    """Either of two negative blobs may go while the other one keeps the bump below the threshold."""
    pair = "for (x in [0.01, -0.01]) { ball((x, 0, 0), reach = 1, weight = -0.6) }"
    scene = compiled(f"surface {{ ball(reach = 1, weight = 0.7)\n {pair} }}")
    rays = np.array([[0.0, 0.0, 5.0]]), np.array([[0.0, 0.0, -1.0]])
    assert not scene.first_hit(*rays).hit.any()
    assert not Native(scene.ir).first_hit(*rays).hit.any()


def test_identical_blobs_are_folded() -> None:
    scene = compiled("surface { for (i in 0..<5) { ball(reach = 1, weight = 1) }\n ball((3, 0, 0), radius = 1) }")
    assert counts(scene) == {"blobs": 4}
    packed = scene._tracer.packed
    assert packed.scene.element_count == 2
    assert (packed.arrays["weight"] != 0.0).all()


def test_what_cancels_is_gone() -> None:
    scene = compiled(
        "surface { ball(radius = 1)\n for (w in [1e8, -1e8]) { ball((0.1, 0, 0), reach = 1, weight = w) } }"
    )
    assert counts(scene)["blobs"] == 2


def test_equal_children_of_max_count_once() -> None:
    rod = "let rod = line((0, 0, 0), (1, 0, 0)).blob(radius = 0.3)"
    scene = compiled(f"{rod}\nsurface {{ max {{ rod\n rod\n ball((0, 1, 0), radius = 1) }} }}")
    assert counts(scene) == {"blobs": 1}


def test_a_line_is_the_same_from_either_end() -> None:
    ends = "line((0, 0, 0), (1, 0.5, 0)).blob(radius = 0.3)\n line((1, 0.5, 0), (0, 0, 0)).blob(radius = 0.3)"
    assert counts(compiled(f"surface {{ {ends} }}")) == {"blobs": 1}
    assert counts(compiled(f"surface {{ {ends.replace('(0, 0, 0)', '(0, 0.1, 0)', 1)} }}")) == {}


@pytest.mark.parametrize("op", ["max", "smooth_max"])
@pytest.mark.parametrize("weak", ["ball((9, 0, 0), reach = 1, weight = 0.2)", "ball((0.1, 0, 0), radius = 0.2)"])
def test_a_node_goes_with_all_of_its_children_but_one(op: str, weak: str) -> None:
    scene = compiled(f"surface {{ {op} {{ ball(radius = 1)\n {weak} }} }}")
    assert isinstance(scene.trimmed.scene.surfaces[0].field, ir.Leaf)
    assert op not in scene.needs
    beside = compiled(f"surface {{ {op} {{ ball(radius = 1)\n ball((1, 0, 0), radius = 0.5) }} }}")
    assert beside.trimmed.scene is beside.ir


def test_a_node_stays_where_nothing_is_the_larger() -> None:
    """Where a density is negative, the maximum with one that is gone is 0."""
    scene = compiled(
        "surface { ball(radius = 1)\n max { ball((0.8, 0, 0), reach = 1, weight = -1)\n"
        " ball((9, 0, 0), reach = 1, weight = 0.2) } }"
    )
    rays = np.array([[0.8, 0.0, 5.0], [0.9, 0.0, 5.0]]), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    np.testing.assert_array_equal(scene.first_hit(*rays).t, Native(scene.ir).first_hit(*rays).t)


@pytest.mark.parametrize("beside", ["", "\n ball((9, 0, 0), reach = 0.2, weight = 0.1)"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_smooth_maximum_of_one_counts_only_what_is_positive(sign: int, beside: str) -> None:
    """Whether others were never there or have gone: of a ball that takes away it makes 0 (and what it takes away
    under a factor of -1), of any other the ball."""
    text = f"surface {{ ball(radius = 1)\n -smooth_max {{ ball((1, 0, 0), reach = 1, weight = {sign}){beside} }} }}"
    at = [[0.9, 0.0, 0.0], [0.5, 0.1, 0.0]]
    scene = compiled(text)
    alone = compiled("surface { ball(radius = 1) }").field(at)
    carved = alone - compiled("surface { ball((1, 0, 0), reach = 1, weight = 1) }").field(at)
    np.testing.assert_allclose(scene.field(at), carved if sign > 0 else alone, rtol=1e-14)
    np.testing.assert_allclose(Native(scene.trimmed.scene).field(np.array(at), 0), scene.field(at), rtol=1e-14)


#: Below 0 for 1/8 < r < 3/8 and so on: a negative weight adds there.
WAVE = "@allow(nonmonotone)\nkernel wave(r) = (1 - r^2)^2 * cos(720deg * r)\n"


@pytest.mark.parametrize(
    "fields",
    [
        "ball(reach = 2, weight = -2, kernel = wave)",
        "ball((0.5, 0, 0), radius = 0.3)\n ball(reach = 2, weight = -1.4, kernel = wave)",
        "ball(reach = 2, weight = 1, kernel = wave)\n ball(reach = 1, weight = -3)",
        "ball(reach = 2, weight = 0.45, kernel = wave)\n ball((0.5, 0, 0), reach = 0.8, weight = 0.7)",
        "max { polygon([(0, 0, 0), (1, 0, 0), (0, 1, 0)]).blob(reach = 1, weight = -2, kernel = wave)\n"
        " ball((9, 0, 0), reach = 1, weight = 0.2) }",
    ],
)
def test_a_kernel_below_zero_has_no_sign(fields: str) -> None:
    """Weights do not tell which way such a blob moves the surface; every hit is that of the whole scene."""
    scene = compiled(f"{WAVE}surface {{ {fields} }}")
    rng = np.random.default_rng(1)
    o = rng.normal(size=(2000, 3))
    o *= 3 / np.linalg.norm(o, axis=1, keepdims=True)
    d = rng.uniform(-1, 1, o.shape) - o
    whole, less = Native(scene.ir).first_hit(o, d), scene.first_hit(o, d)
    assert whole.hit.sum() > 50
    np.testing.assert_array_equal(less.status, whole.status)
    np.testing.assert_allclose(less.t, whole.t, rtol=1e-9)
    assert not any("takes nothing away" in warning.message for warning in scene.diagnostics)


def test_materials_lights_and_kernels_go_with_the_blobs() -> None:
    scene = compiled(
        """
surface(material = plastic) {
  ball(radius = 1).paint(red)
  point(9, 0, 0).blob(reach = 1, weight = 0.1, kernel = soft2).paint(metal)
}
sun((0, -1, 0), white, 1)
sun((0, -1, 0), white, 2)
sun((1, -1, 0), white, 0)
lamp((0, 0.1, 0), white, 5)
"""
    )
    assert counts(scene) == {"blobs": 1, "materials": 2, "kernels": 1, "lights": 3}
    left = scene.trimmed.scene
    assert (len(left.materials), len(left.lights)) == (1, 1)
    assert left.lights[0].color == pytest.approx((3, 3, 3))
    assert "paint" not in scene.needs
    assert "kernel-soft2" not in scene.needs


def test_a_lamp_in_glass_shines_through() -> None:
    scene = compiled("surface(material = glass) { ball(radius = 1) }\nlamp((0, 0, 0), white, 5)")
    assert "lights" not in counts(scene)


def test_an_empty_surface_keeps_its_number() -> None:
    scene = compiled("surface { ball(reach = 1, weight = 0.1) }\nsurface { ball(radius = 1) }")
    hits = scene.first_hit([[0, 0, 5.0]], [[0, 0, -1.0]])
    assert hits.surface.tolist() == [1]
    assert blobs(scene.trimmed.scene) == 1
    assert "several-surfaces" not in scene.needs


def test_the_paint_of_what_takes_away_is_never_seen() -> None:
    scene = compiled("surface { ball(radius = 1)\n ball((1, 0, 0), reach = 0.4, weight = -2).paint(red) }")
    assert counts(scene) == {"materials": 1}
    assert "paint" not in scene.needs


# ---- nothing changes --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(14))
def test_hits_stay_within_the_conditioned_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scenes.random_scene(rng, depth=3, surfaces=2)
    less = trimmed(scene).scene
    try:
        verify(scene)
    except InvalidSceneError:
        pass  # a node of one child, which the tracer takes and scripts never make
    else:
        verify(less)
    rays = [random_scenes.random_rays(rng, scene, 100), random_scenes.grazing_rays(rng, scene, 40)]
    o, d = (np.vstack([pair[k] for pair in rays]) for k in range(2))
    whole, part = Native(scene).first_hit(o, d), Native(less).first_hit(o, d)
    np.testing.assert_array_equal(part.surface, whole.surface)
    for number, surface in enumerate(scene.surfaces):
        hit = whole.surface == number
        if hit.any():
            allowed = conditioning.tolerance(surface, o[hit], d[hit], whole.t[hit])
            assert (np.abs(part.t[hit] - whole.t[hit]) <= allowed).all()


def test_the_random_scenes_do_lose_blobs() -> None:
    """So that the test above means something."""
    scenes = [random_scenes.random_scene(np.random.default_rng(seed), depth=3, surfaces=2) for seed in range(14)]
    assert sum(blobs(scene) - blobs(trimmed(scene).scene) for scene in scenes) > 20


def test_the_field_stays_what_the_script_says() -> None:
    scene = compiled("surface { ball(radius = 1)\n ball((9, 0, 0), reach = 1, weight = 0.2) }")
    assert scene.field([[9.0, 0.0, 0.0]])[0] == pytest.approx(0.2)
    assert np.abs(scene.gradient([[9.2, 0.0, 0.0]])).max() > 0.01


@pytest.mark.parametrize(("width", "height"), [(48, 36), (64, 24)])
def test_pictures_stay_what_they_are(width: int, height: int) -> None:
    """Also where the default camera fits another shape: it shows what it would show of the whole."""
    text = "surface { ball(radius = 1)\n ball((4, 1, 0), reach = 1, weight = 0.2)\n ball((1, 0, 0), radius = 0.7) }"
    scene = compiled(text)
    assert scene.trimmed.left_out
    whole = blobscript.Scene(scene.ir)
    whole.__dict__["trimmed"] = type(scene.trimmed)(scene.ir, ())
    a, b = (s.render(width=width, height=height, threads=1).rgba for s in (scene, whole))
    np.testing.assert_allclose(a, b, atol=1e-5)


# ---- names -------------------------------------------------------------------------------------------


def test_needs_have_names_and_lines() -> None:
    text = """surface(material = chrome) {
  max {
    ball(radius = 1).paint(red)
    line((0, 0, 0), (2, 0, 0)).blob(radius = 0.3, kernel = soft3).scale(y = 2)
  }
  ball((0.5, 0.9, 0), reach = 0.4, weight = -1)
}
surface { polygon([(0, 3, 0), (1, 3, 0), (0, 4, 0)]).blob(radius = 0.2) }
lamp((9, 9, 9), white, 99)
"""
    scene = compiled(text)
    lines = {need.name: need.span.line if need.span else None for need in needs_of(scene.trimmed.scene)}
    assert lines["kernel-soft3"] == 4
    assert lines["lines"] == 4
    assert lines["maps"] == 4
    assert lines["max"] == 3
    assert lines["negative-weights"] == 6
    assert lines["paint"] == 3
    assert lines["triangles"] == 8
    assert lines["several-surfaces"] == 8
    assert lines["reflection"] == 1
    assert lines["lamps"] == lines["shadows"] == 9
    assert scene.needs == frozenset(lines)
    assert not {"min", "refraction", "suns", "kernel-gauss", "meshes", "index"} & scene.needs


# ---- every name ---------------------------------------------------------------------------------------

PLAIN = """background(black)
sun((0, -1, 0), white, 1, angle = 0deg)
camera(from = (0, 0, 9))
surface { ball(radius = 1) }
"""

#: Need -> lines that cause it; the last of them does.
CAUSES = {
    "kernel-soft2": "surface { point(3, 0, 0).blob(radius = 1, kernel = soft2) }",
    "kernel-soft3": "surface { point(3, 0, 0).blob(radius = 1, kernel = soft3) }",
    "kernel-wyvill": "surface { point(3, 0, 0).blob(radius = 1, kernel = wyvill) }",
    "kernel-gauss": "surface { point(3, 0, 0).blob(radius = 1, kernel = gauss(a = 4)) }",
    "kernel-gauss_c1": "surface { point(3, 0, 0).blob(radius = 1, kernel = gauss_c1(a = 4)) }",
    "kernel-metaball": "surface { point(3, 0, 0).blob(radius = 1, kernel = metaball) }",
    "kernel-user": "kernel own(r) = (1 - r * r)^4\nsurface { point(3, 0, 0).blob(radius = 1, kernel = own) }",
    "points": "surface { point(3, 0, 0).blob(radius = 1) }",
    "lines": "surface { polyline([(3, 0, 0), (4, 0, 0), (4, 1, 0)]).blob(radius = 1) }",
    "triangles": "surface { polygon([(3, 0, 0), (4, 0, 0), (3, 1, 0)]).blob(radius = 0.2) }",
    "meshes": "surface { mesh(points = [(3, 0, 0), (4, 0, 0), (3, 1, 0)], faces = [[0, 1, 2]]).blob(radius = 0.2) }",
    "solids": "let at = [(3, 0, 0), (4, 0, 0), (3, 1, 0), (3, 0, 1)]\n"
    "surface { polyhedron(at, faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).blob(radius = 0.2) }",
    "maps": "surface { ball((3, 0, 0), radius = 1).scale(y = 2) }",
    "negative-weights": "surface { ball((3, 0, 0), radius = 1) + ball((4, 0, 0), reach = 1, weight = -1) }",
    "max": "surface { max([ball((3, 0, 0), radius = 1), ball((4, 0, 0), radius = 1)]) }",
    "min": "surface { min([ball((3, 0, 0), radius = 1), ball((3.4, 0, 0), radius = 1)]) }",
    "smooth_max": "surface { smooth_max([ball((3, 0, 0), radius = 1), ball((4, 0, 0), radius = 1)]) }",
    "smooth_min": "surface { ball((3, 0, 0), radius = 2)"
    " - smooth_max([ball((3, 0, 0), radius = 1), ball((4, 0, 0), radius = 1)]) }",
    "several-surfaces": "surface { ball((3, 0, 0), radius = 1) }",
    "paint": "surface { ball((3, 0, 0), radius = 1) + ball((4, 0, 0), radius = 1).paint(red) }",
    "reflection": "surface(material = chrome) { ball((3, 0, 0), radius = 1) }",
    "refraction": "surface(material = glass) { ball((3, 0, 0), radius = 1) }",
    "absorption": "surface(material = glass(green)) { ball((3, 0, 0), radius = 1) }",
    "emission": "surface(material = material(emission = red)) { ball((3, 0, 0), radius = 1) }",
    "textures": "fn check(p: vec3) = if (p.x > 3) red else blue\n"
    "surface(material = clay(check)) { ball((3, 0, 0), radius = 1) }",
    "bumps": "fn rough(p: vec3) = 0.01 * sin(20rad * p.x)\n"
    "surface(material = material(bump = rough)) { ball((3, 0, 0), radius = 1) }",
    "suns": "sun((0, -1, 0), white, 1)",
    "lamps": "lamp((0, 9, 0), white, 1)",
    "shadows": "lamp((0, 9, 0), white, 1)",
    "soft-shadows": "lamp((0, 9, 0), white, 1, size = 0.5)",
    "sky": "sky()",
    "environment": 'environment("around.exr")',
    "floor": "floor(y = -1)",
    "shadow-catcher": "floor(y = -1, catch = true)",
    "fading": "floor(y = -1, fade = 30)",
    "fog": "fog(30)",
    "lens": "camera(from = (0, 0, 9), aperture = 0.2)",
    "film-tone": 'tone("film")',
    "exposure": 'tone("linear", exposure = 1)',
    "index": "surface { for (i in 0..<33) { ball((3 + i, 0, 0), radius = 1) } }",
}

#: What every scene of its kind has: here a scene without is the special one.
WITHOUT = {
    "kernel-wyvill": "surface { point(3, 0, 0).blob(radius = 1, kernel = soft2) }",
    "points": "surface { line((3, 0, 0), (4, 0, 0)).blob(radius = 1) }",
    "suns": "lamp((0, 9, 0), white, 1)",
    "shadows": "sky()",
}


def of_lines(base: str, lines: str) -> str:
    """A base script with more lines, and without its own line of the same kind where a scene has one."""
    word = lines.split("\n")[-1].partition("(")[0].split()[0]
    kinds = {"sky": "background", "environment": "background", "lamp": "sun"}
    own = kinds.get(word, word)
    left = [line for line in base.splitlines() if not line.startswith(own) or word == "surface"]
    return "\n".join([*left, lines])


def lines_of_needs(text: str, folder: Path) -> dict[str, int | None]:
    path = folder / "scene.blob"
    path.write_text(text, encoding="utf-8")
    images.Image(np.ones((4, 8, 4), np.float32)).save(folder / "around.exr")
    return {n.name: n.span.line if n.span else None for n in needs_of(blobscript.load(path).trimmed.scene)}


def test_every_name_is_tried() -> None:
    assert CAUSES.keys() | {"background-gradient"} == MEANINGS.keys()


@pytest.mark.parametrize("need", CAUSES)
def test_every_need_has_its_line(need: str, tmp_path: Path) -> None:
    text = of_lines(PLAIN, CAUSES[need])
    lone = need in ("kernel-wyvill", "points")  # the plain scene has them, too
    assert lines_of_needs(text, tmp_path)[need] == (4 if lone else len(text.splitlines()))


@pytest.mark.parametrize("need", [name for name in MEANINGS if name != "background-gradient"])
def test_and_is_not_there_without(need: str, tmp_path: Path) -> None:
    text = PLAIN
    if need in WITHOUT:
        text = "\n".join(line for line in PLAIN.splitlines() if not line.startswith(("surface", "sun", "background")))
        text += "\n" + WITHOUT[need]
        text += "" if "surface" in WITHOUT[need] else "\nsurface { ball(radius = 1) }"
    assert need not in lines_of_needs(text, tmp_path)


def test_a_material_may_ask_in_every_way(tmp_path: Path) -> None:
    """Parts that depend on the place count as those that do not, a floor's as a surface's, a catching floor's not."""
    shine = "fn shine(p: vec3) = if (p.x > 0) red else blue\nfn share(p: vec3) = clamp(p.x, 0, 1)\n"
    own = "material(emission = shine, metalness = share)"
    found = lines_of_needs(f"{shine}{PLAIN}floor(y = -2, material = {own})", tmp_path)
    assert {name for name, line in found.items() if line == 7} == {"emission", "reflection", "textures", "floor"}
    caught = lines_of_needs(f"{PLAIN}floor(y = -2, catch = true)", tmp_path)
    assert {name for name, line in caught.items() if line == 5} == {"floor", "shadow-catcher"}


def test_default_light_and_background_have_no_line(tmp_path: Path) -> None:
    found = lines_of_needs("surface { ball(radius = 1) }", tmp_path)
    assert all(found[name] is None for name in ("background-gradient", "suns", "shadows", "soft-shadows"))


def test_one_name_for_one_scene_wherever_its_parts_stand(tmp_path: Path) -> None:
    """Floor, fog, tone and background know their lines; the hash of the scene does not."""
    around = 'floor(y = -1)\nfog(30)\ntone("film")\nsky()'
    plain = "\n".join(line for line in PLAIN.splitlines() if not line.startswith("background"))
    first, second = blobscript.compile(f"{plain}\n{around}"), blobscript.compile(f"// other\n\n{around} // x\n{plain}")
    assert first.hash == second.hash
    assert (first.ir.floor, first.ir.fog, first.ir.tone) == (second.ir.floor, second.ir.fog, second.ir.tone)
    assert first.ir.background == second.ir.background
    data = json.loads(first.to_json())
    assert [data[part]["span"]["line"] for part in ("floor", "fog", "tone", "background")] == [4, 5, 6, 7]


def test_a_catching_floor_wears_nothing() -> None:
    text = "camera(from = (0, 3, 9))\nsurface { ball(radius = 1) }\nfloor(y = -1, catch = true)"
    scene = compiled(text)
    assert counts(scene) == {"materials": 1}
    whole = blobscript.Scene(scene.ir)
    whole.__dict__["trimmed"] = type(scene.trimmed)(scene.ir, ())
    a, b = (s.render(width=32, height=24, samples=4, threads=1).rgba for s in (scene, whole))
    assert a.tobytes() == b.tobytes()
    rough = "fn rough(p: vec3) = 0.1 * sin(20rad * p.x)\n"
    assert counts(compiled(rough + text.replace("surface", "surface(material = material(bump = rough))"))) == {}


def test_the_command_tells_them(tmp_path, capsys) -> None:
    script = tmp_path / "two.blob"
    script.write_text("surface {\n  ball(radius = 1)\n  ball((9, 0, 0), reach = 1, weight = 0.2)\n}\n")
    assert cli.main(["info", str(script), "--needs"]) == 0
    out = capsys.readouterr().out
    assert f"{script}:2  ball(radius = 1)" in out
    assert "1 blob: they touch no surface" in out
    assert cli.main(["info", str(script), "--needs", "--format", "json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["left_out"][0] | {"path": ""} == {
        "what": "blobs",
        "count": 1,
        "why": "they touch no surface",
        "path": "",
        "line": 3,
        "column": 3,
        "text": "ball((9, 0, 0), reach = 1, weight = 0.2)",
    }
    assert {need["name"] for need in facts["needs"]} == {
        "kernel-wyvill",
        "points",
        "suns",
        "shadows",
        "soft-shadows",
        "background-gradient",
    }
