"""Reading POV-Ray's scenes: words, directives, expressions, and the blobs among the objects.

words      text -> words with their places
reader     directives and expressions: #declare, #if, #while, #for, numbers, vectors, functions
scene      objects: blobs with their components, cameras, lights; what else there is, is named and left out
script     what was found as a script
"""

from __future__ import annotations

from blobscript.povray.sdl.script import imported

__all__ = ["imported"]
