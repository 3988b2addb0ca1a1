"""Rendering: the same bits however the work is cut, layers, options, stopping."""

from __future__ import annotations

import ctypes
import threading
import time

import numpy as np
import pytest
from picture import reference, scenes

from blobscript.backends import picture
from blobscript.backends.native import COUNTERS, Native
from blobscript.images import Image

ALL = tuple(picture.LAYERS)


def same(a: Image, b: Image) -> None:
    assert a.rgba.tobytes() == b.rgba.tobytes()
    assert a.aov.keys() == b.aov.keys()
    for name, values in a.aov.items():
        assert values.tobytes() == b.aov[name].tobytes(), name


# ---- determinism ---------------------------------------------------------------------


@pytest.mark.parametrize("samples", [1, 3, 16])
def test_threads_do_not_matter(samples: int) -> None:
    scene = scenes.painted()
    native = Native(scene)
    pictures = [
        picture.render(scene, native, width=150, height=100, samples=samples, threads=threads, aov=ALL)
        for threads in (1, 2, 3, 4)
    ]
    for other in pictures[1:]:
        same(pictures[0], other)


def test_the_order_of_tiles_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes.row()
    forwards = picture.render(scene, width=150, height=100, aov=ALL)
    tiles = picture._tiles
    monkeypatch.setattr(picture, "_tiles", lambda *a: tiles(*a)[::-1])
    same(picture.render(scene, width=150, height=100, aov=ALL), forwards)


def test_the_size_of_tiles_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes.row()
    forwards = picture.render(scene, width=150, height=100, samples=2, aov=ALL)
    monkeypatch.setattr(picture, "_TILE", 16)
    same(picture.render(scene, width=150, height=100, samples=2, aov=ALL), forwards)


@pytest.mark.parametrize("region", [(0, 0, 150, 100), (37, 21, 101, 83), (149, 99, 150, 100), (64, 0, 65, 100)])
@pytest.mark.parametrize("samples", [1, 4])
def test_a_region_is_a_piece_of_the_picture(region: tuple[int, int, int, int], samples: int) -> None:
    scene = scenes.crowd()
    native = Native(scene)
    whole = picture.render(scene, native, width=150, height=100, samples=samples, aov=("depth", "normal"))
    part = picture.render(scene, native, width=150, height=100, samples=samples, aov=("depth", "normal"), region=region)
    x0, y0, x1, y1 = region
    cut = {name: values[y0:y1, x0:x1] for name, values in whole.aov.items()}
    same(part, Image(whole.rgba[y0:y1, x0:x1], cut))


def test_seeds_differ_and_one_sample_has_none() -> None:
    scene = scenes.crowd()
    native = Native(scene)
    first, second = (picture.render(scene, native, samples=4, seed=seed) for seed in (0, 1))
    assert not np.array_equal(first.rgba, second.rgba)
    first, second = (picture.render(scene, native, samples=1, seed=seed) for seed in (0, 1))
    same(first, second)


def test_more_samples_come_nearer() -> None:
    """The error falls at least as fast as with random samples, and there is no bias."""
    scene = scenes.crowd()
    native = Native(scene)
    fine = picture.render(scene, native, samples=1024).rgba
    coarse = [picture.render(scene, native, samples=n, seed=5).rgba for n in (2, 8, 32)]
    errors = [np.sqrt(np.mean((image - fine) ** 2)) for image in coarse]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]


# ---- the pattern of samples ----------------------------------------------------------


def pattern(x: int, y: int, seed: int, n: int) -> np.ndarray:
    places = np.empty((n, 2))
    picture._library().shade_pattern(x, y, seed, n, places.ctypes.data_as(ctypes.c_void_p))
    return places


@pytest.mark.parametrize("n", [2, 4, 16, 64, 256])
def test_samples_are_stratified_in_every_way(n: int) -> None:
    """(0, 2)-sequence: each box of size 2^-a by 2^-b with 2^(a+b) = n has exactly one sample."""
    for pixel in range(20):
        places = pattern(pixel, 3 * pixel, 9, n)
        assert places.min() >= 0
        assert places.max() < 1
        columns = 1
        while columns <= n:
            boxes = np.floor(places * (columns, n // columns)).astype(int)
            assert len(np.unique(boxes, axis=0)) == n
            columns *= 2


def test_pixels_and_seeds_have_samples_of_their_own() -> None:
    places = [pattern(x, y, seed, 8) for x in range(10) for y in range(10) for seed in range(3)]
    assert len({p.tobytes() for p in places}) == 300
    mean = np.mean(places, axis=(0, 1))
    assert np.abs(mean - 0.5).max() < 0.01
    first = np.array([p[0] for p in places])
    assert np.abs(np.corrcoef(first.T)[0, 1]) < 0.15


# ---- layers --------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [1, 3])
def test_layers_are_first_hits_through_pixel_centres(samples: int) -> None:
    scene = scenes.row()
    native = Native(scene)
    image = picture.render(scene, native, samples=samples, aov=ALL)
    ref = reference.Reference(scene, native)
    directions = np.array([ref.direction(x + 0.5, y + 0.5) for y in range(scene.height) for x in range(scene.width)])
    hits = native.first_hit(np.broadcast_to(scene.camera.at, directions.shape), directions)
    shape = image.rgba.shape[:2]
    assert np.array_equal(image.aov["surface"], hits.surface.reshape(shape))
    np.testing.assert_allclose(image.aov["depth"], hits.t.reshape(shape), rtol=1e-6)
    np.testing.assert_allclose(image.aov["normal"], hits.normal.reshape(*shape, 3), atol=1e-6)
    np.testing.assert_allclose(image.aov["position"], hits.position.reshape(*shape, 3), atol=1e-6)
    assert (image.aov["evaluations"][image.aov["surface"] >= 0] > 0).all()
    assert {name: values.dtype for name, values in image.aov.items()} == {
        name: np.dtype(kind) for name, (_, kind) in picture.LAYERS.items()
    }
    assert set(COUNTERS) <= image.aov.keys()


def test_layers_do_not_depend_on_samples() -> None:
    scene = scenes.crowd()
    native = Native(scene)
    centred = [name for name in ALL if name not in ("direct", "indirect", "samples")]
    one = picture.render(scene, native, samples=1, aov=centred)
    many = picture.render(scene, native, samples=5, aov=centred)
    many.rgba = one.rgba
    same(one, many)


def test_layers_do_not_change_the_picture() -> None:
    scene = scenes.crowd()
    native = Native(scene)
    assert np.array_equal(picture.render(scene, native).rgba, picture.render(scene, native, aov=ALL).rgba)


# ---- options -------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (65, 2)])
def test_odd_sizes(size: tuple[int, int]) -> None:
    image = picture.render(scenes.row(), width=size[0], height=size[1], samples=2)
    assert (image.width, image.height) == size
    assert (image.rgba[:, :, 3] == 1).all()


def test_many_samples_of_few_pixels() -> None:
    image = picture.render(scenes.row(), width=3, height=2, samples=1000)
    assert np.isfinite(image.rgba).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": -1}, "1 to 65535 pixels"),
        ({"width": 0}, "not 0x36"),
        ({"height": 65536}, "not 48x65536"),
        ({"samples": 0}, "samples must lie in"),
        ({"aov": ("depths",)}, "no layer 'depths'; known: depth"),
        ({"region": (0, 0, 49, 36)}, "does not lie in the picture"),
        ({"region": (5, 5, 5, 9)}, "does not lie in the picture"),
        ({"search": "luck"}, "search must be one of"),
        ({"index": "luck"}, "index must be one of"),
        ({"tolerance": -1.0}, "tolerance must be a positive number"),
    ],
)
def test_impossible_options(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        picture.render(scenes.row(), **options)


def test_progress_reaches_the_end() -> None:
    seen: list[tuple[int, int]] = []
    picture.render(scenes.crowd(), width=200, height=100, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (20000, 20000)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


@pytest.mark.parametrize("size", [400, 60])
def test_cancelling_is_quick(size: int) -> None:
    """Within a few blocks of rays, also in the middle of a tile; no thread stays behind."""
    cancel = threading.Event()
    before = threading.active_count()
    timer = threading.Timer(0.3, cancel.set)
    timer.start()
    with pytest.raises(picture.CancelledError):
        picture.render(scenes.row(), width=size, height=size, samples=20_000, cancel=cancel)
    late = time.monotonic()
    assert threading.active_count() <= before + 1
    assert time.monotonic() - late < 1


def test_an_interruption_stops_the_threads() -> None:
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        picture.render(scenes.row(), width=4000, height=4000, progress=interrupt)
    assert threading.active_count() == before


@pytest.mark.parametrize("area", [(0, 0, 49, 36), (-1, 0, 4, 4), (4, 4, 4, 8), (0, 30, 8, 37)])
def test_the_library_refuses_tiles_outside_the_picture(area: tuple[int, int, int, int]) -> None:
    scene = scenes.row()
    native = Native(scene)
    packed = picture._pack(scene, 48, 36, picture._sampling(1, None, 0, None), scene.tone)
    query = native.query()
    status = picture._library().shade_tile(
        native.scene_pointer,
        native.index_pointer(),
        ctypes.addressof(query),
        ctypes.addressof(packed.picture),
        *area,
        None,
        None,
        None,
    )
    assert status == 3  # BLOB_BAD_ARGUMENT


def test_structures_have_the_sizes_of_the_header() -> None:
    """shade.c asserts the same numbers."""
    kinds = (picture._Light, picture._Sky, picture._Texture, picture._Picture, picture._Layers)
    sizes = [ctypes.sizeof(kind) for kind in kinds]
    assert sizes == [64, 256, 128, 656, 112]
