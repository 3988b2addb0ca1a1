"""Types of expressions and blocks: local inference in one direction.

`Inference.expr` gives the typed form of an expression; `expected` is what its place wants, for
literals that need a hint (lambdas, empty lists, records read from a file) and for did-you-mean.
Whether the value fits is decided by `fit`, so an expression is checked in one way wherever it
stands. Calls are in `calls`, uses of names in `names`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import assert_never

from blobscript import operators, syntax, typed, wording
from blobscript.calls import call
from blobscript.convert import converted, needs_conversion
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.inferring import Known
from blobscript.names import bind, member, name_use, type_of_syntax
from blobscript.resolve import Module
from blobscript.scopes import Scope
from blobscript.source import Span
from blobscript.types import (
    ANGLE,
    BOOL,
    COLOR,
    ERROR,
    INT,
    NOTHING,
    NUMBER,
    RANGE,
    TEXT,
    VEC3,
    Choice,
    FnOf,
    ListOf,
    OneOf,
    Primitive,
    RecordOf,
    Type,
    Variable,
    article,
    fits,
    has_error,
    join,
    plural,
)

__all__ = ["Inference"]

_RADIANS = {"deg": math.pi / 180, "rad": 1.0, "turn": 2 * math.pi}


@dataclass(slots=True, eq=False)
class _Sink:
    """What becomes of the items of a list or block: checked against `wanted`, or joined."""

    wanted: Type | None
    misfit: Callable[[syntax.Expr, Type], Diagnostic] | None = None
    flatten: bool = False
    joined: Type = NOTHING
    first: Span | None = None


@dataclass(slots=True, eq=False)
class Inference:
    """Checks expressions of one file. `known` has the types of its definitions."""

    module: Module
    known: Known

    def report(self, diagnostic: Diagnostic) -> None:
        self.known.report(diagnostic)

    # ---- expressions --------------------------------------------------------------------

    def expr(self, node: syntax.Expr, scope: Scope, expected: Type | None = None) -> typed.Expr:
        match node:
            case syntax.Name():
                return name_use(self, node, scope, expected)
            case syntax.Number():
                return self._number(node)
            case syntax.Angle(value, unit, span):
                return typed.Constant(value * _RADIANS[unit], ANGLE, span)
            case syntax.Color(rgba, span):
                from blobscript.values import Color

                return typed.Constant(Color.from_srgb(*rgba), COLOR, span)
            case syntax.Bool(value, span):
                return typed.Constant(value, BOOL, span)
            case syntax.Text():
                return self._text(node, scope, expected)
            case syntax.Vector():
                return self._vector(node, scope)
            case syntax.Record():
                return self._record(node, scope, expected)
            case syntax.List():
                return self._list(node, scope, expected)
            case syntax.Group(inner):
                return self.expr(inner, scope, expected)
            case syntax.Unary():
                return self._unary(node, scope)
            case syntax.Binary():
                return self._binary(node, scope)
            case syntax.Range():
                return self._list_of_range(node, scope)
            case syntax.IfExpr():
                return self._if(node, scope, expected)
            case syntax.Lambda():
                return self.lambda_(node, scope, expected)
            case syntax.Call():
                return call(self, node, scope, expected)
            case syntax.Member():
                return member(self, node, scope)
            case syntax.Index():
                return self._index(node, scope)
            case syntax.Error(span):
                return typed.Failed(ERROR, span)
            case _:
                assert_never(node)

    def fit(self, node: syntax.Expr, expr: typed.Expr, wanted: Type, place: wording.Place) -> typed.Expr:
        """The value for its place; if it does not fit, a diagnostic and a value that absorbs."""
        if fits(expr.type, wanted):
            return converted(expr, wanted)
        if not has_error(expr.type):
            self.report(wording.mismatch(node, expr.type, wanted, place))
        return typed.Failed(ERROR, expr.span)

    def fitted(self, node: syntax.Expr, scope: Scope, wanted: Type, place: wording.Place) -> typed.Expr:
        return self.fit(node, self.expr(node, scope, wanted), wanted, place)

    def condition(self, node: syntax.Expr, scope: Scope, word: str) -> typed.Expr:
        return self.fitted(node, scope, BOOL, wording.Place(f"`{word}` wants a condition, that is", ""))

    def _number(self, node: syntax.Number) -> typed.Expr:
        if isinstance(node.value, int) and abs(node.value) <= operators.LARGEST_INT:
            return typed.Constant(node.value, INT, node.span)
        value = float(node.value) if abs(node.value) < 1e308 else math.inf
        if math.isinf(value):
            self.report(Diagnostic("E0405", "this number is too large", node.span, "numbers end below 1e308"))
            return typed.Failed(ERROR, node.span)
        return typed.Constant(value, NUMBER, node.span)

    def _text(self, node: syntax.Text, scope: Scope, expected: Type | None) -> typed.Expr:
        parts: list[str | typed.Expr] = []
        for part in node.parts:
            parts.append(part if isinstance(part, str) else self.expr(part, scope))
        if all(isinstance(part, str) for part in parts):
            text = "".join([str(part) for part in parts])
            chosen = isinstance(expected, Choice) and text in expected.values
            return typed.Constant(text, Choice((text,)) if chosen else TEXT, node.span)
        return typed.Text(tuple(parts), TEXT, node.span)

    def _vector(self, node: syntax.Vector, scope: Scope) -> typed.Expr:
        place = wording.Place("a vector wants", " for each of its parts")
        parts = [self.expr(item, scope, NUMBER) for item in node.items]
        wrong = [i for i, part in enumerate(parts) if not fits(part.type, NUMBER)]
        if wrong:  # the first tells enough
            return self.fit(node.items[wrong[0]], parts[wrong[0]], NUMBER, place)
        parts = [converted(part, NUMBER) for part in parts]
        if len(parts) != 3:
            self.report(
                Diagnostic(
                    "E0304",
                    f"a vector has three parts, but this has {len(parts)}",
                    node.span,
                    f"{len(parts)} parts",
                    helps=(Help("write (x, y, z); for a list of numbers use [ ]"),),
                )
            )
            return typed.Failed(ERROR, node.span)
        x, y, z = parts
        if isinstance(x, typed.Constant) and isinstance(y, typed.Constant) and isinstance(z, typed.Constant):
            return typed.Constant((x.value, y.value, z.value), VEC3, node.span)
        return typed.Vector(x, y, z, VEC3, node.span)

    def _record(self, node: syntax.Record, scope: Scope, expected: Type | None) -> typed.Expr:
        fields: dict[str, typed.Expr] = {}
        for name, value in node.fields:
            hint = expected.field(name.text) if isinstance(expected, RecordOf) else None
            fields[name.text] = self.expr(value, scope, hint)
        kind = RecordOf(tuple([(name, value.type) for name, value in fields.items()]))
        return typed.Record(tuple(fields.items()), kind, node.span)

    def _index(self, node: syntax.Index, scope: Scope) -> typed.Expr:
        target = self.expr(node.target, scope)
        index = self.fitted(node.index, scope, INT, wording.Place("an index is", ""))
        if isinstance(target.type, ListOf):
            return typed.Index(target, index, target.type.element, node.span)
        if not has_error(target.type):
            place = wording.Place("only a list has elements: `[ ]` wants", "")
            self.report(wording.mismatch(node.target, target.type, ListOf(NOTHING), place))
        return typed.Failed(ERROR, node.span)

    # ---- operators ------------------------------------------------------------------------

    def _unary(self, node: syntax.Unary, scope: Scope) -> typed.Expr:
        if node.op == "not":
            operand = self.fitted(node.operand, scope, BOOL, wording.Place("`not` wants"))
            return typed.Not(operand, BOOL, node.span)
        operand = self.expr(node.operand, scope)
        if isinstance(operand, typed.Constant) and operand.type in (INT, NUMBER, ANGLE):
            return typed.Constant(-operand.value, operand.type, node.span)
        row = operators.find(operators.UNARY["-"], operand.type, operand.type)
        if has_error(operand.type):
            return typed.Failed(ERROR, node.span)
        if row is None:
            self.report(
                Diagnostic(
                    "E0310",
                    f"`-` is not defined for {article(operand.type)}",
                    node.span,
                    wording.label_for(operand.type),
                )
            )
            return typed.Failed(ERROR, node.span)
        return typed.Unary("-", row.implementation, operand, row.result, node.span)

    def _binary(self, node: syntax.Binary, scope: Scope) -> typed.Expr:
        if node.op in ("and", "or"):
            return self._logic(node, scope)
        left, right = self.expr(node.left, scope), self.expr(node.right, scope)
        if has_error(left.type) or has_error(right.type):
            kind = BOOL if node.op in ("==", "!=", "<", "<=", ">", ">=") else ERROR
            return typed.Failed(kind, node.span)
        if node.op in ("==", "!="):
            return self._equality(node, left, right)
        if node.op not in operators.BINARY:  # the parser had to invent it, and said so
            return typed.Failed(ERROR, node.span)
        row = operators.find(operators.BINARY[node.op], left.type, right.type)
        if row is None:
            self.report(_no_operator(node, left.type, right.type))
            return typed.Failed(ERROR, node.span)
        kind = INT if node.op == "^" and _whole_power(left, right) else row.result
        implementation = "power_int" if kind == INT and node.op == "^" else row.implementation
        if implementation not in ("add_int", "subtract_int", "multiply_int", "power_int"):
            left, right = converted(left, row.left), converted(right, row.right)
        return typed.Binary(node.op, implementation, left, right, node.op_span, kind, node.span)

    def _logic(self, node: syntax.Binary, scope: Scope) -> typed.Expr:
        place = wording.Place(f"`{node.op}` wants", " on both sides")
        left = self.fitted(node.left, scope, BOOL, place)
        right = self.fitted(node.right, scope, BOOL, place)
        make = typed.And if node.op == "and" else typed.Or
        return make(left, right, BOOL, node.span)

    def _equality(self, node: syntax.Binary, left: typed.Expr, right: typed.Expr) -> typed.Expr:
        both = join(left.type, right.type)
        if both is None or _foreign_choice(left, right) or _foreign_choice(right, left):
            self.report(_never_equal(node, left.type, right.type))
        elif not operators.comparable(both):
            self.report(_no_operator(node, left.type, right.type))
        else:
            left, right = converted(left, both), converted(right, both)
            name = "equal" if node.op == "==" else "not_equal"
            return typed.Binary(node.op, name, left, right, node.op_span, BOOL, node.span)
        return typed.Failed(BOOL, node.span)

    def _list_of_range(self, node: syntax.Range, scope: Scope) -> typed.Expr:
        found = self.range_(node, scope)
        if found.type == RANGE:
            self.report(_no_steps(node))
            return typed.Failed(ERROR, node.span)
        return found

    def range_(self, node: syntax.Range, scope: Scope) -> typed.Expr:
        """A list, or the limits of a parameter."""
        lo, hi = self.expr(node.lo, scope), self.expr(node.hi, scope)
        if has_error(lo.type) or has_error(hi.type):
            return typed.Failed(ERROR, node.span)
        if fits(lo.type, INT) and fits(hi.type, INT):
            return typed.Range(lo, hi, node.half_open, ListOf(INT), node.span)
        for both in (NUMBER, ANGLE):
            if fits(lo.type, both) and fits(hi.type, both):
                lo, hi = converted(lo, both), converted(hi, both)
                return typed.Range(lo, hi, node.half_open, RANGE, node.span)
        wanted = ANGLE if ANGLE in (lo.type, hi.type) else NUMBER
        wrong, value = (node.lo, lo) if not fits(lo.type, wanted) else (node.hi, hi)
        self.fit(wrong, value, wanted, wording.Place("this range wants", ""))
        return typed.Failed(ERROR, node.span)

    def _if(self, node: syntax.IfExpr, scope: Scope, expected: Type | None) -> typed.Expr:
        condition = self.condition(node.condition, scope, "if")
        then = self.expr(node.then, scope, expected)
        otherwise = self.expr(node.otherwise, scope, expected)
        kind = join(then.type, otherwise.type)
        if kind is None:
            self.report(
                Diagnostic(
                    "E0309",
                    f"the branches differ: one gives {article(then.type)}, the other {article(otherwise.type)}",
                    node.otherwise.span,
                    wording.label_for(otherwise.type),
                    (Label(node.then.span, wording.label_for(then.type)),),
                    (Help("both branches of an `if` must give the same kind of value"),),
                )
            )
            return typed.Failed(ERROR, node.span)
        return typed.If(condition, converted(then, kind), converted(otherwise, kind), kind, node.span)

    # ---- lambdas --------------------------------------------------------------------------

    def lambda_(self, node: syntax.Lambda, scope: Scope, expected: Type | None) -> typed.Expr:
        if isinstance(expected, OneOf):
            functions = [option for option in expected.options if isinstance(option, FnOf)]
            expected = functions[0] if functions else None
        hints = expected.parameters if isinstance(expected, FnOf) else ()
        inside = scope.function()
        parameters = [
            self.parameter(p, inside, hints[i] if i < len(hints) else None) for i, p in enumerate(node.parameters)
        ]
        wanted = type_of_syntax(self, node.result) if node.result else None
        body = self.expr(node.body, inside, wanted or _closed(expected.result if isinstance(expected, FnOf) else None))
        if wanted is not None:
            body = self.fit(node.body, body, wanted, wording.Place("this function is declared to give"))
        kind = FnOf(tuple([p.type for p in parameters if p.default is None]), wanted or body.type)
        function = typed.Function(
            "this function", tuple(parameters), typed.Body((), body), inside.frame.size, node.span
        )
        return typed.Lambda(function, tuple(inside.frame.captured.items()), kind, node.span)

    def parameter(self, node: syntax.Parameter, scope: Scope, hint: Type | None) -> typed.Parameter:
        """A parameter of a function or lambda, known from its type, its default or its place."""
        wanted = type_of_syntax(self, node.type) if node.type else None
        default: typed.Expr | None = None
        if node.default is not None:
            default = self.expr(node.default, scope, wanted)
            if wanted is not None:
                default = self.fit(node.default, default, wanted, wording.declared(node.name.text, node.name.span))
        kind = wanted or (_widened(default.type) if default else None) or _closed(hint)
        if kind is None or kind == ListOf(NOTHING):
            self.report(_needs_type(node))
            kind = ERROR
        bind(self, node.name, kind, scope)
        return typed.Parameter(node.name.text, kind, default)

    # ---- lists and blocks -------------------------------------------------------------------

    def _list(self, node: syntax.List, scope: Scope, expected: Type | None) -> typed.Expr:
        hint = _list_hint(expected)
        sink = _Sink(None)
        elements = self._elements(node.items, scope.inner(), sink, hint)
        kind = ListOf(sink.joined)
        made = typed.List(elements, kind, node.span)
        return typed.Convert(made, kind, node.span) if _mixed(elements, sink.joined) else made

    def block(
        self, node: syntax.Block, scope: Scope, wanted: Type | None, misfit: Callable[[syntax.Expr, Type], Diagnostic]
    ) -> typed.Expr:
        """A block as a list; an item that is a list of what is wanted counts as its elements."""
        sink = _Sink(wanted, misfit, flatten=True)
        elements = self._elements(node.items, scope.inner(), sink, wanted)
        kind = ListOf(wanted if wanted is not None else sink.joined)
        made = typed.List(elements, kind, node.span)
        return typed.Convert(made, kind, node.span) if _mixed(elements, kind.element) else made

    def top_level(self, item: syntax.Item, scope: Scope) -> typed.Element | None:
        """An item that stands on a line of its own in a file."""
        wanted = OneOf(
            tuple(
                [
                    Primitive(n)
                    for n in ("surface", "field", "light", "camera", "background", "stage", "image", "animate")
                ]
            )
        )
        return self._element(item, scope, _Sink(wanted, wording.top_level_item, flatten=True), None)

    def _elements(
        self, items: Iterable[syntax.Item | syntax.Element], scope: Scope, sink: _Sink, hint: Type | None
    ) -> tuple[typed.Element, ...]:
        found = [self._element(item, scope, sink, hint) for item in items]
        return tuple([element for element in found if element is not None])

    def _element(
        self, item: syntax.Item | syntax.Element, scope: Scope, sink: _Sink, hint: Type | None
    ) -> typed.Element | None:
        match item:
            case syntax.Let() | syntax.Assert() | syntax.Debug():
                return self.statement(item, scope)
            case syntax.Spread(value, span):
                return self._spread(item, self.expr(value, scope, ListOf(hint) if hint else None), sink, span)
            case syntax.For(binder, iterable, body, span):
                return self._for(binder, iterable, body.items, span, scope, sink, hint)
            case syntax.ForElement(binder, iterable, body, span):
                return self._for(binder, iterable, (body,), span, scope, sink, hint)
            case syntax.If(condition, then, otherwise, span):
                test = self.condition(condition, scope, "if")
                yes = self._elements(then.items, scope.inner(), sink, hint)
                no: tuple[typed.Element, ...] = ()
                if otherwise is not None:
                    items = otherwise.items if isinstance(otherwise, syntax.Block) else (otherwise,)
                    no = self._elements(items, scope.inner(), sink, hint)
                return typed.IfElements(test, yes, no, span)
            case syntax.IfElement(condition, then, span):
                test = self.condition(condition, scope, "if")
                return typed.IfElements(test, self._elements((then,), scope, sink, hint), (), span)
            case _:
                return self._item(item, self.expr(item, scope, hint), sink)

    def _item(self, node: syntax.Expr, value: typed.Expr, sink: _Sink) -> typed.Element:
        if sink.flatten and isinstance(value.type, ListOf):
            return self._spread(node, value, sink, node.span)
        self._take(node, value.type, sink)
        if sink.wanted is not None and fits(value.type, sink.wanted):
            value = converted(value, sink.wanted)
        return typed.Item(value, node.span)

    def _spread(self, node: syntax.Expr | syntax.Spread, value: typed.Expr, sink: _Sink, span: Span) -> typed.Element:
        inner = node.value if isinstance(node, syntax.Spread) else node
        if not isinstance(value.type, ListOf):
            if has_error(value.type):
                self._take(inner, ERROR, sink)
            else:
                self.report(wording.mismatch(inner, value.type, ListOf(NOTHING), wording.Place("`...` wants")))
        elif sink.wanted is not None and not fits(value.type.element, sink.wanted):
            self._refuse(inner, value.type, sink)
        else:
            self._take(inner, value.type.element, sink)
        return typed.Spread(value, span)

    def _take(self, node: syntax.Expr, kind: Type, sink: _Sink) -> None:
        """One more element of this type."""
        if sink.wanted is not None:
            if not fits(kind, sink.wanted):
                self._refuse(node, kind, sink)
            return
        joined = join(sink.joined, kind)
        if joined is None:
            self.report(_elements_differ(node, kind, sink.joined, sink.first))
            joined = ERROR
        sink.joined = joined
        sink.first = sink.first or node.span

    def _refuse(self, node: syntax.Expr, kind: Type, sink: _Sink) -> None:
        if not has_error(kind) and sink.misfit is not None:
            self.report(sink.misfit(node, kind))

    def _for(
        self,
        binder: syntax.Binder,
        iterable: syntax.Expr,
        body: tuple[syntax.Item | syntax.Element, ...],
        span: Span,
        scope: Scope,
        sink: _Sink,
        hint: Type | None,
    ) -> typed.Element:
        through = self.expr(iterable, scope)
        kind: Type = ERROR
        if isinstance(through.type, ListOf):
            kind = through.type.element
        elif not has_error(through.type):
            self.report(wording.mismatch(iterable, through.type, ListOf(NOTHING), wording.Place("`for` goes through")))
        inside = scope.inner()
        index = bind(self, binder.index, INT, inside) if binder.index else None
        slot = bind(self, binder.value, kind, inside)
        return typed.For(index, slot, through, self._elements(body, inside, sink, hint), span)

    # ---- statements ---------------------------------------------------------------------------

    def statement(self, item: syntax.Let | syntax.Assert | syntax.Debug, scope: Scope) -> typed.Statement:
        match item:
            case syntax.Let():
                value = self.let_value(item, scope)
                return typed.Let(bind(self, item.name, value.type, scope), item.name.text, value, item.span)
            case syntax.Assert(condition, message, span):
                with self.known.only_checking():
                    test = self.condition(condition, scope, "assert")
                    place = wording.Place("the message of `assert` is")
                    says = self.fitted(message, scope, TEXT, place) if message is not None else None
                return typed.Assert(test, says, span)
            case syntax.Debug(value, span):
                with self.known.only_checking():
                    return typed.Debug(self.expr(value, scope), span)
            case _:
                assert_never(item)

    def let_value(self, item: syntax.Let, scope: Scope) -> typed.Expr:
        """The value of a `let`, fitted to its declared type."""
        wanted = type_of_syntax(self, item.type) if item.type else None
        value = self.expr(item.value, scope, wanted)
        if wanted is None:
            return value
        place = wording.declared(item.name.text, item.type.span if item.type else item.name.span)
        value = self.fit(item.value, value, wanted, place)
        return typed.Failed(wanted, value.span) if isinstance(value, typed.Failed) else _seen_as(value, wanted)


def _seen_as(value: typed.Expr, wanted: Type) -> typed.Expr:
    """A value with the type that was declared for it (fewer fields, a text for a choice)."""
    return value if value.type == wanted else typed.Convert(value, wanted, value.span)


# ---- hints ----------------------------------------------------------------------------------


def _list_hint(expected: Type | None) -> Type | None:
    """What the elements of a list should be if the list should be this."""
    if isinstance(expected, OneOf):
        lists = [option for option in expected.options if isinstance(option, ListOf)]
        return _list_hint(lists[0]) if lists else None
    return _closed(expected.element) if isinstance(expected, ListOf) else None


def _closed(kind: Type | None) -> Type | None:
    """A type as a hint; nothing can be learned from a variable that is not bound yet."""
    return None if kind is None or isinstance(kind, (Variable, type(NOTHING))) else kind


def _widened(kind: Type) -> Type:
    """The type of a parameter with this default."""
    return TEXT if isinstance(kind, Choice) else kind


def _mixed(elements: tuple[typed.Element, ...], joined: Type) -> bool:
    """Do some elements have to be converted to the type of the list?"""
    for element in elements:
        match element:
            case typed.Item(value):
                if needs_conversion(value.type, joined):
                    return True
            case typed.Spread(value):
                if isinstance(value.type, ListOf) and needs_conversion(value.type.element, joined):
                    return True
            case typed.For(body=body):
                if _mixed(body, joined):
                    return True
            case typed.IfElements(_, then, otherwise):
                if _mixed(then, joined) or _mixed(otherwise, joined):
                    return True
            case _:
                pass
    return False


def _whole_power(left: typed.Expr, right: typed.Expr) -> bool:
    """Ints stay ints under a power that is written as a whole number, like `n^2`."""
    return left.type == INT and right.type == INT and isinstance(right, typed.Constant) and right.value >= 0


def _foreign_choice(choice: typed.Expr, other: typed.Expr) -> bool:
    """Is a parameter with choices compared with a text that is none of them?"""
    if not isinstance(choice.type, Choice):
        return False
    if isinstance(other.type, Choice):
        return not set(other.type.values) & set(choice.type.values)
    return isinstance(other, typed.Constant) and other.value not in choice.type.values


# ---- what goes wrong --------------------------------------------------------------------------


def _needs_type(node: syntax.Parameter) -> Diagnostic:
    return Diagnostic(
        "E0305",
        f"the parameter `{node.name.text}` needs a type or a default value",
        node.name.span,
        "of what type?",
        helps=(Help("write its type behind a colon", (Edit(node.name.span.at_end, ": number"),)),),
    )


def _no_steps(node: syntax.Expr) -> Diagnostic:
    return Diagnostic(
        "E0304",
        "a range counts in whole numbers, but this one has no steps",
        node.span,
        "not whole numbers",
        helps=(Help("count and divide: for (i in 0..10) { let x = i / 10 ... }"),),
    )


def _elements_differ(node: syntax.Expr, kind: Type, before: Type, first: Span | None) -> Diagnostic:
    return Diagnostic(
        "E0308",
        f"elements of a list have one type, but {wording.subject(node, kind)}, and those before are {plural(before)}",
        node.span,
        wording.label_for(kind),
        (Label(first, wording.label_for(before)),) if first else (),
    )


def _never_equal(node: syntax.Binary, left: Type, right: Type) -> Diagnostic:
    always = "false" if node.op == "==" else "true"
    if isinstance(left, Choice) or isinstance(right, Choice):
        choice = left if isinstance(left, Choice) else right
        message = f"this is always {always}: the only values are {article(choice).removeprefix('one of ')}"
    else:
        message = f"{article(left)} and {article(right)} are never equal, so this is always {always}"
    return Diagnostic(
        "E0311",
        message,
        node.op_span,
        f"always {always}",
        (Label(node.left.span, wording.label_for(left)), Label(node.right.span, wording.label_for(right))),
    )


def _no_operator(node: syntax.Binary, left: Type, right: Type) -> Diagnostic:
    one_angle = left != right and ANGLE in (left, right) and {left, right} <= {ANGLE, NUMBER, INT}
    if one_angle and node.op in ("+", "-", "<", "<=", ">", ">="):
        wrong, kind = (node.right, right) if left == ANGLE else (node.left, left)
        return wording.mismatch(wrong, kind, ANGLE, wording.Place(f"`{node.op}` wants", " on both sides"))
    return Diagnostic(
        "E0310",
        f"`{node.op}` is not defined for {article(left)} and {article(right)}",
        node.op_span,
        "not defined for these",
        (Label(node.left.span, wording.label_for(left)), Label(node.right.span, wording.label_for(right))),
        _operator_help(node, left, right),
    )


def _operator_help(node: syntax.Binary, left: Type, right: Type) -> tuple[Help, ...]:
    both = {left, right}
    skeleton = Primitive("skeleton")
    if node.op == "+" and TEXT in both:
        return (Help('texts are put together in a text: "{a}{b}"'),)
    if node.op == "+" and isinstance(left, ListOf) and isinstance(right, ListOf):
        text = f"[...{node.left.span.text}, ...{node.right.span.text}]"
        return (Help("lists are joined with `...`", (Edit(node.span, text),)),)
    if both == {VEC3} and node.op == "*":
        return (Help("`dot(a, b)` gives a number, `cross(a, b)` a vector"),)
    if both == {VEC3} and node.op in ("<", "<=", ">", ">="):
        return (Help("compare their lengths: length(a) < length(b)"),)
    if VEC3 in both and node.op in ("+", "-") and both & {NUMBER, INT}:
        return (Help("add a vector: (1, 1, 1) * the number moves all three parts"),)
    if skeleton in both:
        return (Help("fields can be added; make one with .blob(radius = 1)"),)
    if both == {COLOR} or (COLOR in both and both & {NUMBER, INT}):
        return (Help("mix colours with `lerp(a, b, 0.5)`"),)
    if Primitive("surface") in both:
        return (Help("add the fields, and make one surface of the sum"),)
    return ()
