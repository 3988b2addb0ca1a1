"""Data files: what is read, what is refused and how that is told."""

from __future__ import annotations

import errno
import json
import os
import struct
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript import meshfiles
from blobscript.values import Color, MakerError, Table


@pytest.fixture
def read(tmp_path, make_in):
    """read(name, text, maker) writes a file and reads it back."""
    make = make_in(tmp_path)

    def reader(name, text, maker="read_points", **arguments):
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return getattr(make, maker)(file=name, **arguments)

    return reader


def refusal(call, *arguments, **named) -> MakerError:
    with pytest.raises(MakerError) as caught:
        call(*arguments, **named)
    return caught.value


# ---- points --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "x,y,z\n1,2,3\n4,5,6\n",
        "x,y,z\r\n1,2,3\r\n4,5,6",
        "\ufeffX, Y, Z\n1, 2, 3\n4, 5, 6\n",
        "# comment\n\nx;y;z\n1;2;3\n4;5;6\n",
        "name\tz\ty\tx\nC\t3\t2\t1\nO\t6\t5\t4\n",
        "1,2,3\n4,5,6\n",
        "1 2 3\n4  5  6\n",
        "  1 2 3 0.5\n  4 5 6 0.7\n",
        'x,y,z\n"1","2","3"\n"4","5","6"\n',
        "1,2,3\n# between\n\n4,5,6\n\n",
    ],
)
def test_csv_points(read, text):
    points = read("p.csv", text)
    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert points.flags.c_contiguous


@pytest.mark.parametrize(
    "text",
    [
        "[[1, 2, 3], [4, 5, 6]]",
        '[{"x": 1, "y": 2, "z": 3}, {"x": 4, "y": 5, "z": 6, "kind": "O"}]',
        '[{"at": [1, 2, 3]}, {"at": [4, 5, 6.0]}]',
    ],
)
def test_json_points(read, text):
    assert read("p.json", text).tolist() == [[1, 2, 3], [4, 5, 6]]


def test_xyz_points(read):
    assert read("p.xyz", "2\nwater\nO 1 2 3\nH 4 5 6 0.1\n").tolist() == [[1, 2, 3], [4, 5, 6]]
    assert read("q.xyz", "1 2 3\n4 5 6\n").tolist() == [[1, 2, 3], [4, 5, 6]]


def test_a_header_without_rows_is_no_points(read):
    assert read("p.csv", "x,y,z\n").shape == (0, 3)
    assert read("p.json", "[]").shape == (0, 3)


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("p.csv", "x,y,z\n1,2,3\n4,five,6\n", "line 3: `five` is not a number"),
        ("p.csv", "x,y,z\n1,2,3\n4,5\n", "line 3 has 2 values"),
        ("p.csv", "1,2,3\n4,,6\n", "line 2: `` is not a number"),
        ("p.csv", "x;y;z\n1,5;2;3\n", "line 2: `1,5` is not a number"),
        ("p.csv", "x,y\n1,2\n", "no column `z`"),
        ("p.csv", "1,2\n3,4\n", "a point needs three"),
        ("p.csv", "", "no rows"),
        ("p.csv", "a" * 200_000 + ",b,c\n", "line 1"),
        ("p.csv", "x,y,z\n" + "1" * 200_000 + ",b,c\n", "line 2"),
        ("p.csv", "\n# nothing\n", "no rows"),
        ("p.csv", "x,y,z\n1,2,nan\n", "point 1 is not finite"),
        ("p.csv", "x,y,z\n1,2,3\n1,2,1e400\n", "point 2 is not finite"),
        ("p.csv", b"\x89PNG\0\0", "not a text"),
        ("p.csv", b"x,y,z\n1,2,\xff\n", "line 2 is not UTF-8"),
        ("p.csv", "x,y,z\n1,2,1_000\n", "`1_000` is not a number"),
        ("p.json", "[[1, 2, 3], [4, 5]]", "item 1"),
        ("p.json", "[[1, 2, 3]", "line 1, column"),
        ("p.json", '{"a": 1}', "no list"),
        ("p.json", "[[1, 2, NaN]]", "NaN"),
        ("p.json", "[" * 100_000, "too deep"),
        ("p.json", "[[1, 2, 1" + "0" * 400 + "]]", "not finite"),
        ("p.json", '[["1", 2, 3]]', "item 0"),
        ("p.json", "[[true, 2, 3]]", "item 0"),
        ("p.xyz", "two\n\n", "line 1 must be the number of atoms"),
        ("p.xyz", "3\ncomment\nO 1 2 3\n", "3 atoms"),
        ("p.xyz", "1\ncomment\nO 1 2\n", "line 3"),
        ("p.xyz", "1\ncomment\nO 1 2 z\n", "line 3: `z`"),
        ("p.xyz", "9" * 5000 + "\n\n", "atoms"),
        ("p.xyz", "", "line 1"),
    ],
)
def test_bad_points(read, name, text, words):
    error = refusal(read, name, text)
    assert error.code == "E0801"
    assert error.argument == "file"
    assert name in error.message
    assert words in error.message


# ---- records -------------------------------------------------------------------------


def test_csv_records(read):
    table = read("p.csv", "name,x,y,z,n,on\nC,1,2,3.5,7,true\nO,4,5,6,8,false\n", "read_records")
    assert list(table) == [
        {"name": "C", "x": 1, "y": 2, "z": 3.5, "n": 7, "on": True, "at": (1, 2, 3.5)},
        {"name": "O", "x": 4, "y": 5, "z": 6, "n": 8, "on": False, "at": (4, 5, 6)},
    ]
    assert type(table[0]["n"]) is int
    assert type(table[0]["z"]) is float
    assert table[-1]["name"] == "O"
    assert table.column("at").shape == (2, 3)


def test_numeric_csv_records(read):
    table = read("p.csv", "x,y,z,radius\n1,2,3,0.5\n4,5,6,0.25\n", "read_records")
    assert isinstance(table, Table)
    assert table.column("radius").tolist() == [0.5, 0.25]
    assert table.column("at").tolist() == [[1, 2, 3], [4, 5, 6]]


def test_quoted_csv_records(read):
    table = read("p.csv", 'name,n\n"a, b",1\n"two\nlines",2\n', "read_records")
    assert [row["name"] for row in table] == ["a, b", "two\nlines"]


def test_xyz_records(read):
    table = read("p.xyz", "2\nwater\nO 1 2 3\nH 4 5 6\n", "read_records")
    assert list(table) == [{"kind": "O", "at": (1, 2, 3)}, {"kind": "H", "at": (4, 5, 6)}]


def test_json_records(read):
    rows = [{"at": [1, 2, 3], "n": 1, "w": 0.5, "name": "C", "on": True, "to": {"k": [1, 2]}}] * 2
    table = read("p.json", json.dumps(rows), "read_records")
    assert table[0] == {"at": (1, 2, 3), "n": 1, "w": 0.5, "name": "C", "on": True, "to": {"k": [1, 2]}}
    assert type(table[0]["n"]) is int
    assert table.column("at").shape == (2, 3)


def test_tables_are_lists(read):
    table = read("p.csv", "a,b\n1,x\n2,y\n3,z\n", "read_records")
    assert len(table) == 3
    assert [row["b"] for row in table[1:]] == ["y", "z"]
    with pytest.raises(IndexError):
        table[3]


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("p.csv", "1,2,3\n", "names no columns"),
        ("p.csv", "a,a\n1,2\n", "two columns are called `a`"),
        ("p.csv", "a,,b\n1,2,3\n", "column 2 has no name"),
        ("p.csv", "a,b\n1,2\nx\n", "line 3 has 1 value"),
        ("p.json", "[1]", "item 0"),
        ("p.json", '[{"a": 1}, {"b": 1}]', "different fields"),
        ("p.json", '[{"a": 1}, {"a": 1, "b": 1}]', "`b`"),
    ],
)
def test_bad_records(read, name, text, words):
    error = refusal(read, name, text, "read_records")
    assert error.code == "E0801"
    assert words in error.message


# ---- files ---------------------------------------------------------------------------


def test_unknown_formats(read):
    assert refusal(read, "p.dat2", "1 2 3").code == "E0803"
    assert refusal(read, "points", "1 2 3").code == "E0803"
    assert refusal(read, "p.blend", "x", "mesh").code == "E0803"
    assert refusal(read, "p.zip", "x", "mesh").code == "E0803"


def locked_open(path, *arguments, **named):
    if Path(path).name == "secret.csv":
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return open(path, *arguments, **named)


@pytest.mark.parametrize(
    "name, code, words",
    [
        ("missing.csv", "E0801", "no such file"),
        ("sub.csv", "E0801", "folder"),
        ("pipe.csv", "E0801", "not a file"),
        ("secret.csv", "E0801", "permission"),
        ("../outside.csv", "E0207", "outside"),
        ("sub.csv/../../outside.csv", "E0207", "outside"),
        ("link.csv", "E0207", "outside"),
        ("linked/outside.csv", "E0207", "outside"),
        ("/etc/passwd.csv", "E0207", "outside"),
        ("/etc/passwd", "E0207", "outside"),
        ("../../etc/passwd", "E0207", "outside"),
        ("/dev/zero.csv", "E0207", "outside"),
        ("a\0b.csv", "E0801", "no file name"),
        ("loop.csv", "E0801", ""),
        ("x" * 5000 + ".csv", "E0801", ""),
    ],
)
def test_files_that_must_not_or_cannot_be_read(tmp_path, make_in, monkeypatch, name, code, words):
    scene = tmp_path / "scene"
    scene.mkdir()
    (tmp_path / "outside.csv").write_text("1,2,3\n")
    (scene / "sub.csv").mkdir()
    os.mkfifo(scene / "pipe.csv")
    (scene / "secret.csv").write_text("1,2,3\n")
    (scene / "secret.csv").chmod(0)
    (scene / "link.csv").symlink_to(tmp_path / "outside.csv")
    (scene / "linked").symlink_to(tmp_path)
    (scene / "loop.csv").symlink_to(scene / "loop.csv")
    if os.access(scene / "secret.csv", os.R_OK):  # root may read everything: say no in the system's place
        monkeypatch.setattr("blobscript.datafiles.open", locked_open, raising=False)
    for maker in ("read_points", "read_records"):
        error = refusal(getattr(make_in(scene), maker), file=name)
        assert error.code == code
        assert words in error.message


def test_a_link_inside_the_folder_is_fine(tmp_path, make_in):
    (tmp_path / "real.csv").write_text("1,2,3\n")
    (tmp_path / "link.csv").symlink_to("real.csv")
    assert make_in(tmp_path).read_points(file="link.csv").tolist() == [[1, 2, 3]]


def test_modules_start_in_their_own_folder(tmp_path, make_in):
    (tmp_path / "parts").mkdir()
    (tmp_path / "real.csv").write_text("1,2,3\n")
    make = make_in(tmp_path / "parts")
    assert refusal(make.read_points, file="../real.csv").code == "E0207"
    make.context.root = str(tmp_path)
    assert make.read_points(file="../real.csv").tolist() == [[1, 2, 3]]


def test_scripts_without_a_folder_read_nothing(make):
    assert refusal(make.read_points, file="p.csv").code == "E0207"
    assert refusal(make.mesh, file="p.obj").code == "E0207"


def test_capital_letters(tmp_path, make_in):
    (tmp_path / "Atoms.csv").write_text("1,2,3\n")
    error = refusal(make_in(tmp_path).read_points, file="atoms.csv")
    if "no such file" in error.message:  # not on file systems without capitals
        assert "Atoms.csv" in error.helps[0].text


def test_read_files_are_sources_of_the_scene(tmp_path, make_in):
    (tmp_path / "p.csv").write_text("1,2,3\n")
    make = make_in(tmp_path)
    scene = make.good(make.surface(children=make.balls(at=make.read_points(file="p.csv"), radius=1)))
    assert scene.sources[0][0] == "p.csv"
    assert len(scene.sources[0][1]) == 64


# ---- many ----------------------------------------------------------------------------


def test_many_points_cost_no_python_object_each(tmp_path, make_in):
    """A generous bound: two objects per point would take far longer than the arrays do."""
    n = 200_000
    points = np.random.default_rng(0).uniform(-30, 30, (n, 3))
    np.savetxt(tmp_path / "p.csv", points, fmt="%.4f", delimiter=",", header="x,y,z", comments="")
    make = make_in(tmp_path)
    start = time.process_time()
    at = make.read_points(file="p.csv")
    scene = make.good(make.surface(children=make.balls(at=at, radius=0.1, paint=Color(1, 0, 0))))
    assert time.process_time() - start < 3
    leaf = scene.surfaces[0].field
    assert leaf.count == n
    assert np.abs(leaf.skeleton.at - points).max() < 1e-4


# ---- meshes --------------------------------------------------------------------------

OBJ = """# a square pyramid
mtllib ../../secret.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
v 0 0 1 1.0
vn 0 0 1
f 4 3 2 1
f 1//1 2//1 5//1
f 2/1 3/1 5/1
f -3 -2 -1
f 4 1 5
"""


def test_obj(read):
    mesh = read("p.obj", OBJ, "mesh", solid=True)
    assert mesh.solid
    assert len(mesh.triangles) == 6
    assert len(mesh.points) == 5


def test_obj_of_other_programs(read):
    """A byte order mark, indented lines, lines that go on, ends of lines as on Windows, points after their faces."""
    text = "\ufeffv 0 0 0\r\n  v 1 0 0\r\n\tv 0 1 0\r\nf 1 2 \\\r\n 4\r\nv 0 0 1\r\n"
    mesh = read("p.obj", text, "mesh")
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.triangles.tolist() == [[0, 1, 3]]


@pytest.mark.parametrize("deep", ["[" * 300_000, '{"a":' * 300_000, '["\\"[", ' * 300_000])
def test_json_that_nests_deep_is_refused(tmp_path, deep):
    """Within a script, too, where Python may recurse deeper than its C stack holds."""
    (tmp_path / "p.json").write_text(deep)
    (tmp_path / "p.gltf").write_text(deep)
    (tmp_path / "p.glb").write_bytes(
        b"glTF" + struct.pack("<IIII", 2, len(deep) + 20, len(deep), 0x4E4F534A) + deep.encode()
    )
    for field in (
        'balls(read_points("p.json"), radius = 1)',
        *(f'mesh("p.{e}").blob(radius = 1)' for e in ("gltf", "glb")),
    ):
        with pytest.raises(blobscript.ProgramError) as caught:
            blobscript.compile(f"surface {{ {field} }}", base=tmp_path)
        assert "nests too deep" in caught.value.diagnostics[0].message


def test_brackets_in_texts_do_not_nest(read):
    at = read("p.json", json.dumps([{"at": [1, 2, 3], "name": "[{" * 2000}]), "read_points")
    assert at.tolist() == [[1, 2, 3]]


def test_what_a_reader_stumbles_over_is_not_told(read):
    for ending, text in (("off", "x"), ("ply", b"ply\xff"), ("glb", b"g")):
        message = refusal(read, f"p.{ending}", text, "mesh").message
        assert not any(word in message for word in ("unpack", "codec", "index", "axis", "array")), message


@pytest.mark.parametrize("ending", ["stl", "ply", "off", "glb", "3mf"])
def test_formats_of_trimesh(tmp_path, make_in, ending):
    import trimesh

    trimesh.creation.box((1, 2, 3)).export(tmp_path / f"box.{ending}")
    mesh = make_in(tmp_path).mesh(file=f"box.{ending}", solid=True)
    assert len(mesh.points) == 8
    assert np.ptp(mesh.points, axis=0) == pytest.approx((1, 2, 3))


@pytest.mark.parametrize(
    "name, text, code, words",
    [
        ("p.obj", "v 0 0 0\nv 1 0\n", "E0801", "line 2"),
        ("p.obj", "v 0 0 0\nf 1 x 2\n", "E0801", "line 2"),
        ("p.obj", "v 0 0 0\n", "E0801", "no faces"),
        ("p.obj", "", "E0801", "no points"),
        ("p.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "E0801", "not finite"),
        ("p.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "E0403", "line 4 of `p.obj` names point 4, but it has 3 p"),
        ("p.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "E0403", "line 4 of `p.obj` names point 0"),
        ("p.obj", "v 0 0 0\nf -2 -1 -1\nv 1 0 0\n", "E0403", "line 2 of `p.obj` names point -2, but it has 1 point b"),
        ("p.stl", "not a mesh", "E0801", "p.stl"),
        ("p.stl", "", "E0801", "it is empty"),
        ("p.off", "no such thing", "E0801", "it is no good .off file"),
        ("p.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "E0801", "index outside the range"),
        ("p.ply", b"\x00\x01\x02", "E0801", "p.ply"),
        ("p.glb", b"glTF", "E0801", "p.glb"),
        ("p.3mf", b"PK\3\4broken", "E0801", "archive"),
        ("p.3mf", "no archive", "E0801", "p.3mf"),
        ("p.xyz", "1 2 3", "E0801", "p.xyz"),
        ("p.svg", "<svg/>", "E0803", "p.svg"),
        ("p.gltf", '{"buffers": [{"uri": "../secret.bin"}]}', "E0207", "secret.bin"),
    ],
)
def test_bad_meshes(read, name, text, code, words):
    error = refusal(read, name, text, "mesh")
    assert error.code == code
    assert words in error.message


def test_archives_that_unpack_to_too_much(tmp_path, make_in, monkeypatch):
    monkeypatch.setattr(meshfiles, "_LARGEST_ARCHIVE", 50_000)
    with zipfile.ZipFile(tmp_path / "bomb.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        for k in range(60):
            archive.writestr(f"3D/{k}.model", b"\0" * 1000)
    error = refusal(make_in(tmp_path).mesh, file="bomb.3mf")
    assert error.code == "E0801"
    assert "unpacks" in error.message


def test_gltf_buffers_outside_are_refused(tmp_path, make_in):
    import trimesh

    scene = tmp_path / "scene"
    scene.mkdir()
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box()))
    for name, content in files.items():
        (scene / name).write_bytes(content)
    assert len(make_in(scene).mesh(file="model.gltf").triangles) == 12
    buffer = next(name for name in files if name.endswith(".bin"))
    for name in files:
        if name.endswith(".bin"):
            (scene / name).rename(tmp_path / name)
    text = (scene / "model.gltf").read_text().replace(buffer.split("_")[0] + "_", "../" + buffer.split("_")[0] + "_")
    (scene / "model.gltf").write_text(text)
    assert refusal(make_in(scene).mesh, file="model.gltf").code == "E0207"
