"""The emitted C scene: it compiles without a word, renders what the library renders, and holds nothing else."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.emitting.compiled import library_text
from blobscript.emitting.facts import ABSENT
from blobscript.emitting.lexing import lexed
from blobscript.emitting.program import SOURCES
from blobscript.emitting.pruning import without_unread
from blobscript.emitting.sources import joined_sources

ROOT = Path(__file__).parent.parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.blob"))
COMPILERS = [name for name in ("gcc", "clang", "cc") if shutil.which(name)]
STRICT = ("-std=c17", "-Wall", "-Wextra", "-pedantic", "-Werror")

HELLO = "surface { ball((-1.2, 0, 0), radius = 1)\n ball((1.2, 0, 0), radius = 1) }"


def compiled(text: str, folder: Path, *flags: str, compiler: str = COMPILERS[0]) -> Path:
    source, program = folder / "scene.c", folder / "scene"
    source.write_text(text, encoding="utf-8")
    command = [compiler, *flags, str(source), "-o", str(program), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:4000]
    assert done.stderr == ""
    return program


def picture(program: Path, *size: int) -> np.ndarray:
    """(h, w, 3), row 0 on top, of the PFM on standard output."""
    data = subprocess.run([str(program), *map(str, size)], capture_output=True, check=True).stdout
    magic, shape, scale, body = data.split(b"\n", 3)
    assert magic == b"PF"
    width, height = map(int, shape.split())
    assert (width, height) == (size or (640, 480))
    kind = "<f4" if float(scale) < 0 else ">f4"
    return np.frombuffer(body, kind).reshape(height, width, 3)[::-1]


def assert_same(program: Path, scene: blobscript.Scene, width: int, height: int) -> None:
    """But for pixels where the last bits decide between two surfaces."""
    ours, theirs = picture(program, width, height), scene.render(width=width, height=height).rgba[..., :3]
    assert np.isfinite(ours).all()
    assert (np.abs(ours - theirs).max(axis=2) > 1e-4).mean() < 1e-3


# ---- it compiles ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_compilers_have_nothing_to_say(path: Path, tmp_path: Path) -> None:
    source = tmp_path / "scene.c"
    source.write_text(blobscript.load(path).to_c(), encoding="utf-8")
    for compiler in {"gcc", "clang"} & set(COMPILERS):
        command = [compiler, "-fsyntax-only", *STRICT, str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.stderr == "", done.stderr[:4000]


@pytest.mark.parametrize("name", ["kernels", "lamp", "gecko"])
def test_pictures_are_those_of_the_library(name: str, tmp_path: Path) -> None:
    """All kernels; glass, lamps, maps and paint; meshes, kernels of the script, and an index. No optimiser: quick."""
    scene = blobscript.load(ROOT / "examples" / f"{name}.blob")
    program = compiled(scene.to_c(), tmp_path, "-O1", *STRICT)
    assert_same(program, scene, 96, 72)


def test_sets_without_kernels_of_the_script(tmp_path: Path) -> None:
    """The call that fills their ranges hands back only lines of such kernels, which nobody reads here."""
    scene = blobscript.compile("surface { polygon([(-1, -1, 0), (1, -1, 0), (0, 1, 0)]).blob(radius = 0.2) }")
    assert_same(compiled(scene.to_c(), tmp_path, "-O0", *STRICT), scene, 40, 30)
    assert "packet_given(p, f, a, b, &ranges, &lines)" in library_text(scene.trimmed.scene, frozenset())


def test_calls_that_write_stay_where_nobody_reads_their_value() -> None:
    text = "void g(int *y) {\n    const int x = f(1, &y), z = 2;\n    const int u = h(*y);\n}\n"
    assert without_unread(text) == "void g(int *y) {\n    f(1, &y);\n}\n"
    assert without_unread("int g(int y) {\n    int x = f(&y), z = 2;\n    return z;\n}\n").count("x = f(&y)") == 1


def test_the_command_of_the_readme(tmp_path: Path) -> None:
    """cc -O2 scene.c -lm, all warnings on: the optimiser finds more to say."""
    scene = blobscript.compile(HELLO)
    program = compiled(scene.to_c(), tmp_path, "-O2", *STRICT)
    assert_same(program, scene, 120, 90)
    assert_same(program, scene, 60, 120)  # the default camera steps back
    assert picture(program).shape == (480, 640, 3)
    for wrong in (["7"], ["0", "5"], ["5x", "5"], ["99999", "2"], ["1", "2", "3"]):
        done = subprocess.run([str(program), *wrong], capture_output=True, check=False)
        assert done.returncode == 2
        assert b"usage" in done.stderr
        assert done.stdout == b""


def test_a_camera_of_the_script(tmp_path: Path) -> None:
    scene = blobscript.compile(f"{HELLO}\ncamera(from = (3, 2, 5), to = (0.5, 0, 0), fov = 30deg)\nbackground(white)")
    program = compiled(scene.to_c(), tmp_path, "-O1")
    for size in ((80, 60), (40, 90)):
        assert_same(program, scene, *size)


# ---- what is in it ----------------------------------------------------------------------------------------


def code_of(text: str) -> set[str]:
    """All names in a C text, comments aside."""
    return {token.text for token in lexed(text) if token.kind == "name"}


def test_nothing_that_is_not_needed_is_in_it() -> None:
    """By what only that feature has in the sources."""
    marks = {
        "user_at": "falloffs",  # kernels of the script
        "kernel_exp": "kernels",  # Gaussians
        "set_mesh": "gecko",
        "shape_line_pieces": "curves",
        "tree_plan": "bulge",
        "bvh_build": "palettes",
        "paint_lane": "molecule",
        "pattern_place": "",  # one ray a pixel
        "octree_build": "",
        "strategy_approach": "",  # other searches
        "trace_differences": "",  # other normals
        "sum_polish": "",  # teams of packets: for speed alone
        "joint_survey": "bulge",
        "sort_queue": "glass",  # rays that go on
        "cell_goes_on": "",  # samples as needed
        "point_scatter": "",  # light by chance
        "layers_write": "",
        "seconds_now": "",
    }
    texts = {
        name: code_of(blobscript.load(ROOT / "examples" / f"{name}.blob").to_c()) for name in {*marks.values()} - {""}
    }
    plain = code_of(blobscript.compile(HELLO).to_c())
    for mark, example in marks.items():
        assert mark in joined_sources(SOURCES)[1], f"the sources have no {mark} any more"
        assert mark not in plain
        assert not example or mark in texts[example]


def test_a_small_scene_is_a_small_file() -> None:
    whole = joined_sources(SOURCES)[1]
    text = blobscript.compile(HELLO).to_c()
    assert len(text) < 0.45 * len(whole)


@pytest.mark.parametrize("need", ABSENT)
def test_what_is_known_is_said_in_the_words_of_the_sources(need: str) -> None:
    """A fact about an expression that the tracer no longer has would do nothing."""
    text = "".join(joined_sources(SOURCES)[1].replace("\\\n", " ").split())
    for expression in ABSENT[need]:
        words = expression.rpartition(": ")[2]  # behind the function that it is known in
        assert "".join(words.split()) in text, f"{need}: {expression}"


def test_the_same_text_every_time(tmp_path: Path) -> None:
    script = tmp_path / "scene.blob"
    script.write_text(HELLO, encoding="utf-8")
    code = f"import blobscript; print(blobscript.load({str(script)!r}).to_c(), end='')"
    texts = {
        subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=seeded(seed)).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
    assert blobscript.load(script).to_c().encode() in texts


def seeded(seed: str) -> dict[str, str]:
    import os

    return os.environ | {"PYTHONHASHSEED": seed}


def data_of(text: str) -> str:
    """The part between the tracer and the program: what the scene alone decides."""
    return text[text.index("/* ==== the scene ==== */") : text.index("/* ==== the picture ==== */")]


def test_the_data_are_as_in_the_golden_file(request: pytest.FixtureRequest) -> None:
    scene = blobscript.compile(
        "surface(threshold = 0.25) {\n"
        "  point(0, 0.5, 0).blob(reach = 2, weight = 1, kernel = soft3)\n"
        "  line((1, 0, 0), (1, 2, 0)).blob(reach = 1, weight = -0.5, kernel = soft2)\n"
        "}\n"
        "camera(from = (0, 0, 8))\n"
        "background(#ff0000)\n"
        "sun((0, -1, 0), white, 2)\n"
    )
    text = re.sub(r"static const shade_picture.*", "", data_of(scene.to_c()), flags=re.DOTALL)
    golden = Path(__file__).parent / "golden.c"
    if request.config.getoption("--update-golden"):
        golden.write_text(text.strip() + "\n", encoding="utf-8")
    assert text.strip() == golden.read_text(encoding="utf-8").strip()


def test_the_head_names_what_is_in_the_file() -> None:
    """With one sample lights are points and everything is sharp: neither a lens nor soft shadows are in it."""
    text = f"{HELLO}\ncamera(from = (0, 0, 9), aperture = 0.2)\nlamp((0, 9, 0), white, 9, size = 1)\nfog(30)"
    scene = blobscript.compile(text)
    assert {"lens", "soft-shadows", "lamps", "fog"} <= scene.needs
    head = scene.to_c().partition("*/")[0]
    assert " fog (line 5" in head and "light from a place (line 4" in head
    assert "lens" not in head and "with a size" not in head


HOSTILE = '*/ int system(const char *); int main(void) { return system("true"); } /* ??/\n#error \\'


def test_hostile_texts_stay_out(tmp_path: Path) -> None:
    """Names of files, of materials and of surfaces, texts and comments of the script."""
    folder = tmp_path / "a *"
    folder.mkdir()
    script = folder / "x *_ ??'\"; } system() #error.blob"
    script.write_text(
        "// */ #error\n"
        'let name = "*/ #error \\" system("\n'
        "let system_error_main = surface(material = clay(red)) { ball(radius = 1) }\n"
        "system_error_main\n"
        'assert name != "", "x */ {name}"\n',
        encoding="utf-8",
    )
    scene = blobscript.load(script)
    text = scene.to_c()
    assert "#error" not in text
    assert "system" not in code_of(text)
    compiled(text, tmp_path, "-fsyntax-only", *STRICT)


def test_hostile_sources_have_clean_names() -> None:
    scene = blobscript.compile(HELLO, name=HOSTILE)
    text = scene.to_c()
    head = text[: text.index("*/") + 2]
    assert head.count("/*") == head.count("*/") == 1
    assert "system(" not in text
    assert "#error" not in text
    assert all(ord(c) < 128 for c in head)


def test_numbers_are_read_back_to_the_bit() -> None:
    from blobscript.emitting.data import number

    rng = np.random.default_rng(5)
    values = rng.integers(0, 2**63, 200, dtype=np.uint64).view(np.float64)
    for value in [*values[np.isfinite(values)].tolist(), 0.1, -0.0, 5e-324, 1.7976931348623157e308]:
        assert float(number(value)) == value
    assert (number(float("inf")), number(float("-inf")), number(7)) == ("INFINITY", "-INFINITY", "7")
