"""Random scripts with numbers of all sizes: always a scene or a diagnostic, never a traceback."""

from __future__ import annotations

import random

import pytest

from blobscript.driver import compile_source
from blobscript.source import Source

KERNELS = ["soft2", "soft3", "gauss", "gauss(a = {})", "gauss_c1(a = {})", "metaball"]
BODY = "faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]"


class Writer:
    """Writes scripts; most numbers are usual ones."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def number(self) -> str:
        size = self.rng.random()
        if size < 0.85:
            return f"{self.rng.uniform(-3, 3):.3g}"
        if size < 0.93:
            return f"{self.rng.choice([1, -1]) * 10 ** self.rng.uniform(-42, 42):.3g}"
        return self.rng.choice(["0", "1", "-1", "1e-300", "1e300", "1e39", "-1e39", "1e-39", "1e5 * 1e300"])

    def positive(self) -> str:
        return f"{10 ** self.rng.uniform(-3, 3):.3g}" if self.rng.random() < 0.8 else self.number()

    def vector(self) -> str:
        return f"({self.number()}, {self.number()}, {self.number()})"

    def vectors(self) -> str:
        return "[" + ", ".join(self.vector() for _ in range(self.rng.randrange(6))) + "]"

    def sizes(self) -> str:
        p = self.positive
        given = self.rng.choice(
            [
                f"radius = {p()}",
                f"reach = {p()}",
                f"reach = {p()}, weight = {self.number()}",
                f"radius = {p()}, reach = {p()}",
                f"radius = {p()}, weight = {p()}",
            ]
        )
        if self.rng.random() < 0.5:
            given += ", kernel = " + self.rng.choice(KERNELS).format(p())
        return given

    def skeleton(self) -> str:
        flat = ", ".join(f"({self.number()}, {self.number()}, 0)" for _ in range(4))
        return self.rng.choice(
            [
                f"point{self.vector()}",
                f"line({self.vector()}, {self.vector()})",
                f"polyline({self.vectors()})",
                f"polygon([{flat}])",
                f"mesh([{self.vector()}, {self.vector()}, {self.vector()}], faces = [[0, 1, 2]])",
                f"points({self.vectors()})",
                f"polyhedron([(0, 0, 0), ({self.number()}, 0, 0), (0, {self.number()}, 0), (0, 0, 1)], {BODY})",
            ]
        ) + (self.change() if self.rng.random() < 0.3 else "")

    def change(self) -> str:
        n = self.number
        return self.rng.choice(
            [
                "",
                f".move{self.vector()}",
                f".scale({n()})",
                f".scale({n()}, {n()}, {n()})",
                f".rotate(x = {n()}rad, z = 1rad)".replace("1e5 * 1e300rad", "1rad").replace("--", ""),
                f".mirror({self.vector()})",
            ]
        )

    def field(self, depth: int = 0) -> str:
        kind = self.rng.random()
        if kind < 0.5 or depth > 3:
            text = f"ball({self.vector()}, {self.sizes()})"
        elif kind < 0.7:
            text = f"{self.skeleton()}.blob({self.sizes()})"
        elif kind < 0.75:
            text = f"balls({self.vectors()}, {self.sizes()})"
        else:
            inner = "\n".join(self.field(depth + 1) for _ in range(self.rng.randrange(4)))
            text = f"{self.rng.choice(['sum', 'max', 'min'])} {{\n{inner}\n}}"
        text += self.change()
        return f"{self.number()} * ({text})" if self.rng.random() < 0.2 else text

    def script(self) -> str:
        surfaces = [
            f"surface(threshold = {self.rng.choice(['0.5', '0.3', self.number()])}) {{\n"
            + "\n".join(self.field() for _ in range(self.rng.randrange(5)))
            + "\n}"
            + self.change()
            for _ in range(self.rng.randrange(1, 3))
        ]
        camera = [f"camera(from = {self.vector()}, to = {self.vector()})"] if self.rng.random() < 0.3 else []
        return "\n".join(surfaces + camera)


@pytest.mark.parametrize("start", range(0, 240, 20))
def test_random_scripts(start):
    for seed in range(start, start + 20):
        text = Writer(seed).script()
        scene, found = compile_source(Source("random.blob", text))
        assert scene is not None or found, text
        assert all(d.span is not None for d in found), text
        assert {d.code[:3] for d in found} <= {"E04", "W04"}, text


def test_most_kinds_of_findings_occur():
    """The scripts are varied enough to mean something."""
    scenes, codes = 0, set()
    for seed in range(240):
        scene, found = compile_source(Source("random.blob", Writer(seed).script()))
        scenes += scene is not None
        codes |= {d.code for d in found}
    assert scenes > 40
    assert codes >= {"E0404", "E0405", "E0406", "W0401", "W0406", "W0407"}
