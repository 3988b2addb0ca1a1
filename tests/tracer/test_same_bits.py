"""The same bits for any number of threads, in any order of calls, however often; the same hits within the
conditioned error for every instruction set, and for a ray alone or among others (sums in another order)."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import conditioning
import numpy as np
import pytest
import random_scenes
from random_scenes import make_leaf, make_scene
from tracer import campaigns
from tracer.methods import INDEXES, SEARCHES

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.library import load
from blobscript.backends.native import ENTER, EXIT, GRAZE, Hits, Native

ARRAYS = ("status", "t", "normal", "surface", "evaluations")


def assert_same_bits(a: Hits, b: Hits) -> None:
    for name in ARRAYS:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
    for name, counts in a.counters.items():
        np.testing.assert_array_equal(counts, b.counters[name])


def picture(seed: int = 0, count: int = 20_000) -> tuple[Native, np.ndarray, np.ndarray]:
    """Several thousand blobs, and more rays than fit into four calls."""
    rng = np.random.default_rng(seed)
    points = make_leaf(ir.Points(rng.uniform(-1, 1, (2000, 3))), ir.Kernel("soft2"), 0.15, 1.0)
    lines = make_leaf(
        ir.Lines(rng.uniform(-1, 1, (200, 3)), rng.uniform(-1, 1, (200, 3))), ir.Kernel("gauss", 6.0), 0.1, 1.0
    )
    scene = make_scene((points, 0.6), (ir.Node("max", (lines, points)), 0.9))
    return Native(scene), *random_scenes.random_rays(rng, scene, count)


@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("search", SEARCHES)
def test_any_number_of_threads(search: str, index: str):
    native, o, d = picture()
    one = native.first_hit(o, d, threads=1, search=search, index=index, counters=True)
    assert one.hit.mean() > 0.2
    for threads in (2, 3, 4, None):
        assert_same_bits(native.first_hit(o, d, threads=threads, search=search, index=index, counters=True), one)
        np.testing.assert_array_equal(native.any_hit(o, d, index=index, threads=threads), one.hit)


def test_again_and_in_another_process_state():
    """A second run, a second Native of the same scene, and after other scenes have used the memory."""
    native, o, d = picture()
    first = native.first_hit(o, d)
    for seed in range(3):
        other, p, e = picture(seed + 1, 500)
        other.first_hit(p, e)
    assert_same_bits(native.first_hit(o, d), first)
    assert_same_bits(picture()[0].first_hit(o, d), first)


def test_two_scenes_from_two_threads_at_once():
    scenes = [picture(seed, 8000) for seed in (1, 2)]
    alone = [native.first_hit(o, d, threads=1) for native, o, d in scenes]
    found: list[list[Hits]] = [[], []]

    def work(which: int) -> None:
        native, o, d = scenes[which]
        for _ in range(5):
            found[which].append(native.first_hit(o, d, threads=2))

    workers = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for expected, runs in zip(alone, found, strict=True):
        assert len(runs) == 5
        for hits in runs:
            assert_same_bits(hits, expected)


def test_one_scene_from_many_threads_at_once():
    """Also the first use, when the index is built."""
    native, o, d = picture(3, 4000)
    found: list[Hits] = []
    workers = [threading.Thread(target=lambda: found.append(native.first_hit(o, d, threads=1))) for _ in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(found) == 6
    for hits in found[1:]:
        assert_same_bits(hits, found[0])


# ---- the same hits within the conditioned error ---------------------------------------------------------------


def assert_same_hits(scene: ir.Scene, o: np.ndarray, d: np.ndarray, a: Hits, b: Hits) -> None:
    """Status, kind and surface, but for rays that graze on one side (within rounding of a tangent either is right,
    then the distance where the other hits is that of a nearly tangent crossing: conditioned worse than 1e-9)."""
    different = np.flatnonzero((a.status != b.status) | (a.surface != b.surface))
    for i in different:
        hit = a if a.hit[i] else b
        if not hit.hit[i]:
            assert GRAZE in (a.status[i], b.status[i])
            continue
        assert _tolerance(scene, o, d, hit, i) > 1e-9
    for i in np.setdiff1d(np.flatnonzero(a.hit), different):
        assert abs(a.t[i] - b.t[i]) <= 2.0 * _tolerance(scene, o, d, a, int(i))


def _tolerance(scene: ir.Scene, o: np.ndarray, d: np.ndarray, hits: Hits, i: int) -> float:
    one = slice(i, i + 1)
    return float(conditioning.tolerance(scene.surfaces[hits.surface[i]], o[one], d[one], hits.t[one])[0])


@pytest.mark.parametrize("seed", range(6))
def test_any_order_of_rays(seed: int):
    rng, scene = campaigns.scene_of(seed)
    native = Native(scene)
    o, d = campaigns.rays_of(rng, scene, 200)
    plain = native.first_hit(o, d)
    order = rng.permutation(len(o))
    mixed = native.first_hit(o[order], d[order])
    back = np.argsort(order)
    mixed.status, mixed.t, mixed.surface = mixed.status[back], mixed.t[back], mixed.surface[back]
    assert_same_hits(scene, o, d, plain, mixed)


#: Run as a script of its own: argument 1 is the file for the answers.
_CHILD = """
import sys
import numpy as np
sys.path[:0] = {paths!r}
from tracer import campaigns
from blobscript.backends.library import load
from blobscript.backends.native import Native
out = {{"isa": load().blob_isa()}}
for seed in range({seeds}):
    rng, scene = campaigns.scene_of(seed)
    o, d = campaigns.rays_of(rng, scene, {rays})
    native = Native(scene)
    hits = native.first_hit(o, d)
    out[f"status{{seed}}"], out[f"t{{seed}}"], out[f"surface{{seed}}"] = hits.status, hits.t, hits.surface
    out[f"field{{seed}}"] = native.field(o + 0.5 * d)
np.savez(sys.argv[1], **out)
"""


def test_every_instruction_set(tmp_path: Path):
    """The machine's own against those that the environment variable asks for; each really is the one in use,
    where the processor has it."""
    seeds, rays = 12, 60
    tests = str(Path(__file__).parent.parent)
    script = _CHILD.format(paths=[tests, *(p for p in sys.path if p)], seeds=seeds, rays=rays)
    answers = {}
    for isa in ("baseline", "x86-64-v3", "x86-64-v4"):
        out = tmp_path / f"{isa}.npz"
        environment = {**os.environ, "BLOBSCRIPT_ISA": isa}
        subprocess.run([sys.executable, "-c", script, str(out)], env=environment, check=True, timeout=120)
        answers[isa] = np.load(out)
    best = load().blob_isa().decode()
    assert answers["baseline"]["isa"].item().decode() == "baseline"
    names = [answers[isa]["isa"].item().decode() for isa in answers]
    assert names == sorted(names)
    assert os.environ.get("BLOBSCRIPT_ISA") or names[-1] == best
    for seed in range(seeds):
        rng, scene = campaigns.scene_of(seed)
        o, d = campaigns.rays_of(rng, scene, rays)
        hits = {}
        for isa, data in answers.items():
            blank = np.zeros(len(o), np.int32)
            status, t, surface = data[f"status{seed}"], data[f"t{seed}"], data[f"surface{seed}"]
            hits[isa] = Hits(status, t, np.zeros((len(o), 3)), surface, blank)
        assert_same_hits(scene, o, d, hits["baseline"], hits["x86-64-v3"])
        assert_same_hits(scene, o, d, hits["baseline"], hits["x86-64-v4"])
        points = o + 0.5 * d
        size = conditioning.magnitude(scene.surfaces[0].field, points)
        steep = conditioning.steepness(scene.surfaces[0].field, points)
        allowed = 8.0 * conditioning.EPS * (size + 8.0 * np.linalg.norm(points, axis=1) * (1.0 + steep))
        expected = reference.field_value(scene.surfaces[0].field, points)
        for data in answers.values():
            assert (np.abs(data[f"field{seed}"] - expected) <= allowed).all()
    assert sum(int(np.isin(answers["baseline"][f"status{s}"], (ENTER, EXIT)).sum()) for s in range(seeds)) > 100
