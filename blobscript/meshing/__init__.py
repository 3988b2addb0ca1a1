"""Scenes as triangles: marching cubes whose cost follows the surface, its files, and how good they are.

`grid` says where cells lie, `mesher` runs the tracer (the work is in `tracer/mesh*.[ch]`), `looks` gives vertices
their colours, `build` puts the bodies of a scene together, `relax` makes triangles more even, `files` writes them,
`measure` and `account` say how far they are from the surface. `reference` is the specification: the same on a dense
grid, in NumPy.
"""

from __future__ import annotations

from blobscript.meshing.build import MeshError, Options, Part, bodies, joined

__all__ = ["MeshError", "Options", "Part", "bodies", "joined"]
