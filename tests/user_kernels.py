"""User kernels for several suites: scripts with the same function in Python, and how to prove them."""

from __future__ import annotations

import math

from blobscript import proof, syntax
from blobscript.ir import Kernel
from blobscript.parse import parse
from blobscript.source import Source


def prove(text: str, **arguments):
    """The kernel declared in a script, with values for its parameters; (kernel, diagnostics)."""
    script, found = parse(Source("kernels.blob", text))
    assert not found
    node = next(item for item in script.items if isinstance(item, syntax.KernelDecl))
    waivers = [argument.value.text for attribute in node.attributes for argument in attribute.arguments]
    return proof.prove(node.name.text, node.parameters, node.body, arguments, waivers, node.name.span)


def proved(text: str, **arguments) -> Kernel:
    kernel, found = prove(text, **arguments)
    assert kernel is not None, [d.message for d in found]
    assert found == []
    return kernel


def bump(r: float) -> float:
    return (1 - r * r) ** 2 * (1 + math.atan(r) / 3 - r / 3)


#: (script, arguments, the same in Python)
GOOD = [
    ("kernel soft(r, k: int = 3) = (1 - r^2)^k", {"k": 2}, lambda r: (1 - r * r) ** 2),
    ("kernel soft(r, k: int = 3) = (1 - r^2)^k", {"k": 7}, lambda r: (1 - r * r) ** 7),
    (
        "kernel soft(r, k: int = 3) = (1 - r^2)^k",
        {"k": 40},
        lambda r: math.exp(40 * math.log1p(-r * r)) if r < 1 else 0.0,
    ),
    (
        "kernel metaball(r) = if (r < 1 / 3) 1 - 3 * r^2 else 1.5 * (1 - r)^2",
        {},
        lambda r: 1 - 3 * r * r if r < 1 / 3 else 1.5 * (1 - r) ** 2,
    ),
    (
        "@allow(nonmonotone)\nkernel shell(r) = (1 - r^2)^2 * (1 + 6 * r^2)",
        {},
        lambda r: (1 - r * r) ** 2 * (1 + 6 * r * r),
    ),
    (
        "kernel shoulder(r, k: int = 2) = (1 - r^2)^k * (1 + k * r^2)",
        {"k": 3},
        lambda r: (1 - r * r) ** 3 * (1 + 3 * r * r),
    ),
    ("kernel smooth(r) = 1 - 3 * r^2 + 2 * r^3", {}, lambda r: 1 - 3 * r**2 + 2 * r**3),
    ("kernel smoother(r) = 1 - 10 * r^3 + 15 * r^4 - 6 * r^5", {}, lambda r: (1 - r) ** 3 * (1 + 3 * r + 6 * r * r)),
    ("kernel cosine(r) = (1 + cos(180deg * r)) / 2", {}, lambda r: (1 + math.cos(math.pi * r)) / 2),
    ("kernel cosine(r) = (1 + cos(0.5turn * r)) / 2", {}, lambda r: (1 + math.cos(math.pi * r)) / 2),
    ("@allow(crease)\nkernel cone(r) = 1 - r", {}, lambda r: 1 - r),
    (
        "kernel g(r, a = 4) = (exp(-a * r^2) - exp(-a) * (1 + a * (1 - r^2))) / (1 - (1 + a) * exp(-a))",
        {"a": 4.0},
        lambda r: (math.exp(-4 * r * r) - math.exp(-4) * (5 - 4 * r * r)) / (1 - 5 * math.exp(-4)),
    ),
    ("kernel rational(r) = (1 - r^2)^2 / (1 + 2 * r^2)", {}, lambda r: (1 - r * r) ** 2 / (1 + 2 * r * r)),
    ("kernel bump(r) = (1 - r^2)^2 * (1 + atan(r) / 3 - r / 3)", {}, bump),
    ("@allow(crease)\nkernel clamped(r) = clamp(1.5 - 2 * r, 0, 1)", {}, lambda r: min(max(1.5 - 2 * r, 0), 1)),
    ("kernel most(r) = max((1 - r^2)^3, 0)", {}, lambda r: (1 - r * r) ** 3),
    ("kernel root(r) = sqrt(1 + 3 * (1 - r^2)^2) - 1", {}, lambda r: math.sqrt(1 + 3 * (1 - r * r) ** 2) - 1),
    ("kernel mixed(r) = lerp((1 - r^2)^2, (1 - r^2)^3, 0.25)", {}, lambda r: (1 - r * r) ** 2 * (1 - 0.25 * r * r)),
    (
        "@allow(nonmonotone)\nkernel wave(r) = (1 - r^2)^2 * cos(720deg * r)",
        {},
        lambda r: (1 - r * r) ** 2 * math.cos(4 * math.pi * r),
    ),
    (
        "kernel plateau(r) = if (r <= 1/4) 1 else if (r < 3/4) 1 - 3 * (2*r - 1/2)^2 + 2 * (2*r - 1/2)^3 else 0",
        {},
        lambda r: 1 if r < 0.25 else 0 if r > 0.75 else 1 - 3 * (2 * r - 0.5) ** 2 + 2 * (2 * r - 0.5) ** 3,
    ),
    ("kernel power(r, k = 1.5) = (1 - r^2)^k", {"k": 1.5}, lambda r: (1 - r * r) ** 1.5),
    ("kernel power(r, k = 1.5) = (1 - r^2)^k", {"k": 2.25}, lambda r: (1 - r * r) ** 2.25),
    ("kernel pointed(r) = 1 - r^1.5 * (2.5 - 1.5 * r)", {}, lambda r: 1 - r**1.5 * (2.5 - 1.5 * r)),
    ("kernel fifth(r) = sqrt(4 * (1 - r^2)^5) / 2", {}, lambda r: (1 - r * r) ** 2.5),
]
