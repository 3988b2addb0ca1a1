"""The materials: named ones, bare or in a colour, and one with everything to choose.

The model is `ir.Material`'s; what makes clay of it, or glass, is the table here.
"""

from __future__ import annotations

from typing import Any

from blobscript import ir
from blobscript.arguments import number, show
from blobscript.values import Color, Context, Maker, MakerError, Material

__all__ = ["LOOKS", "MAKERS"]


def _look(name: str, color: str, depth: float = 0.0, **parameters: Any) -> Material:
    r, g, b = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    tint = Color.from_srgb(r, g, b)
    return Material(ir.Material((1.0, 1.0, 1.0), name=name, **parameters), depth).tinted(tint)


#: The named materials with the colour they have when none is given.
LOOKS: dict[str, Material] = {
    "clay": _look("clay", "#d9866a", roughness=0.9, specular=0.25),
    "plastic": _look("plastic", "#d8d8dc", roughness=0.25, specular=0.5),
    "metal": _look("metal", "#b9bcc2", roughness=0.35, metalness=1.0),
    "glass": _look("glass", "#f4fbf8", depth=2.0, roughness=0.0, transmission=1.0, ior=1.5),
    "jelly": _look("jelly", "#f2555a", depth=0.5, roughness=0.1, transmission=0.75, ior=1.35),
    "chrome": _look("chrome", "#e8eaec", roughness=0.02, metalness=1.0),
    "stone": _look("stone", "#8f8b84", roughness=1.0, specular=0.2),
}


def _named_material(name: str) -> Maker:
    look = LOOKS[name]

    def maker(ctx: Context, color: Color | None = None) -> Material:
        return look if color is None else look.tinted(color)

    return maker


def _material(
    ctx: Context,
    color: Color | None = None,
    absorption: Color | None = None,
    emission: Color | None = None,
    **parameters: Any,
) -> Material:
    for argument, value in parameters.items():
        highest = 10.0 if argument == "ior" else 1.0
        lowest = 1.0 if argument == "ior" else 0.0
        if not lowest <= number(value, argument) <= highest:
            raise MakerError(
                "E0405", f"`{argument}` must lie in {lowest:g}..{highest:g}, but it is {show(value)}", argument
            )
    black, white = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    return Material(
        ir.Material(
            color.rgb if color else white,
            absorption=absorption.rgb if absorption else black,
            emission=emission.rgb if emission else black,
            name="material",
            **{name: float(value) for name, value in parameters.items()},
        )
    )


MAKERS: dict[str, Maker] = {"material": _material, **{name: _named_material(name) for name in LOOKS}}
