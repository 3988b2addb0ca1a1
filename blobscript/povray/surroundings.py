"""A picture of all directions as functions of POV-Ray: what of it a place sends to the eye.

Light that comes from everywhere depends on the normal and on the way to the eye, which a texture of POV-Ray cannot
see together. But both are functions of the place: the way to the eye at once, the normal as the gradient of the density
that makes the surface. So the answer of the material is computed by functions, the same as in shade.c (`point_even`),
and is exact for what the camera sees itself; what is seen in mirrors looks as the camera would see it.
"""

from __future__ import annotations

import numpy as np

from blobscript import ir
from blobscript.backends import picture
from blobscript.povray.beside import Beside
from blobscript.povray.facets import SINGLES, singles
from blobscript.povray.text import Array, comment, number, vector
from blobscript.povray.view import sky_image

__all__ = ["Surroundings"]

#: The step by which gradients are taken, as a part of the scene's size.
_STEP = 1e-6
#: For each of red, green and blue, {0}; x y z: a normal, f g h: the way to the eye or what is mirrored, q: the cosine
#: between, k: colour there, r m p: roughness, metalness, reflectance, o: where `SINGLES` has those of this roughness,
#: b l: shares of base and layer, e: emission.
#: POV-Ray takes u, v and w for other names of x, y and z: no function may have both.
_FUNCTIONS = """\
#declare ENV_L{0} = function(x,y,z) {{ max(0,{1}) }}
#declare ENV_I{0} = function(x,y,z) {{ SKY(x,y,z).{2} }}
#declare ENV_E{0} = function(a,c,i,s,k,r,m,b,l,e) {{ e+b*(1-m)*k*(1-s)*a+l*s*((1-r)*i+r*c) }}
#declare ENV_D{0} = function(x,y,z,f,g,h,q,k,r,m,p,o,b,l,e) {{
  ENV_E{0}(ENV_L{0}(x,y,z),ENV_L{0}(f,g,h),ENV_I{0}(f,g,h),
    ENV_S(p+m*(k-p),k,r,m,ENV_A(r,abs(q)),ENV_O(o,abs(q))),k,r,m,b,l,e) }}
#declare ENV_C{0} = function(x,y,z,f,g,h,q,k,r,m,p,o,b,l,e) {{
  ENV_D{0}(x*SIGN(q),y*SIGN(q),z*SIGN(q),2*q*x-f,2*q*y-g,2*q*z-h,q,k,r,m,p,o,b,l,e) }}
#declare ENV_B{0} = function(x,y,z,f,g,h,k,r,m,p,o,b,l,e) {{ ENV_C{0}(x,y,z,f,g,h,x*f+y*g+z*h,k,r,m,p,o,b,l,e) }}
#declare ENV_N{0} = function(x,y,z,f,g,h,n,d,k,r,m,p,o,b,l,e) {{
  ENV_B{0}(x/n,y/n,z/n,f/d,g/d,h/d,k,r,m,p,o,b,l,e) }}
#declare ENV_{0} = function(x,y,z,f,g,h,k,r,m,p,o,b,l,e) {{
  ENV_N{0}(x,y,z,f,g,h,LEN(x,y,z),LEN(f,g,h),k,r,m,p,o,b,l,e) }}"""


class Surroundings:
    """An environment. eye and size of the scene are in POV-Ray's units."""

    def __init__(self, environment: ir.Environment, eye: Array, size: float, beside: Beside) -> None:
        background = ir.Background((0.0, 0.0, 0.0), light=environment)
        packed, _kept = picture.pack_sky(background)
        self._fill = float(packed.fill)
        even, tilt = np.array(packed.ambient), np.array(packed.tilt).reshape(3, 3)
        self._most = np.maximum(environment.pixels.max(axis=(0, 1)), even + np.linalg.norm(tilt, axis=1)) + even
        self._eye, self._step = eye, _STEP * size
        self.pigment = sky_image(environment, beside)
        self._roughnesses: list[float] = []
        self._lines = [
            comment("the environment: x y z a normal, f g h the way to the eye -> light that is sent there"),
            f"#declare SKY = function {{ pigment {{ {self.pigment} }} }}",
            "#declare LEN = function(x,y,z) { max(1e-300,sqrt(x*x+y*y+z*z)) }",
            "#declare SIGN = function(a) { select(a,-1,1) }",
            "#declare ENV_A = function(r,q) { min((1-r)*(1-r),pow(2,-9.28*q))*(1-r)+0.0425-0.0275*r }",
            "#declare ENV_F = function(r,a) { 1.04-1.04*a-0.572*r }",
            "#declare ENV_H = function(r,a) { max(0,1.04*a-0.04+0.022*r) }",
            "#declare ENV_T = function(r,m,a,j) { ENV_F(r,a)+m*(j-ENV_H(r,a)-ENV_F(r,a)) }",
            "#declare ENV_S = function(f,k,r,m,a,j) { min(1,(f*ENV_T(r,m,a,j)+ENV_H(r,a))*(1+m*k*(1/j-1))) }",
        ]
        for channel, word, mean, slope in zip("RGB", ("red", "green", "blue"), even.tolist(), tilt, strict=True):
            light = "+".join(
                [number(mean), *(f"({number(f)})*{c}" for f, c in zip(slope.tolist(), "xyz", strict=True))]
            )
            self._lines += _FUNCTIONS.format(channel, light, word).split("\n")

    @property
    def lines(self) -> list[str]:
        """Declares the functions that the pigments so far use."""
        if not self._roughnesses:
            return [*self._lines[:1], "#declare ENV_O = function(o,q) { 1 }", *self._lines[1:]]
        nodes = [
            f"{number(round(2 * row + root, 9))}, <{number(round(value, 9))}, 0, 0>"
            for row, roughness in enumerate(self._roughnesses)
            for root, value in zip(np.sqrt(SINGLES).tolist(), singles(roughness).tolist(), strict=True)
        ]
        return [
            *self._lines[:1],
            comment("what facets of metals return after one reflection, by the root of the cosine to the eye"),
            "#declare SINGLES = function { spline { linear_spline",
            *(f"  {', '.join(nodes[k : k + 4])}," for k in range(0, len(nodes) - 4, 4)),
            f"  {', '.join(nodes[-4:])} }} }}",
            f"#declare ENV_O = function(o,q) {{ SINGLES(o+sqrt(min(1,max({number(float(SINGLES[0]))},q)))).x }}",
            *self._lines[1:],
        ]

    def _row(self, m: ir.Material) -> int:
        """Where the spline has what this material's facets return; anywhere for what is no metal."""
        if m.metalness <= 0:
            return 0
        if m.roughness not in self._roughnesses:
            self._roughnesses.append(m.roughness)
        return 2 * self._roughnesses.index(m.roughness)

    def gradient(self, density: str) -> str:
        """Three expressions: the gradient of a function of the place, of any length."""
        h = number(float(f"{self._step:.3g}"))
        ends = (("x{}" + h, "y", "z"), ("x", "y{}" + h, "z"), ("x", "y", "z{}" + h))
        return ",".join("-".join(f"{density}({','.join(at).format(sign)})" for sign in "+-") for at in ends)

    def glow(self, m: ir.Material, normal: str, colors: tuple[str, str, str] | None) -> str:
        """A pigment: twice what an opaque material sends to the eye. normal: three expressions."""
        smooth = m.metalness * (1 - m.roughness) ** 2
        layer = (1 - m.reflection) * (1 - smooth) * (self._fill + (1 - self._fill) * m.metalness)
        base = (1 - m.reflection) * self._fill * (1 - m.transmission)
        away = ",".join(f"{number(float(e))}-{c}" for e, c in zip(self._eye, "xyz", strict=True))
        parts: list[str] = []
        row = self._row(m)
        for k, channel in enumerate("RGB"):
            color = colors[k] if colors else number(m.color[k])
            numbers = (m.roughness, m.metalness, 0.08 * m.specular, row, base, layer, m.emission[k])
            most = float(f"{1.05 * (m.emission[k] + float(self._most[k])) + 1e-6:.3g}")
            value = f"ENV_{channel}({normal},{away},{color},{','.join(map(number, numbers))})"
            bright = vector(6.0 * most * np.eye(3)[k])
            parts.append(f"[1 function {{ {value}/{number(most)} }} color_map {{ [0 rgb 0] [1 rgb {bright}] }}]")
        return "average pigment_map {\n    " + "\n    ".join(parts) + " }"

    def horizon(self, height: float) -> str:
        """A pigment for a level plane: the sky behind it at the height of the eye."""
        at = np.array([self._eye[0], height, self._eye[2]])
        return f"{self.pigment} translate {vector(at)}"
