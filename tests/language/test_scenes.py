"""The scenes of the design, the standard library and the examples go through all passes."""

from __future__ import annotations

from pathlib import Path

import pytest
from language.compiling import run

from blobscript.check import check
from blobscript.parse import parse
from blobscript.resolve import resolve
from blobscript.source import Source
from blobscript.verify import verify

ROOT = Path(__file__).parent.parent.parent
SCENES = sorted((ROOT / "tests" / "data" / "language").glob("*.blob"))
LIBRARY = sorted((ROOT / "stdlib").rglob("*.blob"))

#: Scene -> its surfaces, and how many blobs they have.
EXPECTED = {
    "1_hello": (["surface 1"], 2),
    "2_kernels": (["surface 1", "surface 2", "surface 3", "surface 4"], 8),
    "3_lamp": (["surface 1"], 8),
    "4_molecule": (["surface 1"], 9),
    "5_gecko": (["gecko", "rock"], 36),
}


@pytest.mark.parametrize("path", SCENES, ids=[path.stem for path in SCENES])
def test_scene(path: Path) -> None:
    from blobscript.parts import count_blobs

    scene, found = run(path.read_text(encoding="utf-8"), name=path.name, folder=path.parent)
    assert scene is not None, found
    assert found == []
    verify(scene)
    names, blobs = EXPECTED[path.stem]
    assert [surface.name for surface in scene.surfaces] == names
    assert sum(count_blobs(surface.field) for surface in scene.surfaces) == blobs


@pytest.mark.parametrize("path", LIBRARY, ids=[path.stem for path in LIBRARY])
def test_library(path: Path) -> None:
    script, found = parse(Source(path.name, path.read_text(encoding="utf-8")))
    program, more = resolve(script)
    _, problems = check(program)
    assert [*found, *more, *problems] == []


def test_a_film_is_a_function_of_time() -> None:
    """The lamp of the design moves with `phase`, and its last frame meets its first."""
    path = SCENES[2]
    text = path.read_text(encoding="utf-8")
    scenes = [run(text, phase=phase)[0] for phase in (0.0, 0.5, 1.0)]
    heights = [[leaf.skeleton.at[:, 1].tolist() for leaf in leaves_of(scene)] for scene in scenes]
    assert heights[0] != heights[1]
    for first, last in zip(heights[0], heights[2], strict=True):
        assert first == pytest.approx(last, abs=1e-9)


def leaves_of(scene: object) -> list:
    """The leaves that are points."""
    from blobscript import ir

    assert isinstance(scene, ir.Scene)
    found: list[ir.Leaf] = []
    todo = [surface.field for surface in scene.surfaces]
    while todo:
        field = todo.pop()
        if isinstance(field, ir.Node):
            todo += field.children
        elif isinstance(field.skeleton, ir.Points):
            found.append(field)
    return found
