"""Pictures in memory and in files: the only module that reads or writes image files.

In memory a picture is linear, with alpha multiplied into the colours, float32, row 0 on top. In
a file it is whatever the format is used to: integers are sRGB-encoded with plain (unassociated)
alpha, floats stay linear and associated. All pixels go through OpenImageIO, which is imported at
the first use.

Layers (depth, normal, ...) live in EXR files as float channels beside R, G, B, A. No other format
holds them: `save("out.png")` of a picture with layers writes `out.layers.exr` too and returns both
names, so that the caller can say so.

Files appear whole or not at all (`outputs`). No dates go in: the same picture gives the same bytes.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript import outputs, webp
from blobscript.outputs import FileError, FormatError, WriteError

__all__ = [
    "FORMATS",
    "ReadError",
    "WriteError",
    "Format",
    "Image",
    "FormatError",
    "check_output",
    "developed",
    "layers_path",
    "read",
    "srgb_decode",
    "srgb_encode",
]

Floats = NDArray[np.float32]


# ---- what can go wrong ---------------------------------------------------------------


class ReadError(FileError):
    code = "E0801"
    failure = "cannot read"


# ---- formats -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Format:
    """How one kind of file is written. `bits` lists the depths it can have, the default first."""

    name: str
    endings: tuple[str, ...]
    plugin: str  # OpenImageIO's name for it
    bits: tuple[int, ...]
    attributes: tuple[tuple[str, str], ...] = ()
    alpha: bool = True
    layers: bool = False
    longest_side: int = 1 << 20
    longest_text: int = 1 << 20


#: Texts: TIFF gives back 65536 characters at most, and JPEG markers hold 65533 bytes.
FORMATS: tuple[Format, ...] = (
    Format("PNG", (".png",), "png", (8, 16)),
    Format("EXR", (".exr",), "openexr", (32, 16), (("compression", "zip"),), layers=True),
    Format("TIFF", (".tif", ".tiff"), "tiff", (16, 8, 32), (("compression", "zip"),), longest_text=30_000),
    Format(
        "JPEG",
        (".jpg", ".jpeg"),
        "jpeg",
        (8,),
        (("compression", "jpeg:95"), ("jpeg:subsampling", "4:4:4")),
        alpha=False,
        longest_side=65_535,
        longest_text=30_000,
    ),
    Format("WebP", (".webp",), "webp", (8,), (("compression", "lossless"),), longest_side=16_383),
)


def _format_of(path: Path) -> Format:
    forms = {ending: form for form in FORMATS for ending in form.endings}
    return forms[outputs.check_ending(path, "picture", list(forms))]


def _bits_of(form: Format, bits: int | None, path: Path) -> int:
    if bits is None:
        return form.bits[0]
    if bits not in form.bits:
        known = " or ".join(str(b) for b in sorted(form.bits))
        raise FormatError(f"{form.name} holds {known} bits per channel, not {bits}", path)
    return bits


def layers_path(path: str | Path) -> Path:
    """Where the layers go that the format of `path` cannot hold: out.png -> out.layers.exr."""
    return Path(path).with_suffix(".layers.exr")


def check_output(path: str | Path, bits: int | None = None, layers: bool = False) -> Format:
    """Raise what `Image.save` would raise before a pixel is there: call it before a long render."""
    form = _format_of(Path(path))
    _bits_of(form, bits, Path(path))
    outputs.check_output(path)
    if layers and not form.layers:
        outputs.check_output(layers_path(path))
    return form


# ---- the picture ---------------------------------------------------------------------


@dataclass(eq=False)
class Image:
    """A picture: `rgba` (h, w, 4) float32, linear, premultiplied, row 0 on top.

    `aov`: name -> (h, w) or (h, w, 3); see `backends.picture` for what each holds.
    `metadata`: texts kept in the file and given back by `read`. `exposure` (stops) and `curve` ("linear" or
    "film") are applied where a file holds integers; floats stay light. `timing`: seconds of processor time that
    went into it, by part.
    """

    rgba: Floats
    aov: dict[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    metadata: dict[str, str] = field(default_factory=dict[str, str])
    curve: str = "linear"
    exposure: float = 0.0
    timing: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def width(self) -> int:
        return self.rgba.shape[1]

    @property
    def height(self) -> int:
        return self.rgba.shape[0]

    def save(self, path: str | Path, bits: int | None = None) -> tuple[Path, ...]:
        """Write the picture, the format by the ending; returns the names of all files written.

        Raises `FormatError` (E0803) and `WriteError` (E0802).
        """
        path = Path(path)
        form = _format_of(path)
        bits = _bits_of(form, bits, path)
        files = [(path, form, _colour_planes(self, form, bits))]
        if self.aov and not form.layers:
            aside = layers_path(path)
            files.append((aside, _format_of(aside), _Planes(_layer_planes(self.aov), "float")))
        with contextlib.ExitStack() as stack:
            for name, kind, planes in files:
                part = stack.enter_context(outputs.pending(name))
                part.write_bytes(_encoded(name, kind, planes, self.metadata))
        return tuple(name for name, _, _ in files)


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """Channels ready for the file, (h, w, n) stacked on demand; `kind` is OpenImageIO's type name of
    all of them, except that layers are always float."""

    named: list[tuple[str, NDArray[Any]]]
    kind: str


def _colour_planes(image: Image, form: Format, bits: int) -> _Planes:
    rgba = image.rgba
    if form.layers or bits == 32:
        named = [(name, rgba[:, :, i]) for i, name in enumerate("RGBA")]
        layers = _layer_planes(image.aov) if form.layers else []
        return _Planes(named + layers, "half" if bits == 16 else "float")
    shown = developed(rgba, image.exposure, image.curve)
    coded = _encode(shown if form.alpha else _over_white(shown), bits, form.alpha)
    return _Planes([(name, coded[:, :, i]) for i, name in enumerate("RGBA"[: coded.shape[2]])], f"uint{bits}")


def _layer_planes(aov: Mapping[str, NDArray[Any]]) -> list[tuple[str, NDArray[Any]]]:
    """depth -> depth.Z; a vector -> name.X, name.Y, name.Z, a colour name.R, ...; anything else keeps its name."""
    planes: list[tuple[str, NDArray[Any]]] = []
    for name, values in aov.items():
        if values.ndim == 3:
            axes = "RGB" if name in _COLOURS else "XYZ"
            planes += [(f"{name}.{axis}", values[:, :, i]) for i, axis in enumerate(axes)]
        else:
            planes.append(("depth.Z" if name == "depth" else name, values))
    return planes


_COLOURS = ("albedo", "direct", "indirect")


def _over_white(rgba: Floats) -> Floats:
    """Onto white, for formats without alpha."""
    return rgba[:, :, :3] + (1 - np.clip(rgba[:, :, 3:], 0, 1))


# ---- colour --------------------------------------------------------------------------


def developed(rgba: Floats, exposure: float, curve: str) -> Floats:
    """Light as a picture shows it, still linear: times 2^exposure, then the curve; 0..1 is what can be shown."""
    if exposure == 0 and curve == "linear":
        return rgba
    out = rgba.copy()
    out[:, :, :3] *= np.float32(2.0**exposure)
    if curve == "film":
        out[:, :, :3] = _film(out[:, :, :3])
    return out


#: Film: middle grey stays, black and white are approached softly.
_GREY, _GAIN = 0.18, 0.72


def _film(x: Floats) -> Floats:
    """A curve with a toe and a shoulder for each channel: Narkowicz's fit (2015) of the Academy's reference
    transform, scaled so that middle grey stays where it is."""
    x = np.maximum(x, 0) * np.float32(_GAIN)
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1).astype(np.float32)


def srgb_encode(linear: Floats) -> Floats:
    """IEC 61966-2-1, linear 0..1 to coded 0..1; clipped, and NaN is 0."""
    x = np.clip(np.nan_to_num(linear, nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055).astype(np.float32)


def srgb_decode(coded: NDArray[Any]) -> NDArray[Any]:
    """IEC 61966-2-1, coded 0..1 to linear 0..1."""
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def _encode(pixels: Floats, bits: int, alpha: bool) -> NDArray[Any]:
    """To integers, a few rows at a time so that memory stays near the size of the result.

    Eight bits are dithered: a smooth background has no steps. What lies on a code stays on it.
    """
    top = (1 << bits) - 1
    out = np.empty(pixels.shape, np.uint8 if bits == 8 else np.uint16)
    for y in range(0, len(pixels), 64):
        rows = pixels[y : y + 64]
        colour = rows[:, :, :3]
        if alpha:
            cover = np.clip(np.nan_to_num(rows[:, :, 3:], nan=0.0), 0, 1)
            colour = np.divide(colour, cover, out=np.zeros_like(colour), where=cover > 0)
            out[y : y + 64, :, 3:] = np.rint(cover * top)
        codes = srgb_encode(colour) * top
        if bits == 8:
            codes += _dither(y, *rows.shape[:2])[:, :, None]
        out[y : y + 64, :, :3] = np.rint(codes)
    return out


def _dither(y: int, height: int, width: int) -> Floats:
    """Offsets in -0.49..0.49 for the rows from y on: interleaved gradient noise, even in every small
    window. Jimenez, "Next generation post processing in Call of Duty" (2014)."""
    rows, columns = np.ogrid[y : y + height, :width]
    noise = np.mod(52.9829189 * np.mod(0.06711056 * columns + 0.00583715 * rows, 1.0), 1.0)
    return (0.98 * (noise - 0.5)).astype(np.float32)


def _decode(coded: NDArray[Any]) -> Floats:
    """From integers, (h, w, 3 or 4), to linear premultiplied rgba."""
    top = np.iinfo(coded.dtype).max
    table = srgb_decode(np.arange(top + 1) / top).astype(np.float32)
    rgba = np.ones((*coded.shape[:2], 4), np.float32)
    rgba[:, :, :3] = table[coded[:, :, :3]]
    if coded.shape[2] == 4:
        rgba[:, :, 3] = coded[:, :, 3] / np.float32(top)
        rgba[:, :, :3] *= rgba[:, :, 3:]
    return rgba


# ---- writing -------------------------------------------------------------------------


def _encoded(path: Path, form: Format, planes: _Planes, metadata: Mapping[str, str]) -> bytes:
    """The whole file."""
    height, width = planes.named[0][1].shape
    if max(width, height) > form.longest_side:
        limit = f"{form.name} holds at most {form.longest_side} pixels a side"
        raise WriteError(f"{limit}, not {width}x{height}", path)
    text = _pack_metadata(metadata, form.longest_text)
    with _scratch() as scratch:
        _encode_into(scratch, path, form, planes, _spec(_oiio(), form, planes, text, _software(metadata)))
        data = Path(scratch).read_bytes()
    return webp.with_description(data, text) if form.plugin == "webp" else data


@contextlib.contextmanager
def _scratch() -> Generator[str]:
    """A file in memory for OpenImageIO to write: of its writers, PNG's does not notice a full disk and
    WebP's then never returns. Where the system has no such files, one in the temporary folder."""
    if hasattr(os, "memfd_create") and os.path.isdir("/proc/self/fd"):
        descriptor = os.memfd_create("picture")
        try:
            yield f"/proc/self/fd/{descriptor}"
        finally:
            os.close(descriptor)
    else:
        with tempfile.TemporaryDirectory() as folder:
            yield os.path.join(folder, "picture")


def _encode_into(scratch: str, path: Path, form: Format, planes: _Planes, spec: Any) -> None:
    oiio = _oiio()
    output = oiio.ImageOutput.create(form.plugin)
    if output is None:
        raise WriteError(f"this OpenImageIO was built without {form.name}", path)
    kind = np.dtype(np.float32 if planes.kind in ("half", "float") else planes.kind)
    pixels = np.stack([values for _, values in planes.named], axis=2, dtype=kind, casting="unsafe")
    if not (output.open(scratch, spec) and output.write_image(pixels) and output.close()):
        raise WriteError(_complaint(output.geterror()), path)
    source = oiio.ImageInput.open(scratch)
    back = source.read_image(0, 0, 0, source.spec().nchannels, "") if source else None
    if back is None or back.shape[:2] != pixels.shape[:2]:
        raise WriteError("the file came out incomplete", path)


def _spec(oiio: Any, form: Format, planes: _Planes, text: str, software: str) -> Any:
    height, width = planes.named[0][1].shape
    names = [name for name, _ in planes.named]
    spec = oiio.ImageSpec(width, height, len(names), planes.kind)
    spec.channelnames = names
    if planes.kind == "half":
        spec.channelformats = tuple(oiio.TypeDesc("half" if name in "RGBA" else "float") for name in names)
    integer = planes.kind.startswith("uint")
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if integer else "lin_rec709_scene")
    spec.attribute("oiio:UnassociatedAlpha", int(integer))
    spec.attribute("ImageDescription", text)
    spec.attribute("Software", software)
    spec.attribute("DateTime", "")  # empty: none, absent: now
    for name, value in form.attributes:
        spec.attribute(name, value)
    return spec


def _complaint(text: str) -> str:
    """OpenImageIO's reason on one line."""
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[0].strip() if lines else "it is damaged"


# ---- metadata ------------------------------------------------------------------------
#
# One JSON object in the image description, the one text that all formats have. ASCII only,
# since PNG's texts are Latin-1; the keys in the order given.


def _software(metadata: Mapping[str, str]) -> str:
    return f"blobscript {metadata['version']}" if "version" in metadata else "blobscript"


def _pack_metadata(metadata: Mapping[str, str], longest: int) -> str:
    """The JSON text; where the format cannot hold it, the longest values give way to their hashes."""
    kept = dict(metadata)
    text = json.dumps({"blobscript": kept})
    while len(text) > longest:
        key = max(kept, key=lambda k: len(kept[k]))
        if kept[key].startswith("sha256:"):
            return json.dumps({"blobscript": {}})
        kept[key] = f"sha256:{hashlib.sha256(kept[key].encode()).hexdigest()} (too long for this format)"
        text = json.dumps({"blobscript": kept})
    return text


def _unpack_metadata(text: str) -> dict[str, str]:
    try:
        entries = json.loads(text)["blobscript"]
        return {str(key): str(value) for key, value in entries.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


# ---- reading -------------------------------------------------------------------------


def read(path: str | Path) -> Image:
    """Any picture that OpenImageIO knows, as `Image.save` was given it. Raises `ReadError` (E0801)."""
    path = Path(path)
    if not path.is_file():
        raise ReadError("there is no such file" if not path.exists() else "it is not a plain file", path)
    with _opened(path) as source:
        spec = source.spec()
        kind = str(spec.format)
        pixels = source.read_image(0, 0, 0, spec.nchannels, kind if kind in ("uint8", "uint16") else "float")
        if pixels is None:
            raise ReadError(_complaint(source.geterror()), path)
        planes = dict(zip(spec.channelnames, np.moveaxis(pixels, 2, 0), strict=True))
        text = spec.get_string_attribute("ImageDescription")
    if path.suffix.lower() == ".webp":
        text = webp.description(path.read_bytes())
    return Image(_colours(planes, pixels.shape[:2]), _layers(planes), _unpack_metadata(text))


@contextlib.contextmanager
def _opened(path: Path) -> Generator[Any]:
    oiio = _oiio()
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        oiio.geterror()
        raise ReadError("it is no picture that OpenImageIO knows", path)
    try:
        yield source
    finally:
        source.close()


def _colours(planes: Mapping[str, NDArray[Any]], shape: tuple[int, int]) -> Floats:
    """The rgba of a file's channels; black and opaque where there are none."""
    grey = [planes["Y"]] * 3 if "Y" in planes else []
    found = [planes[name] for name in "RGB" if name in planes] or grey
    if len(found) < 3:
        return np.tile(np.array((0, 0, 0, 1), np.float32), (*shape, 1))
    stacked = np.stack([*found, planes["A"]] if "A" in planes else found, axis=2)
    if stacked.dtype.kind == "u":
        return _decode(stacked)
    rgba = np.ones((*shape, 4), np.float32)
    rgba[:, :, : stacked.shape[2]] = stacked
    return rgba


def _layers(planes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Undo `_layer_planes`; whole numbers that stand for things come back as int32."""
    aov: dict[str, NDArray[Any]] = {}
    for name, values in planes.items():
        base, _, axis = name.partition(".")
        if base in "RGBAY" or base in aov:
            continue
        axes = "XYZ" if axis in ("X", "Y", "Z") else "RGB"
        if axis and axis in axes and {f"{base}.{a}" for a in axes} <= planes.keys():
            aov[base] = np.stack([planes[f"{base}.{a}"] for a in axes], axis=2)
        else:
            aov[base] = values.astype(np.int32) if _whole(base) else np.ascontiguousarray(values)
    return aov


def _whole(layer: str) -> bool:
    return layer not in ("depth", "normal", "position", *_COLOURS)


def _oiio() -> ModuleType:
    """OpenImageIO, loaded when the first picture is: `check` and `info` start without it."""
    import OpenImageIO

    return OpenImageIO
