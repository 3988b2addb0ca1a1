"""Directives and expressions of POV-Ray's scene language.

`peek` and `take` show the words as POV-Ray's parser sees them: directives have been carried out on the way, loops go
back, and what stands in a branch not taken is not there. No file is opened: what `#include` would bring is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from blobscript.diagnostics import ProgramError
from blobscript.povray.sdl.words import Word, refused
from blobscript.source import Span

__all__ = ["COLOR_WORDS", "OBJECTS", "Made", "Opaque", "Reader", "Value", "Vector"]

Vector = tuple[float, ...]

#: Words that a loop may take in all: a scene that never ends is refused.
_BUDGET = 20_000_000

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Opaque:
    """Something declared that is not a number: what it was, and where it begins."""

    what: str
    start: int


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A declared object, as whoever reads objects made it."""

    thing: object


Value = float | Vector | str | Opaque | Made


@dataclass(slots=True)
class _Loop:
    """A `#while` or `#for` that runs: where its condition or body begins."""

    start: int
    name: str = ""
    end: float = 0.0
    step: float = 1.0


class Reader:
    """Position in a list of words, and the names declared so far."""

    def __init__(self, words: list[Word], make: Callable[[], object], names: dict[str, float]) -> None:
        """make: reads an object from here on, for declarations of one. names: declared from outside."""
        self.words, self.at = words, 0
        self._make = make
        self.names: dict[str, Value] = dict(names)
        #: Files that would have been included, and declarations that could not be read.
        self.included: list[Word] = []
        self.unread: list[Word] = []
        self._open: list[_Loop | None] = []  # None: an #if that was true
        self._streams: list[int] = []
        self._taken = 0

    # ---- words ----

    def peek(self) -> Word:
        while self.words[self.at].kind == "directive":
            self._directive()
        word = self.words[self.at]
        if word.kind == "end" and self._open:
            raise refused("a branch or loop has no `#end`", word.span)
        return word

    def take(self) -> Word:
        word = self.peek()
        self._taken += 1
        if self._taken > _BUDGET:
            raise refused("this scene takes more steps than an import may", word.span)
        if word.kind != "end":
            self.at += 1
        return word

    def accept(self, text: str) -> bool:
        if self.peek().text == text and self.peek().kind != "text":
            self.take()
            return True
        return False

    def expect(self, text: str) -> Word:
        word = self.take()
        if word.text != text:
            raise refused(f"`{text}` is missing before `{word.text}`", word.span)
        return word

    def skip_braces(self) -> None:
        """Over `{ … }`, whatever stands in it; not run."""
        self.skip_pair("{", "}")

    def skip_pair(self, opening: str, closing: str) -> None:
        start = self.expect(opening)
        depth = 1
        while depth:
            word = self.words[self.at]
            if word.kind == "end":
                raise refused(f"this `{opening}` is never closed", start.span)
            depth += {opening: 1, closing: -1}.get(word.text, 0) if word.kind == "sign" else 0
            self.at += 1

    # ---- directives ----

    def _directive(self) -> None:
        word = self.words[self.at]
        self.at += 1
        match word.text:
            case "declare" | "local":
                self._declare()
            case "if" | "ifdef" | "ifndef":
                self._if(word.text)
            case "while":
                self._while()
            case "for":
                self._for()
            case "else" | "elseif":
                self._skip_to_end(word)  # the branch before was taken
                self._close(word)
            case "end":
                self._end(word)
            case "version" | "debug" | "warning" | "render" | "statistics":
                self.expression()
                self.accept(";")
            case "undef":
                self.names.pop(self.take().text, None)
            case "default":
                self.skip_braces()
            case "include":
                self.included.append(self.take())
            case "macro":
                self._skip_to_end(word)
                self.at += 1
            case "switch":
                self._switch(word)
            case "case" | "range":
                self.skip_pair("(", ")")  # fallen through from the one before
            case "break":
                self._skip_to_end(word)
                self._close(word)
            case _:
                raise refused(f"`#{word.text}` cannot be imported", word.span)

    def _declare(self) -> None:
        word = self.take()
        if word.kind != "name":
            raise refused(f"a name is missing before `{word.text}`", word.span)
        name = self.full_name(word)
        self.expect("=")
        if self.peek().text in OBJECTS or isinstance(self.names.get(self.peek().text), Made):
            self.names[name] = Made(self._make())
        else:
            self._declare_value(name, word)
        self.accept(";")

    def _declare_value(self, name: str, word: Word) -> None:
        """What cannot be read is unknown from here on: that only matters where it is used."""
        start = self.at
        try:
            self.names[name] = self._declared()
        except ProgramError:
            self.unread.append(word)
            self.names.pop(name, None)
            self.at = start
            self._skip_statement()

    def _skip_statement(self) -> None:
        """To the next `;` or directive outside of braces."""
        while self.words[self.at].kind not in ("end", "directive") and self.words[self.at].text != ";":
            if self.words[self.at].text == "{":
                self.skip_braces()
                return
            self.at += 1

    def full_name(self, word: Word) -> str:
        """With the indices of an array: `deco[2]`."""
        name = word.text
        while self.words[self.at].text == "[":
            self.at += 1
            name += f"[{math.floor(self.number())}]"
            self.expect("]")
        return name

    def _declared(self) -> Value:
        """A number, vector or text; anything else is kept as where it stands."""
        word = self.peek()
        if word.kind == "name" and self._is_opaque(word):
            start = self.at
            known = self.names.get(word.text)
            self.take()
            if isinstance(known, Opaque):
                return known
            self._skip_value()
            return Opaque(word.text, start)
        if word.kind == "text":
            return self.take().text[1:-1]
        return self.expression()

    def _is_opaque(self, word: Word) -> bool:
        if isinstance(self.names.get(word.text), Opaque):
            return True
        if word.text in COLOR_WORDS:
            return False
        following = self.words[self.at + 1]
        return following.text == "{" or word.text in ("function", "array", "spline")

    def _skip_value(self) -> None:
        while self.words[self.at].text != "{":
            if self.words[self.at].kind in ("end", "directive"):
                return
            self.at += 1
        self.skip_braces()

    def _if(self, kind: str) -> None:
        if kind == "if":
            holds = self._condition()
        else:
            self.expect("(")
            holds = (self.take().text in self.names) == (kind == "ifdef")
            self.expect(")")
        if holds:
            self._open.append(None)
            return
        while True:
            word = self._skip_to_end(self.words[self.at - 1], branches=True)
            self.at += 1
            if word.text == "end":
                return
            if word.text == "else" or (word.text == "elseif" and self._condition()):
                self._open.append(None)
                return

    def _switch(self, start: Word) -> None:
        """To the case that holds; it runs on to `#break` or the end."""
        self.expect("(")
        value = self.number()
        self.expect(")")
        while True:
            word = self._skip_to_end(start, branches=True)
            self.at += 1
            if word.text == "end":
                return
            if word.text == "else" or self._is_case(word, value):
                self._open.append(None)
                return

    def _is_case(self, word: Word, value: float) -> bool:
        if word.text not in ("case", "range"):
            return False
        self.expect("(")
        low = self.number()
        high = self.number() if word.text == "range" and self.accept(",") else low
        self.expect(")")
        return low - 1e-10 <= value <= high + 1e-10

    def _condition(self) -> bool:
        self.expect("(")
        value = self.expression()
        self.expect(")")
        return _number(value) != 0.0

    def _while(self) -> None:
        start = self.at
        if self._condition():
            self._open.append(_Loop(start))
        else:
            self._skip_to_end(self.words[self.at - 1])
            self.at += 1

    def _for(self) -> None:
        self.expect("(")
        name = self.take().text
        numbers: list[float] = []
        while self.accept(","):
            numbers.append(_number(self.expression()))
        word = self.expect(")")
        if len(numbers) not in (2, 3) or (len(numbers) == 3 and numbers[2] == 0):
            raise refused("`#for` wants a name, start, end and perhaps a step", word.span)
        step = numbers[2] if len(numbers) == 3 else 1.0
        self.names[name] = numbers[0]
        loop = _Loop(self.at, name, numbers[1], step)
        if _goes_on(loop, numbers[0]):
            self._open.append(loop)
        else:
            self._skip_to_end(word)
            self.at += 1

    def _end(self, word: Word) -> None:
        if not self._open:
            raise refused("there is nothing to end here", word.span)
        loop = self._open[-1]
        if loop is None:
            self._open.pop()
            return
        self._taken += 1
        if self._taken > _BUDGET:
            raise refused("this loop takes more steps than an import may", word.span)
        behind, self.at = self.at, loop.start
        if loop.name:
            value = _number(self.names[loop.name]) + loop.step
            self.names[loop.name] = value
            goes_on = _goes_on(loop, value)
        else:
            goes_on = self._condition()
        if not goes_on:
            self._open.pop()
            self.at = behind

    def _close(self, word: Word) -> None:
        if not self._open:
            raise refused(f"`#{word.text}` without `#if`", word.span)
        self._open.pop()
        self.at += 1

    def _skip_to_end(self, opener: Word, branches: bool = False) -> Word:
        """To the `#end` (or branch) that belongs to a directive; it is the current word then."""
        depth = 0
        while self.words[self.at].kind != "end":
            word = self.words[self.at]
            if word.kind == "directive":
                if depth == 0 and (word.text == "end" or (branches and word.text in _BRANCHES)):
                    return word
                depth += {"end": -1}.get(word.text, 0) + (word.text in _OPENERS)
            self.at += 1
        raise refused("a branch or loop has no `#end`", opener.span)

    # ---- expressions ----

    def number(self) -> float:
        word = self.peek()
        value = self.operand()
        if isinstance(value, tuple):
            raise refused("a number is wanted here, not a vector", word.span)
        return value

    def vector(self) -> tuple[float, float, float]:
        """Three numbers; one stands for three."""
        value = self.operand()
        if not isinstance(value, tuple):
            return value, value, value
        x, y, z = (*value, 0.0, 0.0)[:3]
        return x, y, z

    def operand(self) -> float | Vector:
        """Without comparisons: what may stand between `<` and `>`."""
        return self._sum()

    def expression(self) -> float | Vector:
        """With comparisons and & | between numbers."""
        left = self._sum()
        while self.peek().text in ("<", ">", "=", "<=", ">=", "!=", "&", "|") and self.peek().kind == "sign":
            sign = self.take().text
            left = _COMPARED[sign](_number(left), _number(self._sum()))
        if self.peek().text == "?":
            self.take()
            first = self.expression()
            self.expect(":")
            second = self.expression()
            return first if _number(left) != 0 else second
        return left

    def _sum(self) -> float | Vector:
        left = self._product()
        while self.peek().text in ("+", "-") and self.peek().kind == "sign":
            operation = _add if self.take().text == "+" else _subtract
            left = _both(left, self._product(), operation)
        return left

    def _product(self) -> float | Vector:
        left = self._unary()
        while self.peek().text in ("*", "/") and self.peek().kind == "sign":
            word = self.take()
            right = self._unary()
            if word.text == "/" and 0.0 in (right if isinstance(right, tuple) else (right,)):
                raise refused("division by 0", word.span)
            left = _both(left, right, _multiply if word.text == "*" else _divide)
        return left

    def _unary(self) -> float | Vector:
        if self.accept("-"):
            return _both(0.0, self._unary(), _subtract)
        if self.accept("+"):
            return self._unary()
        if self.accept("!"):
            return float(_number(self._unary()) == 0)
        value = self._atom()
        while self.peek().text == "." and self.words[self.at + 1].text in _PARTS:
            self.take()
            part = _PARTS[self.take().text]
            value = value[part] if isinstance(value, tuple) and part < len(value) else 0.0
        return value

    def _atom(self) -> float | Vector:
        word = self.take()
        if word.kind == "number":
            return float(word.text)
        if word.text == "(":
            value = self.expression()
            self.expect(")")
            return value
        if word.text == "<":
            return self._angle_brackets()
        if word.kind == "name":
            return self._named(word)
        raise refused(f"a number is missing before `{word.text}`", word.span)

    def _angle_brackets(self) -> Vector:
        parts = [_number(self._sum())]
        while self.accept(","):
            parts.append(_number(self._sum()))
        self.expect(">")
        return tuple(parts)

    def _named(self, word: Word) -> float | Vector:
        name = self.full_name(word)
        if name in self.names:
            value = self.names[name]
            if isinstance(value, float | tuple):
                return value
            raise refused(f"`{word.text}` is no number", word.span)
        if word.text in _CONSTANTS:
            return _CONSTANTS[word.text]
        if word.text in COLOR_WORDS:
            return self._color_parts(word) if word.text in _PARTS else self._unary()
        if word.text in ("rand", "seed"):
            return self._random(word.text)
        if word.text in _FUNCTIONS:
            return self._called(word)
        unread = next((w for w in self.unread if w.text == word.text), None)
        if unread is not None:
            raise refused(f"`{word.text}` is not known: its declaration in line {unread.span.line} is not", word.span)
        if word.text in _QUERIES:
            message = f"`{word.text}` asks POV-Ray about an object, and only numbers are computed here"
            raise refused(
                message, word.span, "write the places it decides about into the scene, with #write in POV-Ray"
            )
        helps = [f"it may come from `{file.text[1:-1]}`, which is not read" for file in self.included[:1]]
        raise refused(f"`{word.text}` is not known", word.span, *helps)

    def _color_parts(self, word: Word) -> Vector:
        """`red 1 green 0.5`"""
        parts = [0.0] * 5
        while True:
            parts[_PARTS[word.text]] = _number(self._unary())
            if self.peek().text not in ("red", "green", "blue", "filter", "transmit"):
                return tuple(parts)
            word = self.take()

    def _called(self, word: Word) -> float | Vector:
        self.expect("(")
        arguments = [self.expression()]
        while self.accept(","):
            arguments.append(self.expression())
        self.expect(")")
        try:
            return _FUNCTIONS[word.text](*arguments)
        except (TypeError, ValueError, ZeroDivisionError, OverflowError, IndexError) as error:
            raise refused(f"`{word.text}` cannot take these numbers", word.span) from error

    def _random(self, name: str) -> float:
        """POV-Ray's own: x -> 1812433253 x + 12345 modulo 2^32, one row of numbers per seed."""
        self.expect("(")
        value = int(self.number())
        word = self.expect(")")
        if name == "seed":
            self._streams.append(value)
            return float(len(self._streams) - 1)
        if not 0 <= value < len(self._streams):
            raise refused("this is no row of random numbers: `seed` makes them", word.span)
        self._streams[value] = (self._streams[value] * 1812433253 + 12345) & 0xFFFFFFFF
        return self._streams[value] / 0xFFFFFFFF

    def place(self, start: int) -> Span:
        return self.words[start].span


#: Objects that may hold blobs.
OBJECTS = ("blob", "object", "union", "merge", "intersection", "difference")
_BRANCHES = ("else", "elseif", "case", "range")

#: Words before the numbers of a colour.
COLOR_WORDS = ("color", "colour", "rgb", "rgbf", "rgbt", "rgbft", "srgb", "srgbf", "srgbt", "red", "green", "blue")

_QUERIES = ("inside", "trace", "min_extent", "max_extent", "dimension_size", "eval_pigment", "chr", "function")
_OPENERS = ("if", "ifdef", "ifndef", "while", "for", "switch", "macro")
_PARTS = {"x": 0, "y": 1, "z": 2, "u": 0, "v": 1, "red": 0, "green": 1, "blue": 2, "filter": 3, "transmit": 4}

_COMPARED: dict[str, Callable[[float, float], float]] = {
    "<": lambda a, b: float(a < b),
    ">": lambda a, b: float(a > b),
    "=": lambda a, b: float(a == b),
    "<=": lambda a, b: float(a <= b),
    ">=": lambda a, b: float(a >= b),
    "!=": lambda a, b: float(a != b),
    "&": lambda a, b: float(a != 0 and b != 0),
    "|": lambda a, b: float(a != 0 or b != 0),
}

_CONSTANTS: dict[str, float | Vector] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "u": (1.0, 0.0),
    "v": (0.0, 1.0),
    "pi": math.pi,
    "clock": 0.0,
    "frame_number": 0.0,
    "image_width": 640.0,
    "image_height": 480.0,
    **dict.fromkeys(("on", "yes", "true"), 1.0),
    **dict.fromkeys(("off", "no", "false"), 0.0),
}


def _add(a: float, b: float) -> float:
    return a + b


def _subtract(a: float, b: float) -> float:
    return a - b


def _multiply(a: float, b: float) -> float:
    return a * b


def _divide(a: float, b: float) -> float:
    return a / b


def _goes_on(loop: _Loop, value: float) -> bool:
    return value <= loop.end + 1e-10 if loop.step > 0 else value >= loop.end - 1e-10


def _number(value: Value) -> float:
    """A vector where a number is wanted counts by its first part, as in POV-Ray."""
    if isinstance(value, tuple):
        return value[0]
    assert isinstance(value, float)
    return value


def _both(a: float | Vector, b: float | Vector, operation: Callable[[float, float], float]) -> float | Vector:
    """Part by part; a number goes with every part of a vector, and the shorter vector is filled up with 0."""
    if not isinstance(a, tuple) and not isinstance(b, tuple):
        return operation(a, b)
    length = max(len(v) for v in (a, b) if isinstance(v, tuple))
    left, right = ((v + (0.0,) * (length - len(v))) if isinstance(v, tuple) else (v,) * length for v in (a, b))
    return tuple(operation(p, q) for p, q in zip(left, right, strict=True))


def _three(v: float | Vector) -> Vector:
    return (*v, 0.0, 0.0)[:3] if isinstance(v, tuple) else (v, v, v)


def _dot(a: float | Vector, b: float | Vector) -> float:
    return sum(p * q for p, q in zip(_three(a), _three(b), strict=True))


def _cross(a: float | Vector, b: float | Vector) -> Vector:
    (p, q, r), (s, t, u) = _three(a), _three(b)
    return q * u - r * t, r * s - p * u, p * t - q * s


def _length(a: float | Vector) -> float:
    return math.sqrt(_dot(a, a))


def _rotated(v: float | Vector, angles: float | Vector) -> Vector:
    """About x, then y, then z, in degrees."""
    x, y, z = _three(v)
    a, b, c = (math.radians(angle) for angle in _three(angles))
    y, z = y * math.cos(a) - z * math.sin(a), y * math.sin(a) + z * math.cos(a)
    x, z = x * math.cos(b) + z * math.sin(b), z * math.cos(b) - x * math.sin(b)
    x, y = x * math.cos(c) - y * math.sin(c), x * math.sin(c) + y * math.cos(c)
    return x, y, z


def _of_numbers(function: Callable[..., float]) -> Callable[..., float]:
    return lambda *arguments: float(function(*map(_number, arguments)))


def _select(a: float, *b: float) -> float:
    return b[0] if a < 0 else b[-1] if a > 0 or len(b) == 2 else b[1]


def _truncated(a: float) -> float:
    return float(math.trunc(a))


def _division(a: float, b: float) -> float:
    return float(math.trunc(a / b))


def _normalized(v: float | Vector) -> Vector:
    length = _length(v)
    return tuple(p / length for p in _three(v))


_PLAIN = ("sqrt", "exp", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "radians")
_FUNCTIONS: dict[str, Callable[..., float | Vector]] = {
    **{name: _of_numbers(getattr(math, name)) for name in (*_PLAIN, "degrees", "floor", "ceil", "pow")},
    "abs": _of_numbers(math.fabs),
    "int": _of_numbers(_truncated),
    "ln": _of_numbers(math.log),
    "log": _of_numbers(math.log10),
    "mod": _of_numbers(math.fmod),
    "div": _of_numbers(_division),
    "min": _of_numbers(min),
    "max": _of_numbers(max),
    "select": _of_numbers(_select),
    "vlength": _length,
    "vdot": _dot,
    "vcross": _cross,
    "vnormalize": _normalized,
    "vrotate": _rotated,
}
