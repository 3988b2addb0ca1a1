"""A comparison as a page that needs no other file, and as JSON."""

from __future__ import annotations

import base64
import html
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript.images import Image, srgb_decode
from blobscript.povray.compare import DEPTH_TOLERANCE, Comparison
from blobscript.povray.judge import Verdict
from blobscript.povray.text import Array

__all__ = ["as_html", "as_json", "summary"]


def summary(found: Comparison) -> str:
    """Three lines for a terminal."""
    pixels = found.width * found.height
    different = len(found.only_ours) + len(found.only_theirs)
    return "\n".join(
        [
            f"hit or miss agrees on {found.mask_share:.4%} of {pixels} pixels ({different} differ), "
            f"both hit {found.both}",
            f"distance, of the scene's size: median {found.depth.median / found.size:.1e}, "
            f"99 % {found.depth.p99 / found.size:.1e}, largest {found.depth.max / found.size:.1e}; "
            f"colour: {found.colors.mean:.2f}/255 on average",
            _judgement(found),
        ]
    )


def _judgement(found: Comparison) -> str:
    if not found.judged:
        return f"{found.outliers} outliers, not judged: pip install 'blobscript[report]' brings the certified reference"
    off = len(found.ours_off)
    ours = "we are not off anywhere" if not off else f"we are off in {off}"
    return f"{found.outliers} outliers, {len(found.verdicts)} of them and {len(found.sample)} others judged: {ours}"


# ---- JSON -------------------------------------------------------------------------------------


def as_json(found: Comparison) -> str:
    return json.dumps(_data(found), indent=1)


def _data(found: Comparison) -> dict[str, Any]:
    def spread(s: Any, unit: float) -> dict[str, float]:
        return {"median": s.median / unit, "p99": s.p99 / unit, "max": s.max / unit}

    return {
        "script": found.script,
        "size": [found.width, found.height],
        "agrees": found.agrees,
        "versions": found.versions,
        "commands": found.commands,
        "seconds": {name: round(value, 4) for name, value in found.seconds.items()},
        "forms": [found.document.forms[i] for i in sorted(found.document.forms)],
        "scene_size": found.size,
        "accuracy": found.document.accuracy,
        "unit": found.document.unit,
        "mask": {
            "share": found.mask_share,
            "both": found.both,
            "only_blobscript": found.only_ours,
            "only_povray": found.only_theirs,
        },
        "depth": {"absolute": spread(found.depth, 1.0), "relative": spread(found.depth, found.size)},
        "normal_angle": spread(found.normal, 1.0),
        "color": {
            "mean_255": found.colors.mean,
            "rms_255": found.colors.rms,
            "max_255": found.colors.max,
            "psnr": found.colors.psnr if math.isfinite(found.colors.psnr) else None,
            "visible_pixels": found.colors.visible,
        },
        "outliers": {
            "count": found.outliers,
            "judged": found.judged,
            "verdicts": [_verdict(v) for v in found.verdicts],
            "sample": [_verdict(v) for v in found.sample],
        },
        "notes": [note.message for note in found.notes],
    }


def _verdict(v: Verdict) -> dict[str, Any]:
    def shown(x: float) -> float | None:
        return x if math.isfinite(x) else None

    return {
        "pixel": [v.x, v.y],
        "exact": shown(v.exact),
        "blobscript": shown(v.ours),
        "povray": shown(v.theirs),
        "blobscript_off": shown(v.our_error),
        "povray_off": shown(v.their_error),
        "stable": v.stable,
    }


# ---- HTML ---------------------------------------------------------------------------------------

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
.pictures { display: grid; grid-template-columns: 1fr 1fr; gap: 1rem; }
figure { margin: 0; } figure img, figure svg { width: 100%; display: block; image-rendering: auto; background: #fff; }
figcaption { font-size: .85rem; color: #555; margin-top: .25rem; }
table { border-collapse: collapse; } td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
.good { color: #17693a; } .bad { color: #a3271d; } code { font-size: .85rem; word-break: break-all; }
"""


def as_html(found: Comparison) -> str:
    name = html.escape(Path(found.script).name)
    mood = "good" if found.agrees else "bad"
    lines = [html.escape(line) for line in summary(found).split("\n")]
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{name}: blobscript and POV-Ray</title>",
        f"<style>{_STYLE}</style><body>",
        f"<h1>{name}: blobscript and POV-Ray</h1>",
        f"<p class={mood}><strong>{lines[2]}.</strong></p><p>{lines[0]}.<br>{lines[1]}.</p>",
        _pictures(found),
        "<h2>In numbers</h2>",
        _numbers(found),
        "<h2>Outliers</h2>",
        _outliers(found),
        "<h2>How</h2>",
        _how(found),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _pictures(found: Comparison) -> str:
    difference = np.abs(found.ours - found.theirs)
    shown = [
        (_png(found.ours), "blobscript, one sample a pixel"),
        (_png(found.theirs), f"POV-Ray {html.escape(found.versions['POV-Ray'])}, without antialiasing"),
        (_png(srgb_decode(np.clip(8 * difference, 0, 1)).astype(np.float32)), "difference of the light shown, 8 times"),
        (_png(_heat(found)), f"distance along the ray: {_LEGEND}"),
    ]
    figures = [
        f'<figure><img src="data:image/png;base64,{data}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
        for data, caption in shown
    ]
    figures.append(
        f"<figure>{_histogram(found.gap / found.size)}<figcaption>differences of the distance, of the scene's size: "
        "pixels by power of ten</figcaption></figure>"
    )
    figures.append(
        f"<figure>{_histogram(found.bend)}<figcaption>angles between the normals, in radians: pixels by power of ten"
        "</figcaption></figure>"
    )
    return f"<div class=pictures>{''.join(figures)}</div>"


def _png(linear: NDArray[np.float32]) -> str:
    rgba = np.concatenate([np.clip(linear, 0, 1), np.ones((*linear.shape[:2], 1), np.float32)], axis=2)
    with tempfile.TemporaryDirectory(prefix="blobscript-") as folder:
        path = Path(folder) / "picture.png"
        Image(np.ascontiguousarray(rgba, dtype=np.float32)).save(path, 8)
        return base64.b64encode(path.read_bytes()).decode("ascii")


_LEGEND = "white nothing hit, blue to yellow 1e-16 to 1e-6 of the size, red beyond or hit by one only"


def _heat(found: Comparison) -> NDArray[np.float32]:
    """Colours of the logarithm of the gap."""
    share = (np.log10(np.maximum(np.nan_to_num(found.gap, nan=0.0) / found.size, 1e-17)) + 16) / 10
    x = np.clip(share, 0, 1)[:, :, None]
    cold, mild, warm = (np.array(c) for c in ((0.02, 0.05, 0.25), (0.05, 0.42, 0.42), (1.0, 0.85, 0.1)))
    color = np.where(x < 0.5, cold + (mild - cold) * 2 * x, mild + (warm - mild) * (2 * x - 1))
    color[np.isnan(found.gap)] = 1.0
    color[found.gap > DEPTH_TOLERANCE * found.size + found.document.accuracy] = (0.8, 0.0, 0.0)
    for x_, y_ in [*found.only_ours, *found.only_theirs]:
        color[y_, x_] = (0.8, 0.0, 0.0)
    return color.astype(np.float32)


def _histogram(errors: Array) -> str:
    """Bars per power of ten; equal to the last bit counts as 1e-17."""
    values = errors[~np.isnan(errors)]
    powers = np.floor(np.log10(np.maximum(values, 1e-17))).astype(np.int64)
    lowest, highest = -17, max(int(powers.max(initial=-5)), -5)
    counts = [int(np.count_nonzero(powers == p)) for p in range(lowest, highest + 1)]
    top, width = max(*counts, 1), 540.0
    step = width / len(counts)
    bars: list[str] = []
    for i, count in enumerate(counts):
        height = 150.0 * count / top
        x = 30 + i * step
        bars.append(f'<rect x="{x:.1f}" y="{170 - height:.1f}" width="{step - 3:.1f}" height="{height:.1f}"/>')
        if count:
            bars.append(f'<text x="{x + step / 2 - 1:.1f}" y="{165 - height:.1f}" class="n">{count}</text>')
        label = "0" if i == 0 else str(lowest + i)
        bars.append(f'<text x="{x + step / 2 - 1:.1f}" y="186">{label}</text>')
    style = "rect { fill: #2b6f8f } text { font: 10px system-ui, sans-serif; text-anchor: middle; fill: #444 } "
    return f'<svg viewBox="0 0 600 200"><style>{style}.n {{ font-size: 8px }}</style>{"".join(bars)}</svg>'


def _numbers(found: Comparison) -> str:
    rows: list[tuple[str, str, str]] = [
        ("both hit", f"{found.both}", "pixels"),
        ("only blobscript hits", f"{len(found.only_ours)}", _some(found.only_ours)),
        ("only POV-Ray hits", f"{len(found.only_theirs)}", _some(found.only_theirs)),
        ("distance, median", f"{found.depth.median:.2e}", f"{found.depth.median / found.size:.1e} of the scene's size"),
        ("distance, 99 %", f"{found.depth.p99:.2e}", f"{found.depth.p99 / found.size:.1e}"),
        ("distance, largest", f"{found.depth.max:.2e}", f"{found.depth.max / found.size:.1e}"),
        ("normals, median", f"{found.normal.median:.2e}", "radians"),
        ("normals, 99 %", f"{found.normal.p99:.2e}", ""),
        ("normals, largest", f"{found.normal.max:.2e}", ""),
        ("colour, mean", f"{found.colors.mean:.3f}", "of 255, sRGB"),
        ("colour, root mean square", f"{found.colors.rms:.3f}", "OpenImageIO"),
        ("colour, largest", f"{found.colors.max:.1f}", ""),
        ("visibly different", f"{found.colors.visible}", "pixels, by the model of Yee (2004)"),
    ]
    rows += [(name, f"{seconds:.2f}", "s") for name, seconds in found.seconds.items()]
    cells = [
        f"<tr><th>{html.escape(name)}<td class=number>{value}<td>{html.escape(unit)}" for name, value, unit in rows
    ]
    return f"<table>{''.join(cells)}</table>"


def _some(pixels: list[tuple[int, int]]) -> str:
    shown = ", ".join(f"({x}, {y})" for x, y in pixels[:8])
    return shown + (", …" if len(pixels) > 8 else "")


def _outliers(found: Comparison) -> str:
    if not found.verdicts and not found.sample:
        return f"<p>{html.escape(_judgement(found))}.</p>"
    rows = list(map(_row, found.verdicts))
    table = f"<table><tr><th>pixel<th>exact distance<th><th>{''.join(rows)}</table>" if rows else "<p>None.</p>"
    if not found.sample:
        return table
    ours, theirs = (float(np.median([getattr(v, name) for v in found.sample])) for name in ("our_error", "their_error"))
    return (
        f"{table}<p>{len(found.sample)} of the other pixels, by chance: blobscript is off by {ours:.1e}, "
        f"POV-Ray by {theirs:.1e} (medians, against the certified reference).</p>"
    )


def _row(v: Verdict) -> str:
    cells = [
        _distance(v.exact),
        _off("POV-Ray is", v.their_error),
        _off("we are", v.our_error),
        "" if v.stable else "within rounding of a miss",
    ]
    return f"<tr><td class=number>({v.x}, {v.y})" + "".join(f"<td>{cell}" for cell in cells)


def _distance(x: float) -> str:
    return f"{x:.12g}" if math.isfinite(x) else "no hit"


def _off(who: str, error: float) -> str:
    if error == 0.0:
        return f"{who} exact"
    return f"{who} off by {error:.2e}" if math.isfinite(error) else f"{who} wrong about hit or miss"


def _how(found: Comparison) -> str:
    kinds = ", ".join(f"{k} as {found.document.forms[k]}" for k in sorted(found.document.forms)[:12])
    notes = "".join(f"<li>{html.escape(note.message)}" for note in found.notes)
    commands = "".join(f"<br><code>{html.escape(command)}</code>" for command in found.commands)
    return (
        f"<p>Surfaces: {kinds}. Isosurfaces to {found.document.accuracy:.1e}: POV-Ray returns them too deep by "
        f"up to that much. One unit of the script is {found.document.unit:g} in POV-Ray.</p>"
        f"<p>{html.escape(', '.join(f'{name} {text}' for name, text in found.versions.items()))}{commands}</p>"
        + (f"<ul>{notes}</ul>" if notes else "")
    )
