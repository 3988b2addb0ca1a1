"""A scene from a stranger reads nothing outside its folder, however it asks."""

from __future__ import annotations

import os
import re
import zipfile
from pathlib import Path

import pytest
from language.compiling import errors_of, evaluate, run

from blobscript import load

SECRET = "let secret = 42\n"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A folder with a scene's files, and something beside it that is none of its business."""
    folder = tmp_path / "scene"
    (folder / "parts").mkdir(parents=True)
    (tmp_path / "outside.blob").write_text(SECRET)
    (tmp_path / "outside.csv").write_text("x,y,z\n1,2,3\n")
    (tmp_path / "outside.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "inside.blob").write_text("let open_ = 1\n")
    (folder / "inside.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")
    (folder / "parts" / "near.blob").write_text('import open_ from "../inside.blob"\nlet near = open_ + 1\n')
    (folder / "parts" / "far.blob").write_text('import secret from "../../outside.blob"\nlet far = secret\n')
    (folder / "link.blob").symlink_to(tmp_path / "outside.blob")
    (folder / "link.csv").symlink_to(tmp_path / "outside.csv")
    (folder / "up").symlink_to(tmp_path)
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "good_link.blob").symlink_to(folder / "inside.blob")
    return folder


PATHS = [
    "../outside{}",
    "parts/../../outside{}",
    "{root}/outside{}",
    "link{}",
    "up/outside{}",
    "./parts/.././../outside{}",
    "/proc/self/environ",
    "/etc/passwd",
    "../scene/../outside{}",
]


@pytest.mark.parametrize("path", PATHS)
def test_imports_stay_inside(scene: Path, path: str) -> None:
    name = path.replace("{root}", str(scene.parent)).replace("{}", ".blob")
    assert errors_of(f'import secret from "{name}"', folder=scene) == [("E0207", 1)]
    assert errors_of(f'import "{name}" as other', folder=scene) == [("E0207", 1)]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("use", ["read_points", "points", "mesh", "read_records"])
def test_data_stays_inside(scene: Path, path: str, use: str) -> None:
    name = path.replace("{root}", str(scene.parent)).replace("{}", ".obj" if use == "mesh" else ".csv")
    if use == "mesh" and path.startswith("link"):
        return
    found = errors_of(f'let a = {use}("{name}")', folder=scene)
    assert found == [("E0207", 1)] or ("." not in name and found == [("E0803", 1)])


def test_below_the_folder_is_fine(scene: Path) -> None:
    assert errors_of('import near from "parts/near.blob"\nassert near == 2', folder=scene) == []
    assert errors_of('import open_ from "good_link.blob"', folder=scene) == []
    assert errors_of('import open_ from "up/scene/inside.blob"', folder=scene) == []
    assert evaluate('read_points("inside.csv")[1]', folder=scene) == "(4, 5, 6)"


def test_an_import_leads_no_further(scene: Path) -> None:
    _, found = run('import far from "parts/far.blob"\nsurface { ball(radius = far) }', folder=scene)
    (error,) = found
    assert (error.code, error.line) == ("E0207", 1)
    assert error.span is not None
    assert error.span.source.path.endswith("far.blob")
    assert [label.span.text for label in error.labels] == ['"parts/far.blob"']


def test_without_a_folder_nothing_is_read() -> None:
    assert errors_of('import a from "inside.blob"') == [("E0207", 1)]
    assert errors_of('let a = read_points("inside.csv")') == [("E0207", 1)]


def test_what_is_no_script(scene: Path) -> None:
    (scene / "binary.blob").write_bytes(bytes(range(256)))
    (scene / "folder.blob").mkdir()
    os.mkfifo(scene / "pipe.blob")
    (scene / "large.blob").write_text("// " + "x" * 5_000_000)
    for name in ("binary", "folder", "pipe", "large"):
        assert errors_of(f'import a from "{name}.blob"', folder=scene) == [("E0204", 1)], name
    assert errors_of('import a from "loop"', folder=scene) in ([("E0204", 1)], [("E0207", 1)])
    assert errors_of('import a from ""', folder=scene) == [("E0204", 1)]


def test_the_library_reads_nothing(scene: Path) -> None:
    for path in ("std.../inside", "std", "inside", "std.curves.x"):
        codes = {code for code, _ in errors_of(f"import a from {path}", folder=scene)}
        assert codes
        assert codes <= {"E0204", "E0101", "E0103", "E0104"}


ODD = [
    "http://127.0.0.1:9/a{}",
    "file:///etc/hosts{}",
    "~/a{}",
    "$HOME/a{}",
    "..\\\\outside{}",
    "%2e%2e/outside{}",
    "C:\\\\a{}",
    "a\0{}",
    "a" * 5000 + "{}",
    "{}",
    "/dev/zero",
    "/dev/stdin",
    ".",
    "",
    "pipe{}",
    "large{}",
    "pickle{}",
]
USES = {
    "mesh": (".obj", 'surface {{ mesh("{}").blob(radius = 1) }}'),
    "points": (".csv", 'surface {{ points("{}").blob(radius = 1) }}'),
    "read_records": (".json", 'let a = read_records("{}")'),
    "environment": (".exr", 'environment("{}")'),
    "glb": (".glb", 'surface {{ mesh("{}").blob(radius = 1) }}'),
}


@pytest.mark.parametrize("use", USES)
def test_odd_names_and_files_are_told(scene: Path, use: str) -> None:
    """None is followed, waited for, run or read to its end: pipes, devices, addresses, pickles, 3 GB of nothing."""
    ending, text = USES[use]
    os.mkfifo(scene / f"pipe{ending}")
    with (scene / f"large{ending}").open("wb") as large:
        large.truncate(3 << 30)
    ran = scene.parent / "ran"
    (scene / f"pickle{ending}").write_bytes(b"cos\nsystem\n(S'touch " + os.fsencode(ran) + b"'\ntR.")
    for name in ODD:
        found = errors_of(text.format(name.format(ending)), folder=scene)
        assert found, name
        assert {code for code, _ in found} <= {"E0207", "E0801", "E0803", "E0304"}, name
    assert not ran.exists()


def test_entities_of_xml_are_not_read(scene: Path) -> None:
    """A 3MF file that asks for another file, and one that grows without end."""
    grown = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
    for kind in ('<!ENTITY x SYSTEM "../outside.csv">', f'<!ENTITY l0 "lol">{grown}<!ENTITY x "&l9;">'):
        with zipfile.ZipFile(scene / "a.3mf", "w") as archive:
            archive.writestr(
                "3D/3dmodel.model",
                f'<?xml version="1.0"?><!DOCTYPE a [{kind}]><model><resources><object id="1"><mesh><vertices>'
                '<vertex x="&x;" y="0" z="0"/></vertices></mesh></object></resources></model>',
            )
        assert errors_of('surface { mesh("a.3mf").blob(radius = 1) }', folder=scene) == [("E0801", 1)]


def test_names_cannot_leave_the_comments_of_other_languages(tmp_path: Path) -> None:
    """A path with the end of a C comment, a line break and quotes, in the C and POV-Ray texts."""
    folder = tmp_path / "a*" / "evil;"
    folder.mkdir(parents=True)
    path = folder / 'b "q" \n#fopen X "y" write\n.blob'
    path.write_text("let egg = surface { ball(radius = 1) }\negg\n")
    scene = load(str(path))
    assert not re.search(r"^\s*#fopen|\*/.*evil", scene.to_pov() + scene.to_c(), re.MULTILINE)


# ---- records from files ------------------------------------------------------------------


@pytest.fixture
def data(tmp_path: Path) -> Path:
    (tmp_path / "a.csv").write_text("name,x,y,z,n\nC,1,2,3,7\nO,4,5,6.5,8\n")
    (tmp_path / "a.json").write_text(
        '[{"at": [1, 2, 3], "kind": "C", "on": true}, {"at": [0, 0, 1], "kind": "O", "on": false}]'
    )
    (tmp_path / "a.xyz").write_text("2\nwater\nO 0 0 0\nH 1 0 0.5\n")
    return tmp_path


def test_the_columns_are_the_type(data: Path) -> None:
    assert evaluate('[for (r in read_records("a.csv")) r.n + 1]', folder=data) == "[8, 9]"
    assert evaluate('read_records("a.csv")[1].name', folder=data) == '"O"'
    assert evaluate('map(read_records("a.xyz"), fn(a) = a.at.x)', folder=data) == "[0, 1]"
    assert evaluate('find(read_records("a.xyz"), where = fn(a) = a.kind == "H").at', folder=data) == "(1, 0, 0.5)"
    assert evaluate('[for (r in read_records("a.json")) if (r.on) r.kind]', folder=data) == '["C"]'
    assert errors_of('let a = read_records("a.csv")[0].nme', folder=data) == [("E0203", 1)]


def test_a_declared_type(data: Path) -> None:
    rows = 'let rows: [(name: text, n: number)] = read_records("a.csv")\n'
    assert evaluate("rows[0].n / 2", rows, folder=data) == "3.5"
    assert errors_of(rows + "let a = rows[0].x", folder=data) == [("E0203", 2)]
    wrong = 'let rows: [(name: number, age: number)] = read_records("a.csv")'
    _, found = run(wrong, folder=data)
    assert found[0].code == "E0304"
    assert found[0].notes == ("its column `name` is a text, not a number", "the file has no column `age`")


def test_a_file_that_is_not_known_yet(data: Path) -> None:
    text = 'param file = "a.xyz" in ["a.xyz", "b.xyz"]\nlet rows{} = read_records(file)\nassert rows[0].kind == "O"'
    assert errors_of(text.format(""), folder=data) == [("E0305", 2)]
    assert errors_of(text.format(": [(at: vec3, kind: text)]"), folder=data) == []
    assert errors_of(text.format(": [(at: vec3, kind: text)]"), folder=data, params={"file": "b.xyz"}) == [("E0801", 2)]


def test_missing_and_broken_files(data: Path) -> None:
    assert errors_of('let a = read_records("nowhere.csv")\nlet b = a[0].x', folder=data) == [("E0801", 1)]
    assert errors_of('let a = read_points("nowhere.csv")\nlet b = a[0].x', folder=data) == [("E0801", 1)]
    (data / "bad.json").write_text("[1, 2")
    assert errors_of('let a = read_records("bad.json")', folder=data) == [("E0801", 1)]


def test_columns_cost_no_steps(data: Path) -> None:
    """A column of a file is an array: no step per row, no Python object per row."""
    lines = "\n".join(f"{i},{i % 7},0,{1 + i % 3}" for i in range(20_000))
    (data / "big.csv").write_text(f"x,y,z,size\n{lines}\n")
    text = (
        'let rows = read_records("big.csv")\n'
        "surface { balls([for (r in rows) r.at], radius = map(rows, fn(r) = r.size)) }"
    )
    scene, found = run(text, folder=data, budget=1_000)
    assert scene is not None, found
    assert (
        errors_of('let p = read_points("big.csv")\nassert len(p) == 20000 and p[6].y == 6', folder=data, budget=100)
        == []
    )
