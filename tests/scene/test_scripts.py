"""The scene's part of the language through scripts: numbers, places of errors, and many blobs."""

from __future__ import annotations

import time

import numpy as np
import pytest

from blobscript import field as reference
from blobscript import ir
from blobscript.driver import compile_source
from blobscript.source import Source
from blobscript.verify import verify


def compiled(text: str, folder=None) -> ir.Scene:
    scene, found = compile_source(Source("test.blob", text, str(folder) if folder else None))
    assert scene is not None, [d.message for d in found]
    assert found == []
    verify(scene)
    return scene


def codes(text: str, folder=None) -> list[tuple[str, int, str]]:
    """(code, line, text at the place) of every finding."""
    found = compile_source(Source("test.blob", text, str(folder) if folder else None))[1]
    return [(d.code, d.line, d.span.text.split("\n")[0] if d.span else "") for d in found]


def value(text: str, *point: float) -> float:
    surface = compiled(text).surfaces[0]
    return float(reference.field_value(surface.field, np.array([point], dtype=float))[0])


@pytest.mark.parametrize(
    "body, point, expected",
    [
        ("ball(radius = 1)", (1, 0, 0), 0.5),
        ("ball((1, 2, 3), reach = 2, weight = 3)", (1, 2, 3), 3),
        ("line((0, 0, 0), (4, 0, 0)).blob(radius = 1)", (2, 1, 0), 0.5),
        ("polyline([(0, 0, 0), (4, 0, 0), (4, 4, 0)]).blob(radius = 1)", (5, 2, 0), 0.5),
        ("polyline([(0, 0, 0), (4, 0, 0), (0, 4, 0)], closed = true).blob(radius = 1)", (-1, 2, 0), 0.5),
        ("polygon([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)]).blob(radius = 1)", (2, 2, -1), 0.5),
        ("polyhedron([(0, 0, 0), (4, 0, 0), (0, 4, 0), (0, 0, 4)], "
         "faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).blob(reach = 1)", (0.5, 0.5, 0.5), 1),
        ("mesh([(0, 0, 0), (4, 0, 0), (0, 4, 0)], faces = [[0, 1, 2]]).blob(radius = 1)", (1, 1, 1), 0.5),
        ("points([(0, 0, 0), (0.5, 0, 0)]).blob(reach = 1)", (0, 0, 0), 1),
        ("balls([(0, 0, 0), (0, 0, 0)], reach = 1)", (0, 0, 0), 2),
        ("balls([(0, 0, 0), (5, 0, 0)], radius = [1, 2])", (7, 0, 0), 0.5),
        ("max { ball(reach = 1)\n ball(reach = 2, weight = 2) }", (0, 0, 0), 2),
        ("min { ball(reach = 1)\n ball(reach = 2, weight = 2) }", (0, 0, 0), 1),
        ("ball(reach = 1) + 2 * ball(reach = 1) - ball(reach = 1)", (0, 0, 0), 2),
        ("ball(reach = 1).scale(2, 1, 1).rotate(z = 90deg)", (0, 1, 0), 0.5),
        ("ball((1, 0, 0), reach = 1).mirror((1, 0, 0))", (-1, 0, 0), 1),
        ("ball(reach = 1).move(y = 3).apply(identity.move(x = 2))", (2, 3, 0), 1),
        ("line((0, 0, 0), (1, 0, 0)).scale(x = 3).blob(reach = 1)", (3, 0, 0), 1),
        ("sum(kernel = soft2) { ball(reach = 1) }", (0.5, 0, 0), 0.5625),
        ("ball(reach = 1, kernel = gauss(a = 2))", (1, 0, 0), np.exp(-2)),
    ],
)  # fmt: skip
def test_fields(body, point, expected):
    assert value(f"surface {{ {body} }}", *point) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("ball(radius = 0)", ("E0405", 2, "0")),
        ("ball(radius = 0 - 1)", ("E0405", 2, "0 - 1")),
        ("ball(reach = -2)", ("E0405", 2, "-2")),
        ("ball((1e300 * 1e300, 0, 0), radius = 1)", ("E0405", 2, "(1e300 * 1e300, 0, 0)")),
        ("ball(weight = 1)", ("E0302", 2, "ball(weight = 1)")),
        ("ball(radius = 1, reach = 2, weight = 3)", ("E0406", 2, "3")),
        ("ball(radius = 1, reach = 1)", ("E0406", 2, "ball(radius = 1, reach = 1)")),
        ("ball(radius = 1, weight = 0.5)", ("E0406", 2, "ball(radius = 1, weight = 0.5)")),
        ("polyline([]).blob(radius = 1)", ("E0404", 2, "[]")),
        ("polygon([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)]).blob(radius = 1)",
         ("E0404", 2, "[(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)]")),
        ("mesh([(0, 0, 0)], faces = [[0, 0, 1]]).blob(radius = 1)", ("E0403", 2, "[[0, 0, 1]]")),
        ("ball(radius = 1).scale(0)", ("E0405", 2, "0")),
        ("ball(radius = 1, kernel = gauss(a = 0))", ("E0405", 2, "0")),
        ("balls([(0, 0, 0)], radius = [1, 2])", ("E0405", 2, "[1, 2]")),
        ('balls(read_points("../x.csv"), radius = 1)', ("E0207", 2, '"../x.csv"')),
        ('balls(read_points("x.csv"), radius = 1)', ("E0801", 2, '"x.csv"')),
        ('balls(read_points("x.dat2"), radius = 1)', ("E0803", 2, '"x.dat2"')),
        ("ball(reach = 1, weight = 0)", ("W0406", 2, "ball(reach = 1, weight = 0)")),
        ("ball((9, 0, 0), reach = 1, weight = -1)", ("W0406", 2, "ball((9, 0, 0), reach = 1, weight = -1)")),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_surface(tmp_path, text, expected):
    assert codes(f"surface {{\n{text}\nball(radius = 2)\n}}", tmp_path) == [expected]


@pytest.mark.parametrize(
    "text, expected",
    [
        ("surface(threshold = 1.2) { ball(reach = 1) }", ("W0401", 1, "1.2")),
        ("surface { }", ("W0401", 1, "surface { }")),
        ("surface(threshold = -1) { ball(reach = 1) }", ("W0407", 1, "-1")),
        ("surface(threshold = 0) { ball(radius = 1) }", ("E0406", 1, "ball(radius = 1)")),
        ("let rock = surface { ball(radius = 1) }\nsurface { ball(radius = 1) }", ("W0402", 1, "rock")),
        ("surface { ball(radius = 1) }\ncamera(from = (0, 0, 9), to = (0, 0, 99))",
         ("W0403", 1, "surface { ball(radius = 1) }")),
        ("surface { ball(radius = 1) }\ncamera(from = (0, 0, 0.5))", ("W0404", 2, "camera(from = (0, 0, 0.5))")),
        ("surface { ball(radius = 1) }\ncamera(from = (0, 0, 9))\ncamera(from = (0, 0, 8))",
         ("E0402", 3, "camera(from = (0, 0, 8))")),
        ("surface { ball(radius = 1) }\nimage(width = 0)", ("E0405", 2, "0")),
        ("surface { ball(radius = 1) }\nsun(toward = (0, 0, 0))", ("E0405", 2, "(0, 0, 0)")),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_scene(text, expected):
    assert codes(text) == [expected]


def test_nothing_to_see():
    ((code, line, _),) = codes("let a = 1\n")
    assert (code, line) == ("E0401", 2)


def test_names_of_surfaces():
    scene = compiled("let egg = surface { ball(radius = 1) }\negg.move(x = 2)\nsurface { ball(radius = 1) }")
    assert [surface.name for surface in scene.surfaces] == ["egg", "surface 2"]


def test_blobs_know_who_made_them():
    scene = compiled("surface {\n  ball(radius = 1)\n  ball((1, 0, 0), radius = 1)\n}")
    leaf = scene.surfaces[0].field
    assert [scene.spans[i].line for i in leaf.origin] == [2, 3]


def test_records_become_balls(tmp_path):
    (tmp_path / "water.xyz").write_text("3\nwater\nO 0 0 0\nH 0.76 0.59 0\nH -0.76 0.59 0\n")
    text = """
    let atoms: [(kind: text, at: vec3)] = read_records("water.xyz")
    surface { for (a in atoms) { ball(a.at, radius = if (a.kind == "O") 0.6 else 0.4) } }
    """
    leaf = compiled(text, tmp_path).surfaces[0].field
    assert leaf.reach == pytest.approx([1.2, 0.8, 0.8])


def test_loops_of_balls_are_quick():
    """A third of a second on a slow machine; the limit only catches a lost vectorisation."""
    text = "surface { for (i in 0..<100) { for (j in 0..<100) { ball((i, j, 0), radius = 0.6) } } }"
    start = time.process_time()
    scene = compiled(text)
    assert time.process_time() - start < 2
    assert scene.surfaces[0].field.count == 10_000
