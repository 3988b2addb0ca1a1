"""The materials: named ones, bare or in a colour, and one with everything to choose.

The model is `ir.Material`'s; what makes clay of it, or glass, is the table here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from blobscript import ir, values
from blobscript.arguments import not_negative, number, positive, show
from blobscript.diagnostics import Help
from blobscript.runtime import FunctionValue
from blobscript.values import Color, Context, Maker, MakerError, Material

__all__ = ["LOOKS", "MAKERS"]

#: Parts of a material that may be functions of the place.
_TEXTURED = ("color", "roughness", "metalness", "emission", "bump")


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

    def maker(ctx: Context, color: Color | FunctionValue | None = None) -> Material:
        if isinstance(color, FunctionValue):
            return _textured(look, {"color": color})
        return look if color is None else look.tinted(color)

    return maker


def _textured(material: Material, parts: dict[str, FunctionValue]) -> Material:
    from blobscript.follow import texture  # stands above the makers, like what it follows

    return replace(material, look=replace(material.look, texture=texture(parts))) if parts else material


def _share(value: float, argument: str) -> float:
    lowest, highest = (1.0, 10.0) if argument == "ior" else (0.0, 1.0)
    if not lowest <= number(value, argument) <= highest:
        help_text = "1 bends nothing, water is 1.33, glass 1.5, diamond 2.4" if argument == "ior" else _ADVICE[argument]
        message = f"`{argument}` must lie in {lowest:g}..{highest:g}, but it is {show(value)}"
        raise MakerError("E0405", message, argument, show(value), (Help(help_text),))
    return float(value)


_ADVICE = {
    "roughness": "0 is polished, 1 is matt",
    "metalness": "0 is no metal, 1 is metal",
    "specular": "0.5 suits most things that are no metal",
    "transmission": "0 is opaque, 1 is clear",
    "reflection": "0 is no mirror, 1 is nothing else",
}


def _material(
    ctx: Context,
    color: Color | FunctionValue | None = None,
    absorption: Color | None = None,
    depth: float | None = None,
    emission: Color | FunctionValue | None = None,
    glow: float = 1.0,
    bump: FunctionValue | None = None,
    **parameters: Any,
) -> Material:
    given: dict[str, Any] = {"color": color, "emission": emission, "bump": bump, **parameters}
    textures = {name: given[name] for name in _TEXTURED if isinstance(given.get(name), FunctionValue)}
    numbers: dict[str, Any] = {name: _share(value, name) for name, value in parameters.items() if name not in textures}
    strength = not_negative(glow, "glow", "0 lets nothing glow")
    if glow != 1 and "emission" in textures:
        message = "`glow` goes with one colour of emission; a function gives the light itself"
        raise MakerError("E0405", message, "glow", "", (Help("multiply within the function"),))
    tint = color.rgb if isinstance(color, Color) else (1.0, 1.0, 1.0)
    shine = emission.rgb if isinstance(emission, Color) else (0.0, 0.0, 0.0)
    look = ir.Material(
        tint,
        absorption=_inside(absorption, color, depth),
        emission=(shine[0] * strength, shine[1] * strength, shine[2] * strength),
        name="material",
        **numbers,
    )
    return _textured(Material(look, depth or 0.0), textures)


def _inside(
    taken: Color | None, color: Color | FunctionValue | None, depth: float | None
) -> tuple[float, float, float]:
    """Absorption per scene unit: as given, or so that white light has the colour after `depth`."""
    if depth is None:
        return taken.rgb if taken else (0.0, 0.0, 0.0)
    positive(depth, "depth")
    if taken is not None:
        message = "absorption is given by `absorption`, or by `color` and `depth`, not by both"
        raise MakerError("E0405", message, "depth", "", (Help("leave one of them out"),))
    return values.absorption(color, depth) if isinstance(color, Color) else (0.0, 0.0, 0.0)


MAKERS: dict[str, Maker] = {"material": _material, **{name: _named_material(name) for name in LOOKS}}
