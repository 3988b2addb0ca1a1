"""The stress catalogue from the text of a script on: what must be refused is refused, what must be told is told, and
every certified answer comes out of `blobscript.compile(…).first_hit`. (test_stress.py: all searches and indexes.)"""

from __future__ import annotations

from typing import Any

import pytest
import stress_data

import blobscript
from blobscript.diagnostics import ProgramError

CASES = stress_data.cases()
_KERNELS = {"D1": "soft3", "D2": "wyvill", "D3": "gauss", "D3c": "gauss_c1", "D4": "metaball", "POV": "soft2"}
#: What the script itself says of a number that is none.
_NAN = "(0 / 0)"


def number(value: Any) -> str:
    return _NAN if float(value) != float(value) else repr(float(value))


def vector(p: Any) -> str:
    return f"({', '.join(map(number, p))})"


def vectors(points: Any) -> str:
    return f"[{', '.join(map(vector, points))}]"


def skeleton(leaf: dict[str, Any]) -> str:
    faces = f", faces = {leaf['f']}" if "f" in leaf else ""
    match leaf["prim"]:
        case "point":
            return f"point({vector(leaf['c'])})"
        case "segment":
            return f"line({vector(leaf['a0'])}, {vector(leaf['b0'])})"
        case "polyline":
            return f"polyline({vectors(leaf['pts'])})"
        case "triangle":
            return f"mesh({vectors(leaf['v'])}, faces = [[0, 1, 2]])"
        case "polygon" if "tris" in leaf:  # which way a quad that is not flat is cut
            return f"mesh({vectors(leaf['v'])}, faces = {leaf['tris']})"
        case "polygon":
            return f"polygon({vectors(leaf['v'])})"
        case "convex":
            return f"polyhedron({vectors(leaf['v'])}{faces})"
        case "mesh":
            return f"mesh({vectors(leaf['v'])}{faces})"
        case _:
            return f"mesh({vectors(leaf['v'])}{faces}, solid = true)"


def field(tree: dict[str, Any]) -> str:
    if "op" in tree:
        return f"{tree['op']} {{\n" + "\n".join(map(field, tree["children"])) + "\n}"
    a = f"(a = {number(tree['a'])})" if "a" in tree else ""
    kernel = _KERNELS[tree["kernel"]] + a
    return f"{skeleton(tree)}.blob(reach = {number(tree['R'])}, weight = {number(tree['w'])}, kernel = {kernel})"


def script(case: stress_data.Case) -> str:
    scene = case.raw["scene"]
    return f"blobscript 1\nsurface(threshold = {number(scene['T'])}) {{\n{field(scene['tree'])}\n}}\n"


@pytest.mark.parametrize("case", [c for c in CASES if c.expect_load == "error"], ids=lambda case: case.id)
def test_what_cannot_be_is_refused(case: stress_data.Case):
    """With an error that points into the script, and never as a mistake of blobscript."""
    with pytest.raises(ProgramError) as refused:
        blobscript.compile(script(case))
    errors = [found for found in refused.value.diagnostics if found.severity == "error"]
    assert errors
    assert all(found.span is not None and found.code.startswith("E0") for found in errors)


@pytest.mark.parametrize("case", [c for c in CASES if c.expect_load != "error"], ids=lambda case: case.id)
def test_certified_answers_from_a_script(case: stress_data.Case):
    scene = blobscript.compile(script(case))
    if case.expect_load == "warn":
        assert scene.diagnostics
    hits = scene.first_hit(case.origins, case.directions, case.t_min, case.t_max)
    assert stress_data.judge(case, hits) == []
