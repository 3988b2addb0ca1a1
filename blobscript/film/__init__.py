"""Films: the moments of a script that has `animate(seconds, fps)`, rendered one by one and joined in one file.

`shooting.Film` gives the scene of every moment, `frames.FrameFolder` keeps finished frames so that an interrupted film
goes on where it was, `joining.join` makes the file: GIF through OpenImageIO, APNG from the chunks of the frames,
MP4 and WebM through PyAV (the extra `blobscript[video]`).
"""

from blobscript.film.frames import FrameFolder
from blobscript.film.joining import check_film, join
from blobscript.film.moments import Moment, moments_of
from blobscript.film.shooting import Film, Frame, Look

__all__ = ["Film", "Frame", "FrameFolder", "Look", "Moment", "check_film", "join", "moments_of"]
