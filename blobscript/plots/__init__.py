"""Figures that explain a scene: kernels, slices through the field, the search along one ray, one pixel.

Every `plot_…` returns a matplotlib figure, to be saved or changed as one likes (`pip install
'blobscript[report]'` brings matplotlib). The numbers behind them come from modules that need none of it:
`elements` (the blobs that one ray or point feels), `sandwich` (the search, step by step), `pixel`.
"""

from blobscript.plots.kernel import plot_kernel
from blobscript.plots.pixel import explain_pixel
from blobscript.plots.ray import plot_ray
from blobscript.plots.slice import Plane, plot_slice
from blobscript.plots.style import png_bytes, svg_text
from blobscript.plots.why import plot_why

__all__ = ["Plane", "explain_pixel", "plot_kernel", "plot_ray", "plot_slice", "plot_why", "png_bytes", "svg_text"]
