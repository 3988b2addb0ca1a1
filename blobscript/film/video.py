"""MP4 (H.264) and WebM (VP9) films, through PyAV."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from blobscript.diagnostics import MissingError
from blobscript.film.codes import codes

__all__ = ["check_video", "write_video"]

#: Ending -> container, codec, its options: constant quality, hardly to be told from the frames.
_CODECS: dict[str, tuple[str, str, dict[str, str]]] = {
    ".mp4": ("mp4", "libx264", {"crf": "16", "preset": "slow"}),
    ".webm": ("webm", "libvpx-vp9", {"crf": "24", "b": "0", "row-mt": "1"}),
}
_BT709 = 1
_LIMITED = 1


def check_video(ending: str) -> None:
    """Raises MissingError where PyAV or the codec is not there."""
    codec = _CODECS[ending][1]
    try:
        _av().codec.Codec(codec, "w")
    except ValueError as error:
        raise MissingError(
            f"this PyAV was built without the codec {codec} of {ending} films\n  = help: write .gif or .png instead"
        ) from error


def write_video(path: Path, ending: str, frames: Sequence[Path], fps: float, told: Callable[[int], None]) -> None:
    """Width and height are even. `told` gets the number of frames written so far. Raises OSError."""
    av = _av()
    container, codec, options = _CODECS[ending]
    with av.open(str(path), "w", format=container) as out:
        stream = out.add_stream(codec, rate=Fraction(fps).limit_denominator(65_535), options=options)
        stream.height, stream.width = codes(frames[0]).shape[:2]
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = _BT709
        context.color_range = _LIMITED
        for number, frame in enumerate(frames):
            out.mux(stream.encode(_picture(av, codes(frame))))
            told(number + 1)
        out.mux(stream.encode())


def _picture(av: Any, pixels: Any) -> Any:
    frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
    return frame.reformat(format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED)


def _av() -> Any:
    try:
        import av
    except ImportError as error:
        raise MissingError(
            "MP4 and WebM films are written by PyAV, which is not installed\n"
            "  = help: pip install 'blobscript[video]', or write .gif or .png"
        ) from error
    return av
