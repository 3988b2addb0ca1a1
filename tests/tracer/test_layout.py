"""The structures of pack.py and library.py are those of scene.h and blob.h: sizes, offsets and the orders of
names, as the C compiler of this machine lays them out."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from blobscript import pack
from blobscript.backends import library, native
from blobscript.field import MATERIAL_ROW

TRACER = Path(__file__).parents[2] / "blobscript" / "tracer"

STRUCTURES = {
    "blob_piece": pack.BlobPiece,
    "blob_kernel": pack.BlobKernel,
    "blob_shape": pack.BlobShape,
    "blob_surface": pack.BlobSurface,
    "blob_node": pack.BlobNode,
    "blob_mesh": pack.BlobMesh,
    "blob_scene": pack.BlobScene,
    "blob_query": library.BlobQuery,
    "blob_hits": library.BlobHits,
}

CONSTANTS = {
    "BLOB_ABI": pack.ABI,
    "PIECE_DEGREE": pack.PIECE_DEGREE,
    "BLOB_MATERIAL": library.MATERIAL,
    "KERNEL_USER": pack.KERNEL_USER,
    **{f"KERNEL_{name.upper()}": number for name, number in pack.KERNEL_IDS.items()},
    **{f"OP_{name.upper()}": number for name, number in pack.OPS.items()},
    "SHAPE_POINT": pack.SHAPE_POINT,
    "SHAPE_LINE": pack.SHAPE_LINE,
    "SHAPE_TRIANGLE": pack.SHAPE_TRIANGLE,
    "SHAPE_MESH": pack.SHAPE_MESH,
    **{f"BLOB_SEARCH_{name.upper()}": i for i, name in enumerate(library.SEARCHES)},
    **{f"BLOB_INDEX_{name.upper()}": i for i, name in enumerate(library.INDEXES)},
    **{f"BLOB_NORMALS_{name.upper()}": i for i, name in enumerate(library.NORMALS)},
    **{f"BLOB_{name}": i for i, name in enumerate(library.STATUS)},
}


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Every size, offset and constant by name, from a C program that prints them."""
    lines = [f'printf("{name} %ld\\n", (long){name});' for name in CONSTANTS]
    for name, structure in STRUCTURES.items():
        lines.append(f'printf("{name} %zu\\n", sizeof({name}));')
        for field, *_ in structure._fields_:
            place = f"{name}.{field}"
            lines.append(f'printf("{place} %zu %zu\\n", offsetof({name}, {field}), sizeof((({name} *)0)->{field}));')
    folder = tmp_path_factory.mktemp("layout")
    source = folder / "layout.c"
    body = "\n    ".join(lines)
    source.write_text(f'#include <stdio.h>\n#include "scene.h"\n\nint main(void) {{\n    {body}\n    return 0;\n}}\n')
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert compiler, "the tracer was built on this machine: where is its compiler?"
    program = folder / "layout"
    subprocess.run([compiler, "-std=c17", f"-I{TRACER}", str(source), "-o", str(program)], check=True)
    printed = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    return {name: tuple(map(int, numbers)) for name, *numbers in map(str.split, printed.splitlines())}


@pytest.mark.parametrize("name", STRUCTURES)
def test_structure(name: str, measured: dict[str, tuple[int, ...]]):
    structure = STRUCTURES[name]
    assert measured[name] == (ctypes.sizeof(structure),)
    for field, *_ in structure._fields_:
        described = getattr(structure, field)
        assert measured[f"{name}.{field}"] == (described.offset, described.size), field


@pytest.mark.parametrize("name", CONSTANTS)
def test_constant(name: str, measured: dict[str, tuple[int, ...]]):
    assert measured[name] == (CONSTANTS[name],)


def test_the_library_is_of_this_version():
    assert library.load().blob_abi() == pack.ABI


def test_status_names_are_the_numbers_of_the_module():
    assert [getattr(native, name) for name in library.STATUS] == [0, 1, 2, 3, 4]


def test_a_material_row_has_as_many_numbers_as_the_c_expects():
    assert max(part.stop for part in MATERIAL_ROW.values()) == library.MATERIAL


def test_counters_are_the_last_arrays_of_hits():
    names = [name for name, _ in library.BlobHits._fields_]
    assert tuple(names[5:]) == native.COUNTERS
