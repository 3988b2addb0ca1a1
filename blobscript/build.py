"""Grammar rules -> nodes of `syntax`. Each method is named after the rule or alias that it builds.

A method gets the children that the grammar keeps (named tokens and the values of rules; None for
an absent optional part) and the offsets of the whole.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, insort
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

from blobscript import syntax as s
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.source import Source, Span
from blobscript.tokens import Token
from blobscript.words import RESERVED

__all__ = ["Builder"]

_ANGLE = re.compile(r"(.*?)(deg|rad|turn)")
_ESCAPES = {"n": "\n", "t": "\t", '"': '"', "\\": "\\", "{": "{", "}": "}"}

#: Parses the expression between two offsets of the source: what stands between { } in a text.
ParsePart = Callable[[int, int], s.Expr]


class Builder:
    """Builds the nodes of one source; mistakes that only show here are put into `diagnostics`."""

    def __init__(self, source: Source, parse_part: ParsePart) -> None:
        self._source = source
        self._text = source.text
        self._has_docs = "///" in source.text
        self._parse_part = parse_part
        self._mistakes: list[int] = []
        self._blocks: list[int] = []
        self.diagnostics: list[Diagnostic] = []

    def note_mistake(self, offset: int) -> None:
        """Something is wrong here and has been reported. What was guessed around it is not for later passes."""
        insort(self._mistakes, offset)

    def actions(self) -> dict[str, Callable[[list[Any], int, int], Any]]:
        """Rule or alias -> its method."""
        return {
            name: getattr(self, name)
            for name in dir(type(self))
            if name[0] != "_" and name not in ("actions", "note_mistake")
        }

    # ---- small things ------------------------------------------------------------------

    def _span(self, start: int, end: int) -> Span:
        return Span(self._source, start, end)

    def _name(self, token: Token) -> s.Name:
        return s.Name(self._text[token.start : token.end], Span(self._source, token.start, token.end))

    def _bound(self, token: Token) -> s.Name:
        """A name that is defined here: not a reserved word."""
        name = self._name(token)
        if name.text in RESERVED:
            self.diagnostics.append(reserved(name.span))
        return name

    def _doc(self, start: int) -> str:
        """The text of the `///` lines right above an offset that is the first of its line."""
        if not self._has_docs:
            return ""
        line, column = self._source.position(start)
        if self._source.line(line)[: column - 1].strip():
            return ""
        lines: list[str] = []
        while (text := self._source.line(line - 1).strip()).startswith("///"):
            lines.append(text[3:].strip())
            line -= 1
        return "\n".join(reversed(lines))

    def _items(self, items: list[Any]) -> list[Any]:
        """Items one by one (a dropped one may stand as several definitions), the spoilt ones as errors."""
        if any(isinstance(item, list) for item in items):
            rows = (cast("list[Any]", item) if isinstance(item, list) else (item,) for item in items)
            items = [one for row in rows for one in row]
        if not self._mistakes:
            return items
        return [_stand_in(item) if self._is_spoilt(item) else item for item in items]

    def _is_spoilt(self, item: Any) -> bool:
        """Whether there is a mistake in an item, which has no block of several lines (whose items are on their own)."""
        span = getattr(item, "span", None)
        if span is None or isinstance(item, s.Error):
            return False
        if isinstance(item, s.Fn):
            head = item.result or (item.parameters[-1] if item.parameters else item.name)
            if self._has_mistake(Span(self._source, span.start, head.span.end)):
                return True
        return self._has_mistake(span) and not any(span.start <= block < span.end for block in self._blocks)

    def _has_mistake(self, span: Span) -> bool:
        at = bisect_left(self._mistakes, span.start)
        return at < len(self._mistakes) and self._mistakes[at] <= span.end

    def _sound(self, arguments: list[s.Argument]) -> list[s.Argument]:
        """The arguments before a block: a spoilt one is an error under its label, or left out."""
        spoilt = [self._has_mistake(argument.span) for argument in arguments]
        return [
            replace(argument, value=s.Error(argument.value.span)) if bad else argument
            for argument, bad in zip(arguments, spoilt, strict=True)
            if argument.label or not bad
        ]

    # ---- files ---------------------------------------------------------------------------

    def start(self, c: list[Any], start: int, end: int) -> s.Script:
        edition = None
        if c and isinstance(c[0], _Edition):
            edition = c[0].number
        items = [item for item in self._items(c) if item is not None and not isinstance(item, _Edition)]
        return s.Script(self._source, edition, tuple(items))

    def header(self, c: list[Any], start: int, end: int) -> _Edition:
        text = self._text[c[0].start : c[0].end]
        if text != "1":
            span = self._span(c[0].start, c[0].end)
            self.diagnostics.append(
                Diagnostic(
                    "E0108",
                    f"there is no edition {text} of the language",
                    span,
                    "the newest edition is 1",
                    helps=(Help("write", (Edit(span, "1"),)),),
                )
            )
        return _Edition(1)

    def lone_block(self, c: list[Any], start: int, end: int) -> s.Block:
        return c[0]

    def lone_expr(self, c: list[Any], start: int, end: int) -> s.Expr:
        return c[0]

    # ---- declarations ----------------------------------------------------------------------

    def attributed(self, c: list[Any], start: int, end: int) -> s.TopItem:
        attributes, decl = c
        if not isinstance(decl, (s.Param, s.Fn, s.KernelDecl)):
            return decl
        doc = self._doc(start) or decl.doc
        return replace(decl, attributes=tuple(attributes), doc=doc)

    def attributes(self, c: list[Any], start: int, end: int) -> list[s.Attribute]:
        return c

    def attr(self, c: list[Any], start: int, end: int) -> s.Attribute:
        name, arguments = c
        return s.Attribute(self._name(name), tuple(arguments or ()), self._span(start, end))

    def import_names(self, c: list[Any], start: int, end: int) -> s.ImportNames:
        names, (path, is_file, path_span) = c[0], self._origin(c[1])
        return s.ImportNames(tuple(names), path, is_file, path_span, self._span(start, end))

    def import_module(self, c: list[Any], start: int, end: int) -> s.ImportModule:
        path, is_file, path_span = self._origin(c[0])
        return s.ImportModule(path, is_file, self._bound(c[1]), path_span, self._span(start, end))

    def _origin(self, value: Any) -> tuple[str, bool, Span]:
        if isinstance(value, Token):
            text = self.string([value], value.start, value.end)
            path = "".join(part for part in text.parts if isinstance(part, str))
            return path, True, text.span
        return value[0], False, value[1]

    def names(self, c: list[Any], start: int, end: int) -> list[s.Name]:
        return [self._bound(token) for token in c]

    def dotted(self, c: list[Any], start: int, end: int) -> tuple[str, Span]:
        return ".".join(self._name(token).text for token in c), self._span(start, end)

    def type_decl(self, c: list[Any], start: int, end: int) -> s.TypeAlias:
        return s.TypeAlias(self._bound(c[0]), c[1], self._doc(start), self._span(start, end))

    def param_decl(self, c: list[Any], start: int, end: int) -> s.Param:
        name, type_, default, allowed, step = c
        return s.Param(self._bound(name), type_, default, allowed, step, (), self._doc(start), self._span(start, end))

    def fn_decl(self, c: list[Any], start: int, end: int) -> s.Fn:
        name, parameters, result, body = c
        return self._fn(name, parameters, result, [], body, start, end)

    def fn_block_decl(self, c: list[Any], start: int, end: int) -> s.Fn:
        name, parameters, result, statements, body = c
        return self._fn(name, parameters, result, statements, body, start, end)

    def _fn(
        self, name: Token, parameters: Any, result: Any, statements: list[Any], body: s.Expr, start: int, end: int
    ) -> s.Fn:
        return s.Fn(
            self._bound(name),
            tuple(parameters or ()),
            result,
            tuple(statements),
            body,
            (),
            self._doc(start),
            self._span(start, end),
        )

    def statements(self, c: list[Any], start: int, end: int) -> list[Any]:
        return self._items(c)

    def kernel_decl(self, c: list[Any], start: int, end: int) -> s.KernelDecl:
        name, parameters, body = c
        return s.KernelDecl(
            self._bound(name), tuple(parameters or ()), body, (), self._doc(start), self._span(start, end)
        )

    def params(self, c: list[Any], start: int, end: int) -> list[s.Parameter]:
        """The `*` becomes a mark on the parameters behind it."""
        out: list[s.Parameter] = []
        named_only = False
        for child in c:
            if isinstance(child, Span):
                if named_only:
                    self.diagnostics.append(Diagnostic("E0103", "one `*` is enough", child, "a second `*`"))
                named_only = True
            elif not isinstance(child, Token):
                out.append(replace(child, named_only=True) if named_only else child)
        if named_only and isinstance(c[-1], Span):
            self.diagnostics.append(
                Diagnostic(
                    "E0103", "no parameter stands after this `*`", c[-1], "the parameters after it are given by name"
                )
            )
        return out

    def parameter(self, c: list[Any], start: int, end: int) -> s.Parameter:
        name, type_, default = c
        return s.Parameter(self._bound(name), type_, default, False, self._span(start, end))

    def named_only(self, c: list[Any], start: int, end: int) -> Span:
        return self._span(start, end)

    # ---- items -------------------------------------------------------------------------------

    def let(self, c: list[Any], start: int, end: int) -> s.Let:
        return s.Let(self._bound(c[0]), c[1], c[2], self._doc(start), self._span(start, end))

    def assert_(self, c: list[Any], start: int, end: int) -> s.Assert:
        return s.Assert(c[0], c[1], self._span(start, end))

    def debug(self, c: list[Any], start: int, end: int) -> s.Debug:
        return s.Debug(c[0], self._span(start, end))

    def for_item(self, c: list[Any], start: int, end: int) -> s.For:
        return s.For(c[0], c[1], c[2], self._span(start, end))

    def if_item(self, c: list[Any], start: int, end: int) -> s.If:
        return s.If(c[0], c[1], c[2], self._span(start, end))

    def binder(self, c: list[Any], start: int, end: int) -> s.Binder:
        first, second = c
        if second is None:
            return s.Binder(None, self._bound(first), self._span(start, end))
        return s.Binder(self._bound(first), self._bound(second), self._span(start, end))

    def spread(self, c: list[Any], start: int, end: int) -> s.Spread:
        return s.Spread(c[-1], self._span(start, end))

    def block(self, c: list[Any], start: int, end: int) -> s.Block:
        if "\n" in self._text[start:end]:
            self._blocks.append(start)
        return s.Block(tuple(c[0] or ()), self._span(start, end))

    def items(self, c: list[Any], start: int, end: int) -> list[Any]:
        return self._items(c)

    # ---- expressions ---------------------------------------------------------------------------

    def if_expr(self, c: list[Any], start: int, end: int) -> s.IfExpr:
        return s.IfExpr(c[0], c[1], c[2], self._span(start, end))

    def lambda_(self, c: list[Any], start: int, end: int) -> s.Lambda:
        return s.Lambda(tuple(c[0] or ()), c[1], c[2], self._span(start, end))

    def binary(self, c: list[Any], start: int, end: int) -> s.Binary:
        left, op, right = c
        op_span = Span(self._source, op.start, op.end)
        return s.Binary(cast(Any, op_span.text), left, right, op_span, Span(self._source, start, end))

    def not_(self, c: list[Any], start: int, end: int) -> s.Unary:
        return s.Unary("not", c[0], self._span(start, end))

    def negative(self, c: list[Any], start: int, end: int) -> s.Unary:
        return s.Unary("-", c[1], self._span(start, end))

    def range(self, c: list[Any], start: int, end: int) -> s.Range:
        lo, dots, hi = c
        return s.Range(lo, hi, self._text[dots.end - 1] == "<", self._span(start, end))

    def call(self, c: list[Any], start: int, end: int) -> s.Call:
        callee, arguments, block = c
        if block is not None and arguments and self._mistakes:
            arguments = self._sound(arguments)
        return s.Call(callee, tuple(arguments or ()), block, Span(self._source, start, end))

    def member(self, c: list[Any], start: int, end: int) -> s.Member | s.Call:
        target, name, block = c
        if block is None:
            return s.Member(target, self._name(name), self._span(start, end))
        member = s.Member(target, self._name(name), self._span(start, name.end))
        return s.Call(member, None, block, self._span(start, end))

    def index(self, c: list[Any], start: int, end: int) -> s.Index:
        return s.Index(c[0], c[1], self._span(start, end))

    def call_block(self, c: list[Any], start: int, end: int) -> s.Call:
        return s.Call(self._name(c[0]), None, c[1], self._span(start, end))

    def args(self, c: list[Any], start: int, end: int) -> list[s.Argument]:
        return c

    def positional(self, c: list[Any], start: int, end: int) -> s.Argument:
        return s.Argument(None, c[0], Span(self._source, start, end))

    def named(self, c: list[Any], start: int, end: int) -> s.Argument:
        return s.Argument(self._name(c[0]), c[1], Span(self._source, start, end))

    # ---- atoms ------------------------------------------------------------------------------------

    def name(self, c: list[Any], start: int, end: int) -> s.Name | s.Error:
        """An empty name stands for a missing value."""
        if start == end:
            return s.Error(Span(self._source, start, end))
        return s.Name(self._text[start:end], Span(self._source, start, end))

    def number(self, c: list[Any], start: int, end: int) -> s.Number | s.Error:
        span = Span(self._source, start, end)
        value = self._value(self._text[start:end], span)
        return s.Error(span) if value is None else s.Number(value, span)

    def angle(self, c: list[Any], start: int, end: int) -> s.Angle | s.Error:
        span = self._span(start, end)
        found = _ANGLE.fullmatch(span.text)
        value = self._value(found[1], span) if found else None
        return s.Error(span) if value is None or found is None else s.Angle(float(value), cast(Any, found[2]), span)

    def _value(self, text: str, span: Span) -> int | float | None:
        """The number that a text means; None if it is none (which the lexer has reported) or too large."""
        try:
            value = float(text)
        except ValueError:
            return None
        if not math.isfinite(value):
            self.diagnostics.append(
                Diagnostic("E0108", "this number is too large", span, "the largest is about 1.8e308")
            )
            return None
        return int(text) if text.isdigit() else value

    def color(self, c: list[Any], start: int, end: int) -> s.Color | s.Error:
        span = self._span(start, end)
        digits = span.text[1:]
        if len(digits) == 3:
            digits = "".join(d + d for d in digits)
        try:
            channels = [int(digits[i : i + 2], 16) / 255 for i in range(0, len(digits), 2)]
        except ValueError:
            return s.Error(span)
        if len(channels) not in (3, 4):
            return s.Error(span)
        red, green, blue, alpha = [*channels, 1.0][:4]
        return s.Color((red, green, blue, alpha), span)

    def bool(self, c: list[Any], start: int, end: int) -> s.Bool:
        return s.Bool(c[0].kind == "TRUE", self._span(start, end))

    def string(self, c: list[Any], start: int, end: int) -> s.Text:
        """Cut a text at `{ }`. A text whose end is missing has been reported; it is read as far as it goes."""
        stop = end - 1 if end - start > 1 and self._text[end - 1] == self._text[start] else end
        parts: list[str | s.Expr] = []
        plain = ""
        at = start + 1
        while at < stop:
            sign = self._text[at]
            if sign == "\\" and at + 1 < stop:
                plain += self._escape(at)
                at += 2
            elif sign == "{":
                if plain:
                    parts.append(plain)
                plain = ""
                part, at = self._braced(at, stop)
                parts.append(part)
            else:
                if sign == "}":
                    self._lone_brace(at)
                plain += sign
                at += 1
        if plain:
            parts.append(plain)
        return s.Text(tuple(parts), self._span(start, end))

    def _escape(self, at: int) -> str:
        sign = self._text[at + 1]
        if sign not in _ESCAPES:
            span = self._span(at, at + 2)
            self.diagnostics.append(
                Diagnostic(
                    "E0109",
                    f"a text knows no `\\{sign}`",
                    span,
                    "unknown after `\\`",
                    helps=(Help("for a backslash itself write two", (Edit(self._span(at, at), "\\"),)),),
                    notes=('known are \\n (new line), \\t (tab), \\", \\\\, \\{ and \\}',),
                )
            )
        return _ESCAPES.get(sign, sign)

    def _braced(self, at: int, stop: int) -> tuple[s.Expr, int]:
        """The expression in the `{ }` that opens at `at`, and the offset behind it."""
        end = self._text.find("}", at, stop)
        if end < 0:
            self.diagnostics.append(
                Diagnostic(
                    "E0101",
                    "this `{` in a text is never closed",
                    self._span(at, at + 1),
                    "an expression starts here",
                    helps=(Help("for a brace itself write", (Edit(self._span(at, at), "\\"),)),),
                    notes=('an expression between { } cannot hold a text in ": give it a name with `let` first',),
                )
            )
            return s.Error(self._span(at, stop)), stop
        if not self._text[at + 1 : end].strip():
            self.diagnostics.append(
                Diagnostic(
                    "E0103",
                    "nothing stands between these braces",
                    self._span(at, end + 1),
                    "an expression is missing",
                    helps=(Help("for a brace itself write", (Edit(self._span(at, at), "\\"),)),),
                )
            )
            return s.Error(self._span(at, end + 1)), end + 1
        return self._parse_part(at + 1, end), end + 1

    def _lone_brace(self, at: int) -> None:
        self.diagnostics.append(
            Diagnostic(
                "E0102",
                "this `}` in a text closes nothing",
                self._span(at, at + 1),
                "no `{` is open here",
                helps=(Help("for a brace itself write", (Edit(self._span(at, at), "\\"),)),),
            )
        )

    def group(self, c: list[Any], start: int, end: int) -> s.Group:
        return s.Group(c[0], self._span(start, end))

    def vector(self, c: list[Any], start: int, end: int) -> s.Vector:
        return s.Vector(tuple(c), Span(self._source, start, end))

    def record(self, c: list[Any], start: int, end: int) -> s.Record:
        self._no_doubles([name for name, _ in c])
        return s.Record(tuple(c), self._span(start, end))

    def field(self, c: list[Any], start: int, end: int) -> tuple[s.Name, s.Expr]:
        return self._name(c[0]), c[1]

    def _no_doubles(self, names: list[s.Name]) -> None:
        first: dict[str, s.Name] = {}
        for name in names:
            if name.text in first:
                self.diagnostics.append(
                    Diagnostic(
                        "E0202",
                        f"this record has two fields `{name.text}`",
                        name.span,
                        "second one",
                        (Label(first[name.text].span, "first one"),),
                    )
                )
            first.setdefault(name.text, name)

    def list(self, c: list[Any], start: int, end: int) -> s.List:
        return s.List(tuple(child for child in c if child is not None), self._span(start, end))

    def for_elem(self, c: list[Any], start: int, end: int) -> s.ForElement:
        return s.ForElement(c[0], c[1], c[2], self._span(start, end))

    def if_elem(self, c: list[Any], start: int, end: int) -> s.IfElement:
        return s.IfElement(c[0], c[1], self._span(start, end))

    # ---- types --------------------------------------------------------------------------------------

    def named_type(self, c: list[Any], start: int, end: int) -> s.NamedType:
        return s.NamedType(self._text[start:end], self._span(start, end))

    def list_type(self, c: list[Any], start: int, end: int) -> s.ListType:
        return s.ListType(c[0], self._span(start, end))

    def fn_type(self, c: list[Any], start: int, end: int) -> s.FnType:
        """The last child is the result (an absent parameter list leaves a None)."""
        return s.FnType(tuple(p for p in c[:-1] if p is not None), c[-1], self._span(start, end))

    def record_type(self, c: list[Any], start: int, end: int) -> s.RecordType:
        self._no_doubles([name for name, _ in c])
        return s.RecordType(tuple(c), self._span(start, end))

    def type_field(self, c: list[Any], start: int, end: int) -> tuple[s.Name, s.TypeSyntax]:
        return self._name(c[0]), c[1]


def _stand_in(item: Any) -> Any:
    """An error in the place of an item, under its name if it defines one."""
    match item:
        case s.Let(name) | s.Param(name) | s.Fn(name) | s.KernelDecl(name):
            return s.Let(name, None, s.Error(item.span), item.doc, item.span)
        case s.TypeAlias(name):
            return s.TypeAlias(name, s.Error(item.span), item.doc, item.span)
        case s.ImportNames() | s.ImportModule():
            return item
        case _:
            return s.Error(item.span)


class _Edition:
    """What a header says; it stands before the items until `start` takes it."""

    def __init__(self, number: int) -> None:
        self.number = number


def reserved(span: Span) -> Diagnostic:
    """E0107: a reserved word where a name is defined."""
    return Diagnostic(
        "E0107",
        f"`{span.text}` is a reserved word",
        span,
        "cannot be the name of something",
        helps=(Help("choose another name", (Edit(span, span.text + "_"),)),),
        notes=("reserved words are free as labels of arguments and fields: camera(from = p)",),
    )
