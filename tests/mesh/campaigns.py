"""Meshes of many random scenes, and of many tiny balls: what must hold for all of them.

The suite runs a seeded share; tests/bench/mesh_campaigns.py runs all.
"""

from __future__ import annotations

import numpy as np
import random_scenes

import blobscript
from blobscript import ir
from blobscript.backends.native import Native
from blobscript.meshing import MeshError, Options, Part, bodies
from blobscript.meshing.measure import component_count, residual, shape_of, topology


def faults_of(part: Part, native: Native, threshold: float, size: float) -> list[str]:
    """What is wrong with a body: not closed, not oriented, inside out, off the surface."""
    body, faults = part.body, []
    shape = topology(body.triangles, len(body.vertices))
    if not shape.is_closed:
        faults.append(f"{part.name} is not closed: {shape}")
    if shape.euler % 2:
        faults.append(f"{part.name} has the Euler characteristic {shape.euler}")
    if len(np.unique(body.triangles)) != len(body.vertices):
        faults.append(f"{part.name} has vertices without a triangle")
    if not np.isfinite(body.vertices).all() or not np.isfinite(body.normals).all():
        faults.append(f"{part.name} has vertices that are no numbers")
    if shape_of(body.vertices, body.triangles).volume <= 0.0:
        faults.append(f"{part.name} is inside out")
    worst = float(residual(body.vertices, native, part.surface, threshold).max())
    if worst > 1e-12 * size:
        faults.append(f"{part.name} has a vertex {worst / size:.2g} scene sizes off the surface")
    return faults


def random_scene(seed: int) -> ir.Scene:
    rng = np.random.default_rng([seed, 1806])
    return random_scenes.random_scene(rng, depth=int(rng.integers(0, 4)))


def closed(seed: int, resolution: int = 20) -> list[str]:
    """Faults of the mesh of one random scene; surfaces without an inside are none."""
    scene = random_scene(seed)
    if scene.surfaces[0].threshold <= 0.0:
        return []
    native = Native(scene)
    try:
        parts = bodies(scene, native, Options(resolution=resolution, refine=seed % 3, threads=1))
    except MeshError:
        return []
    faults = []
    for part in parts:
        size = float(np.linalg.norm(np.ptp(part.body.vertices, axis=0)))
        faults += faults_of(part, native, scene.surfaces[part.surface].threshold, max(size, part.cell))
    return [f"seed {seed}: {fault}" for fault in faults]


def tiny_balls(seed: int, count: int, cell: float = 0.25) -> tuple[int, Part]:
    """Components of the mesh of `count` balls whose radius is half a cell, at least two cells apart, at random."""
    rng = np.random.default_rng([seed, 77])
    side = int(np.ceil(count ** (1 / 3)))
    places = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    centres = 4.0 * cell * rng.permutation(places)[:count] + rng.uniform(0.0, cell, (count, 3))
    items = "\n".join(f"  ball(({x!r}, {y!r}, {z!r}), radius = {cell / 2!r})" for x, y, z in centres.tolist())
    scene = blobscript.compile(f"surface {{\n{items}\n}}")
    parts = bodies(scene.ir, Native(scene.ir), Options(cell=cell))
    part = parts[0]
    return component_count(part.body.triangles, len(part.body.vertices)), part
