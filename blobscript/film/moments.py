"""When the frames of a film are."""

from __future__ import annotations

from dataclasses import dataclass

from blobscript import ir

__all__ = ["Moment", "moments_of"]


@dataclass(frozen=True, slots=True)
class Moment:
    """Frame `number` from 0 up; `time` in seconds; `phase` from 0 to 1, of the whole film."""

    number: int
    time: float
    phase: float


def moments_of(animate: ir.Animate) -> tuple[Moment, ...]:
    """N = round(seconds fps) frames, frame k at time k / fps and phase k / N: a film that loops repeats no frame."""
    count = frame_count(animate.seconds, animate.fps)
    return tuple(Moment(k, k / animate.fps, k / count) for k in range(count))


def exposure(moment: Moment, animate: ir.Animate, shutter: float, parts: int) -> tuple[Moment, ...]:
    """The moments whose mean is a frame with motion blur: in the middles of `parts` equal parts of the time from
    the frame on in which the shutter is open, `shutter` (0 to 1) of the time to the next frame."""
    if parts == 1:
        return (moment,)
    count = frame_count(animate.seconds, animate.fps)
    places = [moment.number + shutter * (i + 0.5) / parts for i in range(parts)]
    return tuple(Moment(moment.number, k / animate.fps, k / count) for k in places)


def frame_count(seconds: float, fps: float) -> int:
    return round(seconds * fps)
