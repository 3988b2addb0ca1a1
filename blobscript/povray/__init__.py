"""POV-Ray: the scene as its text, numbers back from it, comparisons, and its blobs as scripts.

ir.Scene -> units -> forms -> objects -> scene_text        what POV-Ray reads
                       cells, steepness, functions         isosurfaces with proved bounds
                       grids                               fields too large for functions, as samples
                       looks, textures, view               materials, camera, lights, background
                       beside                              files that go with the text
program, readback                                          POV-Ray run, places and normals read back
compare, judge, page                                       both renderers side by side
sdl, importer                                              the way back: a .pov scene as a script
"""

from __future__ import annotations

from blobscript.povray.beside import Beside
from blobscript.povray.scene_text import Document, document

__all__ = ["Beside", "Document", "document"]
