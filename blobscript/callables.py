"""What can be called: signatures, read from the notation of `signatures` or from a definition.

A `Signature` is the same for built-ins, functions of the script, kernels and function values, so
that arguments are checked by one piece of code.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from blobscript.signatures import BUILTINS
from blobscript.types import PRIMITIVES, Choice, FnOf, ListOf, OneOf, RecordOf, Type, Variable

__all__ = ["Parameter", "Signature", "builtin_signatures", "builtin_type", "read_signature", "read_type"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """`optional`: may be left out. `rest`: takes all further positional arguments as a list."""

    name: str
    type: Type
    optional: bool = False
    named_only: bool = False
    rest: bool = False


@dataclass(frozen=True, slots=True)
class Signature:
    """`text` is what a message shows, without the marks of optional parameters."""

    name: str
    parameters: tuple[Parameter, ...]
    result: Type
    text: str

    def parameter(self, name: str) -> Parameter | None:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        return None

    @property
    def positional(self) -> tuple[Parameter, ...]:
        return tuple([p for p in self.parameters if not p.named_only])

    @property
    def type(self) -> FnOf:
        """The type of the function as a value: what must be given, in order."""
        return FnOf(tuple([p.type for p in self.parameters if not p.optional and not p.rest]), self.result)


@cache
def builtin_signatures(name: str) -> tuple[Signature, ...]:
    """The signatures of a built-in name, in the order in which they are tried."""
    row = BUILTINS.get(name)
    return tuple([read_signature(name, text) for text in row.signatures]) if row else ()


@cache
def builtin_type(text: str) -> Type:
    return read_type(text)


# ---- the notation ---------------------------------------------------------------------

_TOKEN = re.compile(r'\s*(->|\.\.\.|"[^"]*"|[A-Za-z_][A-Za-z0-9_]*|.)')


def read_type(text: str) -> Type:
    """A type in the notation of the table."""
    return _Reader(text, {}).type()


def read_signature(name: str, text: str) -> Signature:
    """A signature in the notation of the table, without its name."""
    reader = _Reader(text, {})
    reader.variables()
    parameters = reader.parameters()
    reader.take("->")
    shown = re.sub(r"^\[[^\]]*\](?=\()", "", text.replace("?:", ":"))
    return Signature(name, parameters, reader.type(), name + shown)


class _Reader:
    """Reads the notation token by token; the table is ours, so it is never wrong."""

    def __init__(self, text: str, variables: dict[str, Variable]) -> None:
        self._tokens = [found.group(1) for found in _TOKEN.finditer(text)] + [""]
        self._at = 0
        self._variables = variables

    @property
    def _next(self) -> str:
        return self._tokens[self._at]

    def take(self, token: str) -> bool:
        if self._next != token:
            return False
        self._at += 1
        return True

    def _word(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1]

    def variables(self) -> None:
        """`[A, B: number | vec3]` before the parameters."""
        if not self.take("["):
            return
        while not self.take("]"):
            name = self._word()
            allowed = self._options() if self.take(":") else ()
            self._variables[name] = Variable(name, allowed)
            self.take(",")

    def parameters(self) -> tuple[Parameter, ...]:
        self.take("(")
        found: list[Parameter] = []
        named_only = False
        while not self.take(")"):
            if self.take("*"):
                named_only = True
            else:
                found.append(self._parameter(named_only))
            self.take(",")
        return tuple(found)

    def _parameter(self, named_only: bool) -> Parameter:
        rest = self.take("...")
        name = self._word()
        optional = self.take("?")
        self.take(":")
        kind = self.type()
        if self.take("="):
            optional = True
            self._skip_default()
        return Parameter(name, kind, optional, named_only, rest)

    def _skip_default(self) -> None:
        depth = 0
        while depth or self._next not in (",", ")"):
            depth += {"(": 1, ")": -1}.get(self._word(), 0)

    def type(self) -> Type:
        options = self._options()
        if all(isinstance(option, Choice) for option in options):
            return Choice(tuple([value for option in options if isinstance(option, Choice) for value in option.values]))
        return options[0] if len(options) == 1 else OneOf(options)

    def _options(self) -> tuple[Type, ...]:
        options = [self._one()]
        while self.take("|"):
            options.append(self._one())
        return tuple(options)

    def _one(self) -> Type:
        if self.take("["):
            element = self.type()
            self.take("]")
            return ListOf(element)
        if self.take("("):
            return self._record_or_function()
        word = self._word()
        if word.startswith('"'):
            return Choice((word[1:-1],))
        return self._variables.get(word) or PRIMITIVES[word]

    def _record_or_function(self) -> Type:
        if self._tokens[self._at + 1] == ":":
            fields: list[tuple[str, Type]] = []
            while not self.take(")"):
                name = self._word()
                self.take(":")
                fields.append((name, self.type()))
                self.take(",")
            return RecordOf(tuple(fields))
        parameters: list[Type] = []
        while not self.take(")"):
            parameters.append(self.type())
            self.take(",")
        self.take("->")
        return FnOf(tuple(parameters), self.type())
